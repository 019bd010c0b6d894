#include "image/codec/make_exr.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CHANNELS_MOST 16
#define CHUNKS_MOST 256 /* of a file whose rows are stored from the bottom up */

struct sink {
    uint8_t *bytes;
    size_t size;
};

static void must(exr_result_t r, const char *what)
{
    if (r == EXR_ERR_SUCCESS)
        return;
    fprintf(stderr, "make_exr: %s: %s\n", what, exr_get_default_error_message(r));
    exit(1);
}

static void *must_have(void *p)
{
    if (!p) {
        fprintf(stderr, "make_exr: out of memory\n");
        exit(1);
    }
    return p;
}

static int64_t sink_write(exr_const_context_t ctx, void *user, const void *buffer, uint64_t size, uint64_t offset,
                          exr_stream_error_func_ptr_t fail)
{
    struct sink *s = user;
    const size_t end = (size_t)(offset + size);

    (void)ctx;
    (void)fail;
    if (end > s->size) {
        s->bytes = must_have(realloc(s->bytes, end));
        memset(s->bytes + s->size, 0, end - s->size);
        s->size = end;
    }
    memcpy(s->bytes + offset, buffer, (size_t)size);
    return (int64_t)size;
}

float recipe_value(int c, int32_t x, int32_t y)
{
    return (float)((7 * x + 13 * y + 29 * c + x * y) % 256) / 16.0f;
}

static int count_channels(const struct exr_recipe *r)
{
    int n = 0;

    while (r->channels[n].name)
        n++;
    return n;
}

static void write_part_header(exr_context_t ctx, const struct exr_recipe *r, int number, bool has_deep)
{
    const exr_attr_box2i_t data = { .min = { .x = r->left, .y = r->top },
                                    .max = { .x = r->left + r->width - 1, .y = r->top + r->height - 1 } };
    const int32_t *d = r->display;
    const exr_attr_box2i_t display =
        d ? (exr_attr_box2i_t){ .min = { .x = d[0], .y = d[1] }, .max = { .x = d[2], .y = d[3] } } : data;
    const exr_attr_v2f_t centre = { .x = 0.0f, .y = 0.0f };
    const exr_storage_t storage = r->deep     ? EXR_STORAGE_DEEP_SCANLINE
                                  : r->tile_w ? EXR_STORAGE_TILED
                                              : EXR_STORAGE_SCANLINE;
    const int sampling = r->subsampling ? r->subsampling : 1;
    char name[64];
    int part = 0;

    if (r->name)
        snprintf(name, sizeof(name), "%s", r->name);
    else
        snprintf(name, sizeof(name), "part%d", number);
    must(exr_add_part(ctx, name, storage, &part), "part");
    must(exr_initialize_required_attr(ctx, part, &display, &data, r->aspect > 0.0f ? r->aspect : 1.0f, &centre, 1.0f,
                                      r->decreasing ? EXR_LINEORDER_DECREASING_Y : EXR_LINEORDER_INCREASING_Y,
                                      r->compression),
         "attributes");
    if (r->tile_w)
        must(exr_set_tile_descriptor(ctx, part, (uint32_t)r->tile_w, (uint32_t)r->tile_h, r->levels,
                                     EXR_TILE_ROUND_DOWN),
             "tiles");
    if (has_deep) /* one deep part, and each needs a version */
        must(exr_set_version(ctx, part, 1), "version");
    for (int c = 0; r->channels[c].name; c++)
        must(exr_add_channel(ctx, part, r->channels[c].name, r->channels[c].type, EXR_PERCEPTUALLY_LOGARITHMIC,
                             sampling, sampling),
             "channel");
    if (r->chromaticities) {
        const float *v = r->chromaticities;
        const exr_attr_chromaticities_t a = { v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7] };
        must(exr_attr_set_chromaticities(ctx, part, "chromaticities", &a), "chromaticities");
    }
    for (const struct made_attribute *a = r->more; a && a->name; a++)
        must(a->text ? exr_attr_set_string(ctx, part, a->name, a->text)
                     : exr_attr_set_float(ctx, part, a->name, a->number),
             a->name);
    if (r->envmap)
        must(exr_attr_set_envmap(ctx, part, "envmap", (exr_envmap_t)(r->envmap - 1)), "envmap");
}

/* Called between compressing and writing. A reader takes a chunk of the plain size for a plain one; the library's
 * writer leaves it compressed where it came out just as long, and where B44 came out longer. */
static exr_result_t store_plain(exr_encode_pipeline_t *pipe)
{
    if (pipe->compressed_buffer != pipe->packed_buffer && pipe->compressed_bytes >= pipe->packed_bytes) {
        memcpy(pipe->compressed_buffer, pipe->packed_buffer, pipe->packed_bytes);
        pipe->compressed_bytes = pipe->packed_bytes;
    }
    return EXR_ERR_SUCCESS;
}

/* Encodes one chunk, whose first texel is (x0, y0) counted from the window's corner, from planes of floats. */
static void write_chunk(exr_context_t ctx, int part, const struct exr_recipe *r, const exr_chunk_info_t *chunk,
                        int32_t x0, int32_t y0)
{
    exr_encode_pipeline_t pipe = EXR_ENCODE_PIPELINE_INITIALIZER;
    const size_t texels = (size_t)chunk->width * (size_t)chunk->height;
    float *planes[CHANNELS_MOST] = { 0 };

    must(exr_encoding_initialize(ctx, part, chunk, &pipe), "pipeline");
    for (int c = 0; c < pipe.channel_count; c++) {
        exr_coding_channel_info_t *info = &pipe.channels[c];
        planes[c] = must_have(malloc(texels * sizeof(float)));
        for (int32_t y = 0; y < chunk->height; y++) {
            for (int32_t x = 0; x < chunk->width; x++) {
                const float v = (r->value ? r->value : recipe_value)(c, x0 + x, y0 + y);
                const uint32_t whole = v > 0.0f ? (uint32_t)v : 0;
                float *const to = planes[c] + (size_t)y * (size_t)chunk->width + (size_t)x;
                memcpy(to, info->data_type == EXR_PIXEL_UINT ? (const void *)&whole : (const void *)&v, sizeof(*to));
            }
        }
        info->user_data_type = info->data_type == EXR_PIXEL_UINT ? EXR_PIXEL_UINT : EXR_PIXEL_FLOAT;
        info->user_bytes_per_element = sizeof(float);
        info->user_pixel_stride = sizeof(float);
        info->user_line_stride = chunk->width * (int32_t)sizeof(float);
        info->encode_from_ptr = (const uint8_t *)planes[c];
    }
    must(exr_encoding_choose_default_routines(ctx, part, &pipe), "routines");
    pipe.yield_until_ready_fn = store_plain;
    must(exr_encoding_run(ctx, part, &pipe), "chunk");
    must(exr_encoding_destroy(ctx, &pipe), "pipeline's end");
    for (int c = 0; c < CHANNELS_MOST; c++)
        free(planes[c]);
}

static void write_level(exr_context_t ctx, int part, const struct exr_recipe *r, int lx, int ly)
{
    int32_t w = 0, h = 0;
    exr_chunk_info_t chunk;

    must(exr_get_level_sizes(ctx, part, lx, ly, &w, &h), "level");
    for (int32_t y = 0; y < h; y += r->tile_h) {
        for (int32_t x = 0; x < w; x += r->tile_w) {
            must(exr_write_tile_chunk_info(ctx, part, x / r->tile_w, y / r->tile_h, lx, ly, &chunk), "tile");
            write_chunk(ctx, part, r, &chunk, x + 100 * lx, y + 100 * ly);
        }
    }
}

static void write_tiles(exr_context_t ctx, int part, const struct exr_recipe *r)
{
    int32_t across = 0, down = 0;

    must(exr_get_tile_levels(ctx, part, &across, &down), "levels");
    for (int ly = 0; ly < down; ly++)
        for (int lx = 0; lx < across; lx++)
            if (r->levels == EXR_TILE_RIPMAP_LEVELS || lx == ly)
                write_level(ctx, part, r, lx, ly);
}

static void write_scanlines(exr_context_t ctx, int part, const struct exr_recipe *r)
{
    int32_t lines = 0;
    exr_chunk_info_t chunk;

    must(exr_get_scanlines_per_chunk(ctx, part, &lines), "lines");
    for (int32_t y = 0; y < r->height; y += lines) {
        must(exr_write_scanline_chunk_info(ctx, part, r->top + y, &chunk), "scanline");
        write_chunk(ctx, part, r, &chunk, 0, y);
    }
}

/* One sample a texel, all zero, without compression. */
static void write_deep(exr_context_t ctx, int part, const struct exr_recipe *r)
{
    const size_t w = (size_t)r->width, size = w * 4 * (size_t)count_channels(r);
    uint32_t *counts = must_have(malloc(w * sizeof(*counts)));
    void *samples = must_have(calloc(size, 1));

    for (uint32_t x = 0; x < w; x++)
        counts[x] = x + 1;
    for (int32_t y = 0; y < r->height; y++)
        must(exr_write_deep_scanline_chunk(ctx, part, r->top + y, samples, size, size, counts, w * sizeof(*counts)),
             "deep scanline");
    free(samples);
    free(counts);
}

/* Chunks of a file of one part in the opposite order, which the library's writer does not do: its table of `count`
 * places, each of 8 bytes with the lowest first, ends where the first chunk begins. */
static void reverse_chunks(struct sink *s, size_t count)
{
    uint64_t at[CHUNKS_MOST], end = s->size;
    size_t table = 0, to = 0;
    uint8_t *old = must_have(malloc(s->size));

    memcpy(old, s->bytes, s->size);
    for (at[0] = 0; at[0] != table + 8 * count; table++)
        memcpy(at, old + table + 1, 8 * count);
    to = table + 8 * count;
    for (size_t i = count; i-- > 0; end = at[i]) {
        memcpy(s->bytes + to, old + at[i], (size_t)(end - at[i]));
        const uint64_t place = to;
        memcpy(s->bytes + table + 8 * i, &place, 8);
        to += (size_t)(end - at[i]);
    }
    free(old);
}

uint8_t *exr_make_parts(const struct exr_recipe *recipes, int parts, size_t *size)
{
    struct sink sink = { NULL, 0 };
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
    exr_context_t ctx = NULL;

    init.user_data = &sink;
    init.write_fn = sink_write;
    must(exr_start_write(&ctx, "memory", EXR_WRITE_FILE_DIRECTLY, &init), "start");
    bool has_deep = false;
    for (int p = 0; p < parts; p++)
        has_deep = has_deep || recipes[p].deep;
    for (int p = 0; p < parts; p++) {
        if (count_channels(&recipes[p]) > CHANNELS_MOST)
            must(EXR_ERR_ARGUMENT_OUT_OF_RANGE, "channels");
        write_part_header(ctx, &recipes[p], p, has_deep);
    }
    must(exr_write_header(ctx), "header");
    for (int p = 0; p < parts; p++) {
        if (recipes[p].deep)
            write_deep(ctx, p, &recipes[p]);
        else if (recipes[p].tile_w)
            write_tiles(ctx, p, &recipes[p]);
        else
            write_scanlines(ctx, p, &recipes[p]);
    }
    int32_t chunks = 0;
    must(exr_get_chunk_count(ctx, 0, &chunks), "chunks");
    must(exr_finish(&ctx), "end");
    if (recipes[0].decreasing && chunks <= CHUNKS_MOST)
        reverse_chunks(&sink, (size_t)chunks);
    *size = sink.size;
    return sink.bytes;
}

uint8_t *exr_make(const struct exr_recipe *recipe, size_t *size)
{
    return exr_make_parts(recipe, 1, size);
}
