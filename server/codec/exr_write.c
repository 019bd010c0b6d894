#include "codec/exr_write.h"

#include "base/file_store.h"
#include "base/mem.h"

#include <inttypes.h>
#include <openexr.h>
#include <stdio.h>
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

static exr_result_t write_header(exr_context_t ctx, const struct exr_desc *d)
{
    const exr_pixel_type_t type = d->depth == EXR_HALF ? EXR_PIXEL_HALF : EXR_PIXEL_FLOAT;
    const exr_attr_chromaticities_t rec709 = { 0.64f, 0.33f, 0.30f, 0.60f, 0.15f, 0.06f, 0.3127f, 0.3290f };
    static const char *const channels[] = { "A", "B", "G", "R" }; /* sorted, as the format requires */
    int part = 0;
    exr_result_t r = exr_add_part(ctx, "relight", EXR_STORAGE_SCANLINE, &part);

    if (r == EXR_ERR_SUCCESS)
        r = exr_initialize_required_attr_simple(ctx, part, (int32_t)d->width, (int32_t)d->height, EXR_COMPRESSION_ZIP);
    for (int i = d->alpha ? 0 : 1; i < 4 && r == EXR_ERR_SUCCESS; i++)
        r = exr_add_channel(ctx, part, channels[i], type, i ? EXR_PERCEPTUALLY_LOGARITHMIC : EXR_PERCEPTUALLY_LINEAR, 1,
                            1);
    if (r == EXR_ERR_SUCCESS)
        r = exr_attr_set_chromaticities(ctx, part, "chromaticities", &rec709);
    for (size_t i = 0; i < d->attribute_count && r == EXR_ERR_SUCCESS; i++)
        r = exr_attr_set_string(ctx, part, d->attributes[i].name, d->attributes[i].value);
    return r == EXR_ERR_SUCCESS ? exr_write_header(ctx) : r;
}

static uint32_t channels_of(const struct exr_desc *d)
{
    return d->alpha ? 4 : 3;
}

/* The rows of one chunk for the encoder. Values for half floats are clamped to HALF_MAX, which would otherwise become
 * infinite. */
static const float *rows(const struct exr_desc *d, uint32_t y, uint32_t height, float *scratch)
{
    const size_t row = (size_t)d->width * channels_of(d), count = height * row;
    const float *from = d->rgb + y * row;

    if (d->depth == EXR_FLOAT)
        return from;
    for (size_t i = 0; i < count; i++)
        scratch[i] = from[i] > HALF_MAX ? HALF_MAX : from[i] < -HALF_MAX ? -HALF_MAX : from[i];
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

static exr_result_t write_chunk(exr_context_t ctx, const struct exr_desc *d, uint32_t y, float *scratch,
                                exr_encode_pipeline_t *pipe)
{
    exr_chunk_info_t chunk;
    exr_result_t r = exr_write_scanline_chunk_info(ctx, 0, (int)y, &chunk);

    if (r == EXR_ERR_SUCCESS)
        r = y == 0 ? exr_encoding_initialize(ctx, 0, &chunk, pipe) : exr_encoding_update(ctx, 0, &chunk, pipe);
    if (r != EXR_ERR_SUCCESS)
        return r;
    const uint8_t *from = (const uint8_t *)rows(d, y, (uint32_t)chunk.height, scratch);
    for (int16_t c = 0; c < pipe->channel_count; c++) {
        exr_coding_channel_info_t *channel = &pipe->channels[c];
        channel->user_data_type = EXR_PIXEL_FLOAT;
        channel->user_bytes_per_element = sizeof(float);
        channel->user_pixel_stride = (int32_t)(channels_of(d) * sizeof(float));
        channel->user_line_stride = channel->user_pixel_stride * (int32_t)d->width;
        channel->encode_from_ptr = from + sizeof(float) * (channels_of(d) - 1u - (uint32_t)c); /* (A,) B, G, R */
    }
    if (y == 0)
        r = exr_encoding_choose_default_routines(ctx, 0, pipe);
    pipe->yield_until_ready_fn = store_plain;
    return r == EXR_ERR_SUCCESS ? exr_encoding_run(ctx, 0, pipe) : r;
}

static exr_result_t write_chunks(exr_context_t ctx, const struct exr_desc *d, float *scratch, uint32_t lines)
{
    exr_encode_pipeline_t pipe = EXR_ENCODE_PIPELINE_INITIALIZER;
    exr_result_t r = EXR_ERR_SUCCESS;

    for (uint32_t y = 0; y < d->height && r == EXR_ERR_SUCCESS; y += lines)
        r = write_chunk(ctx, d, y, scratch, &pipe);
    const exr_result_t closed = exr_encoding_destroy(ctx, &pipe);
    return r == EXR_ERR_SUCCESS ? closed : r;
}

static exr_result_t write_all(exr_context_t ctx, const struct exr_desc *d)
{
    int32_t lines = 0;
    exr_result_t r = write_header(ctx, d);

    if (r == EXR_ERR_SUCCESS)
        r = exr_get_scanlines_per_chunk(ctx, 0, &lines);
    if (r != EXR_ERR_SUCCESS)
        return r;
    float *scratch = mem_alloc(d->depth == EXR_HALF ? (size_t)lines * d->width * channels_of(d) : 0, sizeof(float));
    if (!scratch)
        return EXR_ERR_OUT_OF_MEMORY;
    r = write_chunks(ctx, d, scratch, (uint32_t)lines);
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
