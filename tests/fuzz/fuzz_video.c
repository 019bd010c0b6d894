/* A video file is taken apart and decoded as the two sandboxed processes do it: every call ends with an answer within
 * its limits, or is refused with a reason. */
#include "harness.h"

#include "base/mem.h"
#include "import/decoder/internal.h"
#include "import/demux/demux.h"
#include "import/demux/internal.h"

#include <math.h>
#include <string.h>

enum { PACKET_BYTES = 1 << 20, ITEMS = 24, SIDE = 512 };

static void check_picture(struct stream *s, struct wire_request *q, struct image *im)
{
    struct wire_answer a = { 0 };

    q->kind = WIRE_CONVERT;
    q->size = 0;
    const enum err e = stream_work(s, q, NULL, im, &a);
    require(!e || a.why.text[0], "a refusal has a reason");
    require(e || (im->width <= SIDE && im->height <= SIDE), "an image within the limit");
    for (size_t i = 0; !e && i < 3 * (size_t)im->width * im->height; i++)
        require(isfinite(im->rgb[i]), "finite texels");
}

static void decode(struct stream *s, const struct demux_answer *d, const uint8_t *packet, struct image *im)
{
    struct wire_request q = { .max_side = SIDE, .size = d->size, .time_us = d->time_us, .name = "input" };
    struct wire_answer a = { 0 };

    q.kind = d->kind == DEMUX_FORMAT ? WIRE_STREAM : WIRE_PACKET;
    q.format = d->format;
    enum err e = stream_work(s, &q, packet, im, &a);
    for (int i = 0; i < 4 && !e && a.picture; i++) {
        check_picture(s, &q, im);
        a = (struct wire_answer){ 0 };
        q.kind = WIRE_NEXT;
        e = stream_work(s, &q, NULL, im, &a);
    }
    require(!e || a.why.text[0], "a refusal has a reason");
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
    uint8_t *packet = mem_alloc(PACKET_BYTES, 1);
    struct reading *r = reading_create(
        &(struct reading_desc){ .file = bytes, .file_bytes = size, .packet = packet, .packet_bytes = PACKET_BYTES });
    struct stream *s = stream_create();
    struct image im = { .max_side = SIDE };
    struct demux_answer a = { 0 };

    require(packet && r && s, "memory");
    enum err e = reading_open(r, "", &a);
    for (int i = 0; i < ITEMS && !e; i++) {
        require(a.kind == DEMUX_FORMAT || a.kind == DEMUX_PACKET, "a format or a packet");
        require(a.size <= PACKET_BYTES, "what fits the shared memory");
        decode(s, &a, packet, &im);
        a = (struct demux_answer){ 0 };
        e = reading_next(r, &a);
        if (i == ITEMS / 2)
            (void)reading_seek(r, 0, &a);
    }
    require(!e || e == ERR_END || a.why.text[0], "a refusal has a reason");
    image_finish(&im);
    stream_destroy(s);
    reading_destroy(r);
    mem_free(packet);
    return 0;
}
