/* From light to bytes. */
#include "measure/bench/bench.h"

#include "base/mem.h"

#include <string.h>
#include <turbojpeg.h>

struct toning {
    struct bench *b;
    float *copy;
    size_t values;
};

static enum err tone_ours(void *context)
{
    const struct bench *b = ((struct toning *)context)->b;
    const struct tone_desc tone = { (double)b->sky->gain, TONE_FILMIC, b->kernels->level };

    tone_map(b->sky->rgb, b->desc->width, b->desc->height, &tone, b->sky->display);
    return ERR_OK;
}

static enum err tone_bare(void *context)
{
    struct toning *t = context;
    enum { PIECE = 1 << 15 };

#pragma omp parallel for schedule(static)
    for (size_t at = 0; at < t->values; at += PIECE)
        memcpy(t->copy + at, t->b->sky->rgb + at, sizeof(float) * (t->values - at < PIECE ? t->values - at : PIECE));
    return ERR_OK;
}

enum err bench_tone(struct bench *b, struct bench_row *row)
{
    struct toning t = { .b = b, .values = 3 * (size_t)b->desc->width * b->desc->height };
    const struct bench_pair pair = { { tone_ours, tone_bare }, &t, .scale = { 1e3, 1e3 } };

    snprintf(row->note, sizeof(row->note), "bare: a copy of the image's floats, %.1f MB, by the same threads",
             1e-6 * (double)(t.values * sizeof(float)));
    t.copy = mem_alloc(t.values, sizeof(float));
    const enum err e = t.copy ? bench_time(b, &pair, row) : ERR_NOMEM;
    mem_free(t.copy);
    return e;
}

struct encoding {
    struct bench *b;
    struct jpeg_encoder *ours;
    tjhandle bare;
    unsigned char *bytes;
    unsigned long room;
};

static enum err encode_ours(void *context)
{
    struct encoding *x = context;
    const uint8_t *bytes;
    size_t size;

    return jpeg_encode(x->ours, x->b->sky->display, x->b->desc->width, x->b->desc->height, BENCH_QUALITY, &bytes,
                       &size);
}

static enum err encode_bare(void *context)
{
    struct encoding *x = context;
    unsigned long size = x->room;
    const int width = (int)x->b->desc->width, height = (int)x->b->desc->height;

    return tjCompress2(x->bare, x->b->sky->display, width, 0, height, TJPF_RGB, &x->bytes, &size, TJSAMP_420,
                       BENCH_QUALITY, TJFLAG_NOREALLOC | TJFLAG_ACCURATEDCT) == 0
               ? ERR_OK
               : ERR_NOMEM;
}

enum err bench_jpeg(struct bench *b, struct bench_row *row)
{
    struct encoding x = {
        .b = b,
        .ours = jpeg_encoder_create(),
        .bare = tjInitCompress(),
        .room = tjBufSize((int)b->desc->width, (int)b->desc->height, TJSAMP_420),
    };
    const struct bench_pair pair = { { encode_ours, encode_bare }, &x, .scale = { 1e3, 1e3 } };

    snprintf(row->note, sizeof(row->note), "bare: tjCompress2 on the same pixels, quality %d, 4:2:0, one thread each",
             BENCH_QUALITY);
    x.bytes = tjAlloc((int)x.room);
    const enum err e = x.ours && x.bare && x.bytes ? bench_time(b, &pair, row) : ERR_NOMEM;
    tjFree(x.bytes);
    if (x.bare)
        tjDestroy(x.bare);
    jpeg_encoder_destroy(x.ours);
    return e;
}
