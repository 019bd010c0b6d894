/* From a file's bytes to light samples. */
#include "measure/bench/bench.h"

#include "base/mem.h"
#include "sky/tables/samples.h"

#include <openexr.h>
#include <string.h>

/* ---- Decoding ---- */

struct decoding {
    struct bench *b;
    struct environment *environment;
    float *rgb; /* of the bare decode */
    size_t capacity;
};

static enum err decode_ours(void *context)
{
    struct decoding *d = context;
    struct reason why;

    return environment_decode(d->environment, d->b->sky->file, &why);
}

static int64_t read_memory(exr_const_context_t ctx, void *user, void *to, uint64_t size, uint64_t offset,
                           exr_stream_error_func_ptr_t fail)
{
    const struct frame *file = user;

    (void)ctx, (void)fail;
    if (offset >= file->size)
        return 0;
    if (size > file->size - offset)
        size = file->size - offset;
    memcpy(to, file->bytes + offset, size);
    return (int64_t)size;
}

static int64_t size_of_memory(exr_const_context_t ctx, void *user)
{
    (void)ctx;
    return (int64_t)((const struct frame *)user)->size;
}

/* Directs R, G and B to the image's row and drops the other channels. */
static void aim(exr_decode_pipeline_t *pipe, float *row, int32_t width)
{
    for (int c = 0; c < pipe->channel_count; c++) {
        exr_coding_channel_info_t *to = &pipe->channels[c];
        const char *at = strchr("RGB", to->channel_name[0]);
        to->decode_to_ptr = at && !to->channel_name[1] ? (uint8_t *)(row + (at - "RGB")) : NULL;
        to->user_data_type = EXR_PIXEL_FLOAT;
        to->user_bytes_per_element = 4;
        to->user_pixel_stride = 3 * sizeof(float);
        to->user_line_stride = 3 * (int32_t)sizeof(float) * width;
    }
}

/* The library's own routines from chunk to chunk, as its documentation shows. */
static exr_result_t decode_chunks(exr_context_t f, struct decoding *d)
{
    exr_decode_pipeline_t pipe = EXR_DECODE_PIPELINE_INITIALIZER;
    exr_attr_box2i_t w;
    int32_t lines = 1;
    exr_result_t r = exr_get_data_window(f, 0, &w);

    if (r == EXR_ERR_SUCCESS)
        r = exr_get_scanlines_per_chunk(f, 0, &lines);
    if (r != EXR_ERR_SUCCESS)
        return r;
    const int32_t width = w.max.x - w.min.x + 1;
    for (int32_t y = w.min.y; y <= w.max.y && r == EXR_ERR_SUCCESS; y += lines) {
        exr_chunk_info_t chunk;
        r = exr_read_scanline_chunk_info(f, 0, y, &chunk);
        if (r == EXR_ERR_SUCCESS)
            r = y == w.min.y ? exr_decoding_initialize(f, 0, &chunk, &pipe) : exr_decoding_update(f, 0, &chunk, &pipe);
        if (r != EXR_ERR_SUCCESS)
            break;
        aim(&pipe, d->rgb + 3 * (size_t)(y - w.min.y) * (size_t)width, width);
        if (y == w.min.y)
            r = exr_decoding_choose_default_routines(f, 0, &pipe);
        if (r == EXR_ERR_SUCCESS)
            r = exr_decoding_run(f, 0, &pipe);
    }
    exr_decoding_destroy(f, &pipe);
    return r;
}

static enum err decode_bare(void *context)
{
    struct decoding *d = context;
    exr_context_initializer_t how = EXR_DEFAULT_CONTEXT_INITIALIZER;
    exr_context_t f = NULL;
    exr_storage_t storage = EXR_STORAGE_LAST_TYPE;

    how.user_data = (void *)d->b->sky->file;
    how.read_fn = read_memory;
    how.size_fn = size_of_memory;
    exr_result_t r = exr_start_read(&f, "memory", &how);
    if (r == EXR_ERR_SUCCESS)
        r = exr_get_storage(f, 0, &storage);
    if (r == EXR_ERR_SUCCESS)
        r = storage == EXR_STORAGE_SCANLINE ? decode_chunks(f, d) : EXR_ERR_FEATURE_NOT_IMPLEMENTED;
    if (f)
        exr_finish(&f);
    return r == EXR_ERR_SUCCESS ? ERR_OK : ERR_UNSUPPORTED;
}

enum err bench_decode(struct bench *b, struct bench_row *row)
{
    const struct image *im = &b->sky->environment->image;
    struct decoding d = {
        .b = b,
        .environment = environment_create(&(struct environment_desc){ .n = 16 }),
        .rgb = mem_alloc((size_t)im->width * im->height, 3 * sizeof(float)),
    };
    const struct bench_pair pair = { { decode_ours, decode_bare }, &d, .scale = { 1e3, 1e3 } };
    enum err e = d.environment && d.rgb ? ERR_OK : ERR_NOMEM;

    snprintf(row->note, sizeof(row->note),
             "bare: OpenEXRCore's default routines on the same %zu bytes in memory; one thread each",
             b->sky->file->size);
    if (!e && decode_bare(&d) != ERR_OK)
        bench_skip(row, "the bare loop reads scanlines only, in the first part");
    else if (!e)
        e = bench_time(b, &pair, row);
    environment_destroy(d.environment);
    mem_free(d.rgb);
    return e;
}

/* ---- Resampling, tables, samples ---- */

struct rebuilding {
    struct bench *b;
    struct light_samples samples;
    const char *from[3];
    char *to[3];
    size_t bytes[3];
};

static enum err rebuild_ours(void *context)
{
    struct rebuilding *r = context;
    struct reason why;
    const enum err e = environment_rebuild(r->b->sky->environment, &why);

    return e ? e : samples_draw(r->b->sky->environment, STRATA_FACES, r->b->desc->samples / 2 + 1, 1, &r->samples);
}

static enum err copy_all(void *context)
{
    struct rebuilding *r = context;
    enum { PIECE = 1 << 18 };

    for (int k = 0; k < 3; k++) {
#pragma omp parallel for schedule(static)
        for (size_t at = 0; at < r->bytes[k]; at += PIECE)
            memcpy(r->to[k] + at, r->from[k] + at, r->bytes[k] - at < PIECE ? r->bytes[k] - at : PIECE);
    }
    return ERR_OK;
}

enum err bench_rebuild(struct bench *b, struct bench_row *row)
{
    const struct environment *e = b->sky->environment;
    const size_t texels = (size_t)CUBE_FACES * e->n * e->n;
    struct rebuilding r = {
        .b = b,
        .from = { (const char *)e->image.rgb, (const char *)e->texels, (const char *)e->row_cdf },
        .bytes = { 3 * sizeof(float) * e->image.width * e->image.height, texels * sizeof(struct texel),
                   texels * sizeof(double) },
    };
    const struct bench_pair pair = { { rebuild_ours, copy_all }, &r, .scale = { 1e3, 1e3 } };
    enum err result = ERR_OK;

    snprintf(row->note, sizeof(row->note),
             "bare: a copy, by the same threads, of the source's floats (%.1f MB) and of the cube's texels and CDFs "
             "that are written (%.1f MB)",
             1e-6 * (double)r.bytes[0], 1e-6 * (double)(r.bytes[1] + r.bytes[2]));
    for (int k = 0; k < 3; k++) {
        r.to[k] = mem_alloc(r.bytes[k], 1);
        result = r.to[k] ? result : ERR_NOMEM;
    }
    if (!result)
        result = bench_time(b, &pair, row);
    for (int k = 0; k < 3; k++)
        mem_free(r.to[k]);
    samples_finish(&r.samples);
    return result;
}
