#define _GNU_SOURCE /* MAP_NORESERVE */
#include "import/decoder/serve.h"

#include "import/decoder/wire.h"
#include "import/sandbox/confine.h"

#include <errno.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#define PROGRAM_BYTES ((size_t)256 << 20) /* libraries, the stack and their initial allocations */
#define LIFE_S 7200                       /* processor time; the parent replaces the process long before */

/* False: the other end is gone or sent something invalid. */
static bool next_request(struct wire_request *q, size_t file_bytes)
{
    ssize_t got;

    do
        got = read(WIRE_SOCKET, q, sizeof(*q));
    while (got < 0 && errno == EINTR);
    return got == (ssize_t)sizeof(*q) && q->magic == WIRE_MAGIC && q->max_side <= IMAGE_MAX_SIDE &&
           q->size <= file_bytes;
}

static bool say(const void *message, size_t size)
{
    return write(WIRE_SOCKET, message, size) == (ssize_t)size;
}

/* The image's memory stays mapped: image_resize never exceeds it. */
static int serve(const uint8_t *file, size_t file_bytes, float *picture, const struct decoder_work *work)
{
    struct image im = { .rgb = picture, .capacity = 3 * IMAGE_MAX_TEXELS };
    struct wire_request q;

    while (next_request(&q, file_bytes)) {
        struct wire_answer a = { .magic = WIRE_MAGIC };
        q.name[sizeof(q.name) - 1] = 0;
        im.max_side = q.max_side;
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
        if (!say(&a, sizeof(a)))
            return 1;
    }
    return 0;
}

int decoder_serve(int argc, char **argv, const struct decoder_work *work)
{
    struct wire_hello hello = { .magic = WIRE_MAGIC };
    unsigned long long file_bytes, image_bytes, memory_bytes;

    if (argc != 4 || sscanf(argv[1], "%llu", &file_bytes) != 1 || sscanf(argv[2], "%llu", &image_bytes) != 1 ||
        sscanf(argv[3], "%llu", &memory_bytes) != 1 || image_bytes < 3 * sizeof(float) * IMAGE_MAX_TEXELS) {
        fprintf(stderr, "other relightd programs start this one to decode images or video; it cannot be used alone.\n");
        return argc == 2 && strcmp(argv[1], "--help") == 0 ? 0 : 2;
    }
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
    hello.error = confine_calls(false);
    hello.confined = hello.error == 0;
    _exit(say(&hello, sizeof(hello)) ? serve(file, (size_t)file_bytes, picture, work) : 1);
}
