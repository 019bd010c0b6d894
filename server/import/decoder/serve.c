#define _GNU_SOURCE /* MAP_NORESERVE */
#include "import/decoder/internal.h"

#include "import/sandbox/confine.h"
#include "import/sandbox/helper_process.h"

#include <stdio.h>
#include <sys/mman.h>
#include <unistd.h>

#define PROGRAM_BYTES ((size_t)256 << 20) /* libraries, the stack and their initial allocations */
#define LIFE_S 7200                       /* processor time; the parent replaces the process long before */

/* The image's memory stays mapped: image_resize never exceeds it. */
static int serve(const uint8_t *file, size_t file_bytes, float *picture, const struct decoder_work *work)
{
    struct image im = { .rgb = picture, .capacity = 3 * IMAGE_MAX_TEXELS };
    struct wire_request q;

    while (helper_receive(&q, sizeof(q)) && q.max_side <= IMAGE_MAX_SIDE && q.size <= file_bytes) {
        struct wire_answer a = { .magic = WIRE_MAGIC };
        q.name[sizeof(q.name) - 1] = 0;
        q.layer[sizeof(q.layer) - 1] = 0;
        im.max_side = q.max_side;
        im.layer = q.layer;
        if (q.kind == WIRE_IMAGE)
            a.result = (int32_t)work->decode(file, (size_t)q.size, q.name, &im, &a.why);
        else if (work->video)
            a.result = (int32_t)work->video(work->context, &q, file, &im, &a);
        else
            return 1;
        a.width = im.width;
        a.height = im.height;
        a.layout = (uint32_t)im.layout;
        a.nan = im.faults.nan;
        a.infinite = im.faults.infinite;
        a.negative = im.faults.negative;
        a.clipped = im.faults.clipped;
        a.low_range = im.low_range;
        a.taken_us = im.taken_us;
        a.exposure_s = im.exposure_s;
        snprintf(a.note, sizeof(a.note), "%s", im.note);
        if (!helper_send(&a, sizeof(a)))
            return 1;
    }
    return 0;
}

int decoder_serve(int argc, char **argv, const struct decoder_work *work)
{
    unsigned long long file_bytes, image_bytes, memory_bytes;

    if (argc != 4 || sscanf(argv[1], "%llu", &file_bytes) != 1 || sscanf(argv[2], "%llu", &image_bytes) != 1 ||
        sscanf(argv[3], "%llu", &memory_bytes) != 1 || image_bytes < 3 * sizeof(float) * IMAGE_MAX_TEXELS)
        return helper_refuse(argc, argv, "decode images or video");
    const uint8_t *file = mmap(NULL, (size_t)file_bytes, PROT_READ, MAP_SHARED, WIRE_FILE, 0);
    float *picture = mmap(NULL, (size_t)image_bytes, PROT_READ | PROT_WRITE, MAP_SHARED, WIRE_PICTURE, 0);
    if (file == MAP_FAILED || picture == MAP_FAILED)
        return 1;
    close(WIRE_FILE);
    close(WIRE_PICTURE);
    const struct confine_limits limits = {
        .address_bytes = (size_t)(file_bytes + image_bytes + memory_bytes) + PROGRAM_BYTES,
        .seconds = LIFE_S,
        .descriptors = WIRE_PICTURE + 1, /* the process uses only the first six */
    };
    if (confine_limits(&limits) != 0)
        return 1;
    _exit(helper_hello(confine_calls(false)) ? serve(file, (size_t)file_bytes, picture, work) : 1);
}
