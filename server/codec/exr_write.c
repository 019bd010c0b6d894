#include "codec/exr_write.h"

#include "base/file_store.h"
#include "base/mem.h"

#include <assert.h>
#include <inttypes.h>
#include <openexr.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define HALF_MAX 65504.0f
#define SIDE_MAX 65535
#define FIRST_ROOM 65536 /* bytes */

/* The library's output: one growing block. */
struct sink {
    uint8_t *bytes;
    size_t size, capacity;
    struct reason library_fault; /* the library's first message */
};

static enum err code_of(exr_result_t r)
{
    switch (r) {
    case EXR_ERR_SUCCESS: return ERR_OK;
    case EXR_ERR_OUT_OF_MEMORY: return ERR_NOMEM;
    case EXR_ERR_WRITE_IO: return ERR_NOMEM; /* sink_write fails only when out of memory */
    default: return ERR_RANGE;
    }
}

/* The sink of this thread. The error callback cannot ask the library for it, because the library already holds the
 * lock. Set while exr_encode runs. */
static _Thread_local struct sink *serving;

static void on_library_error(exr_const_context_t ctx, exr_result_t code, const char *text)
{
    (void)ctx;
    (void)code;
    if (serving && !serving->library_fault.text[0])
        (void)err_say(&serving->library_fault, ERR_FORMAT, "%s", text);
}

/* Writes at any offset: the library returns to fill in the chunk table. */
static int64_t sink_write(exr_const_context_t ctx, void *user, const void *buffer, uint64_t size, uint64_t offset,
                          exr_stream_error_func_ptr_t fail)
{
    struct sink *s = user;

    if (size > SIZE_MAX / 4 || offset > SIZE_MAX / 4)
        return fail(ctx, EXR_ERR_WRITE_IO, "%" PRIu64 " bytes at %" PRIu64 " exceed memory", size, offset), -1;
    const size_t end = (size_t)(offset + size);
    if (end > s->capacity) {
        size_t room = s->capacity ? s->capacity : FIRST_ROOM;
        while (room < end)
            room *= 2;
        uint8_t *p = mem_grow(s->bytes, s->size, room, 1);
        if (!p)
            return fail(ctx, EXR_ERR_WRITE_IO, "out of memory for %zu bytes", room), -1;
        s->bytes = p;
        s->capacity = room;
    }
    memcpy(s->bytes + offset, buffer, (size_t)size);
    if (end > s->size)
        s->size = end;
    return (int64_t)size;
}

/* All channels of a file, sorted by name, as the format requires. */
struct planes {
    struct exr_channel at[EXR_CHANNELS_MAX + 4];
    int count;
    bool half; /* those that are not `full` */
};

static int by_name(const void *a, const void *b)
{
    const struct exr_channel *p = a, *q = b;

    return strcmp(p->name, q->name);
}

static void find_planes(const struct exr_desc *d, struct planes *p)
{
    static const char *const colours[] = { "R", "G", "B", "A" };
    const uint32_t stride = d->alpha ? 4 : 3;

    assert(d->channel_count <= EXR_CHANNELS_MAX);
    p->count = 0;
    p->half = d->depth == EXR_HALF;
    for (uint32_t c = 0; c < stride; c++)
        p->at[p->count++] = (struct exr_channel){ colours[c], d->rgb + c, stride, false };
    for (size_t c = 0; c < d->channel_count; c++)
        p->at[p->count++] = d->channels[c];
    qsort(p->at, (size_t)p->count, sizeof(p->at[0]), by_name);
}

static bool is_half(const struct planes *p, int c)
{
    return p->half && !p->at[c].full;
}

/* Colours are perceived on a logarithmic scale; alpha, depths, normals and ids are not. */
static bool is_colour(const char *name)
{
    const char *dot = strrchr(name, '.'), *last = dot ? dot + 1 : name;

    return (strcmp(last, "R") == 0 || strcmp(last, "G") == 0 || strcmp(last, "B") == 0) &&
           strncmp(name, "Crypto", 6) != 0;
}

static exr_result_t write_header(exr_context_t ctx, const struct exr_desc *d, const struct planes *p)
{
    const exr_attr_chromaticities_t rec709 = { 0.64f, 0.33f, 0.30f, 0.60f, 0.15f, 0.06f, 0.3127f, 0.3290f };
    int part = 0;
    exr_result_t r = exr_add_part(ctx, "relight", EXR_STORAGE_SCANLINE, &part);

    if (r == EXR_ERR_SUCCESS)
        r = exr_initialize_required_attr_simple(ctx, part, (int32_t)d->width, (int32_t)d->height, EXR_COMPRESSION_ZIP);
    for (int c = 0; c < p->count && r == EXR_ERR_SUCCESS; c++)
        r = exr_add_channel(ctx, part, p->at[c].name, is_half(p, c) ? EXR_PIXEL_HALF : EXR_PIXEL_FLOAT,
                            is_colour(p->at[c].name) ? EXR_PERCEPTUALLY_LOGARITHMIC : EXR_PERCEPTUALLY_LINEAR, 1, 1);
    if (r == EXR_ERR_SUCCESS)
        r = exr_attr_set_chromaticities(ctx, part, "chromaticities", &rec709);
    for (size_t i = 0; i < d->attribute_count && r == EXR_ERR_SUCCESS; i++)
        r = exr_attr_set_string(ctx, part, d->attributes[i].name, d->attributes[i].value);
    return r == EXR_ERR_SUCCESS ? exr_write_header(ctx) : r;
}

/* A channel's rows of one chunk, side by side, clamped to HALF_MAX: larger values would become infinite. */
static const float *clamp_rows(const struct exr_channel *c, const struct exr_desc *d, uint32_t y, uint32_t height,
                               float *scratch)
{
    const size_t first = (size_t)y * d->width, count = (size_t)height * d->width;

    for (size_t i = 0; i < count; i++) {
        const float v = c->values[(first + i) * c->stride];
        scratch[i] = v > HALF_MAX ? HALF_MAX : v < -HALF_MAX ? -HALF_MAX : v;
    }
    return scratch;
}

/* Runs between compressing and writing. ZIP may produce exactly as many bytes as it got. Readers take a chunk of that
 * size as uncompressed, but OpenEXRCore 3.1 would store the compressed bytes. */
static exr_result_t store_plain(exr_encode_pipeline_t *pipe)
{
    if (pipe->compressed_buffer != pipe->packed_buffer && pipe->compressed_bytes >= pipe->packed_bytes) {
        memcpy(pipe->compressed_buffer, pipe->packed_buffer, pipe->packed_bytes);
        pipe->compressed_bytes = pipe->packed_bytes;
    }
    return EXR_ERR_SUCCESS;
}

/* scratch: with half floats, the rows of one chunk for each channel. */
static exr_result_t write_chunk(exr_context_t ctx, const struct exr_desc *d, const struct planes *p, uint32_t y,
                                float *scratch, exr_encode_pipeline_t *pipe)
{
    exr_chunk_info_t chunk;
    exr_result_t r = exr_write_scanline_chunk_info(ctx, 0, (int)y, &chunk);

    if (r == EXR_ERR_SUCCESS)
        r = y == 0 ? exr_encoding_initialize(ctx, 0, &chunk, pipe) : exr_encoding_update(ctx, 0, &chunk, pipe);
    if (r != EXR_ERR_SUCCESS)
        return r;
    const size_t values = (size_t)chunk.height * d->width;
    for (int c = 0; c < p->count; c++) {
        exr_coding_channel_info_t *channel = &pipe->channels[c];
        const struct exr_channel *plane = &p->at[c];
        const uint32_t stride = is_half(p, c) ? 1 : plane->stride;
        const float *from = is_half(p, c)
                                ? clamp_rows(plane, d, y, (uint32_t)chunk.height, scratch + (size_t)c * values)
                                : plane->values + (size_t)y * d->width * stride;
        channel->user_data_type = EXR_PIXEL_FLOAT;
        channel->user_bytes_per_element = sizeof(float);
        channel->user_pixel_stride = (int32_t)(stride * sizeof(float));
        channel->user_line_stride = channel->user_pixel_stride * (int32_t)d->width;
        channel->encode_from_ptr = (const uint8_t *)from;
    }
    if (y == 0)
        r = exr_encoding_choose_default_routines(ctx, 0, pipe);
    pipe->yield_until_ready_fn = store_plain;
    return r == EXR_ERR_SUCCESS ? exr_encoding_run(ctx, 0, pipe) : r;
}

static exr_result_t write_chunks(exr_context_t ctx, const struct exr_desc *d, const struct planes *p, float *scratch,
                                 uint32_t lines)
{
    exr_encode_pipeline_t pipe = EXR_ENCODE_PIPELINE_INITIALIZER;
    exr_result_t r = EXR_ERR_SUCCESS;

    for (uint32_t y = 0; y < d->height && r == EXR_ERR_SUCCESS; y += lines)
        r = write_chunk(ctx, d, p, y, scratch, &pipe);
    const exr_result_t closed = exr_encoding_destroy(ctx, &pipe);
    return r == EXR_ERR_SUCCESS ? closed : r;
}

static exr_result_t write_all(exr_context_t ctx, const struct exr_desc *d)
{
    struct planes p;
    int32_t lines = 0;

    find_planes(d, &p);
    exr_result_t r = write_header(ctx, d, &p);
    if (r == EXR_ERR_SUCCESS)
        r = exr_get_scanlines_per_chunk(ctx, 0, &lines);
    if (r != EXR_ERR_SUCCESS)
        return r;
    float *scratch = mem_alloc(p.half ? (size_t)lines * d->width * (size_t)p.count : 0, sizeof(float));
    if (!scratch)
        return EXR_ERR_OUT_OF_MEMORY;
    r = write_chunks(ctx, d, &p, scratch, (uint32_t)lines);
    mem_free(scratch);
    return r;
}

enum err exr_encode(const struct exr_desc *d, uint8_t **bytes, size_t *size, struct reason *why)
{
    struct sink sink = { 0 };
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
    exr_context_t ctx = NULL;

    *bytes = NULL;
    *size = 0;
    if (d->width < 1 || d->height < 1 || d->width > SIDE_MAX || d->height > SIDE_MAX)
        return err_say(why, ERR_RANGE, "EXR: %" PRIu32 "x%" PRIu32 " : each side must be 1 to %d", d->width, d->height,
                       SIDE_MAX);
    init.error_handler_fn = on_library_error;
    init.user_data = &sink;
    init.write_fn = sink_write;
    serving = &sink;
    exr_result_t r = exr_start_write(&ctx, "memory", EXR_WRITE_FILE_DIRECTLY, &init);
    if (r == EXR_ERR_SUCCESS)
        r = write_all(ctx, d);
    if (ctx) {
        const exr_result_t closed = exr_finish(&ctx); /* writes the chunk table */
        r = r == EXR_ERR_SUCCESS ? closed : r;
    }
    serving = NULL;
    if (r != EXR_ERR_SUCCESS) {
        mem_free(sink.bytes);
        return err_say(why, code_of(r), "EXR: %s",
                       sink.library_fault.text[0] ? sink.library_fault.text : exr_get_default_error_message(r));
    }
    *bytes = sink.bytes;
    *size = sink.size;
    return ERR_OK;
}

enum err exr_write(const struct exr_desc *d, const char *path, struct reason *why)
{
    uint8_t *bytes = NULL;
    size_t size = 0;

    enum err e = exr_encode(d, &bytes, &size, why);
    if (!e)
        e = file_store(path, bytes, size, why);
    mem_free(bytes);
    return e;
}
