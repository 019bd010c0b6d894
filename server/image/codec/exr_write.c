#include "image/codec/encode.h"

#include "base/file_store.h"
#include "base/half.h"
#include "base/mem.h"
#include "image/codec/exr_zip.h"

#include <assert.h>
#include <inttypes.h>
#include <omp.h>
#include <openexr.h>
#include <stdlib.h>
#include <string.h>

#define SIDE_MAX 65535                /* bounds memory */
#define FIRST_ROOM 65536              /* bytes */
#define CHUNKS_EACH 4                 /* packed by a thread before they are written */
#define SLOT_BYTES ((size_t)64 << 20) /* of packed chunks; with larger ones, one a thread */

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "values are written in the file's byte order");

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

/* Larger values would become infinite. */
static float clamp_to_half(float v)
{
    return v > HALF_MAX ? HALF_MAX : v < -HALF_MAX ? -HALF_MAX : v;
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

/* One chunk's lines as the file has them: line by line, each one channel after the other. */
static void gather_lines(const struct exr_desc *d, const struct planes *p, uint32_t first, uint32_t lines, uint8_t *to)
{
    for (uint32_t y = first; y < first + lines; y++)
        for (int c = 0; c < p->count; c++) {
            const struct exr_channel *plane = &p->at[c];
            const float *from = plane->values + (size_t)y * d->width * plane->stride;
            if (is_half(p, c))
                for (uint32_t x = 0; x < d->width; x++, to += sizeof(uint16_t)) {
                    const uint16_t half = half_round(clamp_to_half(from[(size_t)x * plane->stride]));
                    memcpy(to, &half, sizeof(half));
                }
            else
                for (uint32_t x = 0; x < d->width; x++, to += sizeof(float))
                    memcpy(to, &from[(size_t)x * plane->stride], sizeof(float));
        }
}

/* Chunks are packed several at a time, by all threads, and written in order. */
struct packed {
    uint8_t *bytes; /* room for a chunk */
    size_t size;
};

struct packing {
    const struct exr_desc *desc;
    const struct planes *planes;
    uint32_t lines;    /* of a chunk; the last one may have fewer */
    size_t line_bytes; /* unpacked */
    int workers;
    struct exr_deflater *deflaters; /* [workers] */
    int slots;                      /* chunks at a time */
    struct packed *slot;            /* [slots] */
};

static void packing_finish(struct packing *k)
{
    for (int i = 0; i < k->workers && k->deflaters; i++)
        exr_deflater_finish(&k->deflaters[i]);
    for (int i = 0; i < k->slots && k->slot; i++)
        mem_free(k->slot[i].bytes);
    mem_free(k->deflaters);
    mem_free(k->slot);
}

static enum err packing_init(struct packing *k, const struct exr_desc *d, const struct planes *p, uint32_t lines)
{
    *k = (struct packing){ .desc = d, .planes = p, .lines = lines };
    for (int c = 0; c < p->count; c++)
        k->line_bytes += d->width * (is_half(p, c) ? sizeof(uint16_t) : sizeof(float));
    const uint32_t chunks = (d->height + lines - 1) / lines;
    const size_t room = k->line_bytes * (d->height < lines ? d->height : lines);
    k->workers = omp_get_max_threads();
    k->slots = room * (size_t)(CHUNKS_EACH * k->workers) > SLOT_BYTES ? k->workers : CHUNKS_EACH * k->workers;
    k->slots = (uint32_t)k->slots < chunks ? k->slots : (int)chunks;
    k->workers = k->workers < k->slots ? k->workers : k->slots;
    k->deflaters = mem_alloc((size_t)k->workers, sizeof(*k->deflaters));
    k->slot = mem_alloc((size_t)k->slots, sizeof(*k->slot));
    bool all = k->deflaters && k->slot;
    for (int i = 0; i < k->workers && all; i++)
        all = !exr_deflater_init(&k->deflaters[i], room);
    for (int i = 0; i < k->slots && all; i++) {
        k->slot[i].bytes = mem_alloc_raw(room, 1);
        all = k->slot[i].bytes;
    }
    if (!all)
        packing_finish(k);
    return all ? ERR_OK : ERR_NOMEM;
}

static void pack_chunk(struct packing *k, int slot, uint32_t y)
{
    struct exr_deflater *z = &k->deflaters[omp_get_thread_num()];
    const uint32_t lines = k->desc->height - y < k->lines ? k->desc->height - y : k->lines;

    gather_lines(k->desc, k->planes, y, lines, z->plain);
    k->slot[slot].size = exr_zip_pack(z, k->line_bytes * lines, k->slot[slot].bytes);
}

/* The bytes do not depend on the number of threads: a chunk is packed by itself. */
static exr_result_t write_chunks(exr_context_t ctx, struct packing *k)
{
    const uint32_t step = k->lines * (uint32_t)k->slots;
    exr_result_t r = EXR_ERR_SUCCESS;

    for (uint32_t first = 0; first < k->desc->height && r == EXR_ERR_SUCCESS; first += step) {
        const uint32_t left = (k->desc->height - first + k->lines - 1) / k->lines;
        const int count = left < (uint32_t)k->slots ? (int)left : k->slots;
#pragma omp parallel for schedule(dynamic, 1) num_threads(k->workers)
        for (int i = 0; i < count; i++)
            pack_chunk(k, i, first + (uint32_t)i * k->lines);
        for (int i = 0; i < count && r == EXR_ERR_SUCCESS; i++)
            r = exr_write_scanline_chunk(ctx, 0, (int)(first + (uint32_t)i * k->lines), k->slot[i].bytes,
                                         k->slot[i].size);
    }
    return r;
}

static exr_result_t write_all(exr_context_t ctx, const struct exr_desc *d)
{
    struct planes p;
    struct packing k;
    int32_t lines = 0;

    find_planes(d, &p);
    exr_result_t r = write_header(ctx, d, &p);
    if (r == EXR_ERR_SUCCESS)
        r = exr_get_scanlines_per_chunk(ctx, 0, &lines);
    if (r != EXR_ERR_SUCCESS)
        return r;
    if (packing_init(&k, d, &p, (uint32_t)lines))
        return EXR_ERR_OUT_OF_MEMORY;
    r = write_chunks(ctx, &k);
    packing_finish(&k);
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
