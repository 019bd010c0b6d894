#include "image/codec/exr_file.h"

#include "base/half.h"
#include "image/codec/exr_zip.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "texels are read in the file's byte order");

/* Buffers reused from chunk to chunk. The library reads and decompresses chunks; the last step, which distributes the
 * channels, is done here, because the library's own mishandles images where one channel serves as all three, and is
 * slower. */
struct reader {
    struct exr_file *x;
    struct image *im;
    exr_decode_pipeline_t pipe;
    bool ready;
    exr_result_t (*decompress)(exr_decode_pipeline_t *); /* NULL: uncompressed */
    struct exr_zip zip;
};

/* The rectangle of the image that a chunk must fill, and its name in messages. */
struct place {
    uint32_t left, top, width, height;
    char name[64];
};

static void spread_halves(const uint8_t *from, uint32_t count, float *to)
{
    for (uint32_t i = 0; i < count; i++) {
        uint16_t half;
        memcpy(&half, from + 2 * (size_t)i, sizeof(half));
        to[3 * (size_t)i] = half_widen(half);
    }
}

static void spread_floats(const uint8_t *from, uint32_t count, float *to)
{
    for (uint32_t i = 0; i < count; i++)
        memcpy(to + 3 * (size_t)i, from + 4 * (size_t)i, sizeof(*to));
}

/* Copies the chunk's rows, each one channel after the other, to every third float of the image. */
static void spread_chunk(const struct reader *r, const struct place *p)
{
    const struct exr_file *x = r->x;
    const uint8_t *row = r->pipe.unpacked_buffer;

    for (uint32_t y = 0; y < p->height; y++, row += x->texel_bytes * p->width) {
        float *to = r->im->rgb + 3 * ((size_t)(p->top + y) * r->im->width + p->left);
        for (int i = 0; i < 3; i++) {
            const struct exr_source *s = &x->source[i];
            (s->half ? spread_halves : spread_floats)(row + s->skip * p->width, p->width, to + i);
        }
    }
}

/* Replaces the library's decompressor. */
static exr_result_t unpack_zip(exr_decode_pipeline_t *pipe)
{
    struct reader *r = pipe->decoding_user_data;
    const char *fault = exr_zip_unpack(&r->zip, pipe->packed_buffer, pipe->chunk.packed_size, pipe->unpacked_buffer,
                                       pipe->chunk.unpacked_size);
    if (!fault)
        return EXR_ERR_SUCCESS;
    (void)err_say(&r->x->library_fault, ERR_FORMAT, "ZIP: %s", fault);
    return fault == exr_zip_no_memory ? EXR_ERR_OUT_OF_MEMORY : EXR_ERR_CORRUPT_CHUNK;
}

static exr_result_t unpack(struct reader *r, const exr_chunk_info_t *chunk)
{
    const struct exr_file *x = r->x;
    exr_decode_pipeline_t *pipe = &r->pipe;
    exr_result_t e;

    if (r->ready) {
        e = exr_decoding_update(x->context, x->part, chunk, pipe);
    } else {
        /* with no output pointers set, this only selects the read and decompress functions */
        e = exr_decoding_initialize(x->context, x->part, chunk, pipe);
        if (e == EXR_ERR_SUCCESS)
            e = exr_decoding_choose_default_routines(x->context, x->part, pipe);
        pipe->unpack_and_convert_fn = NULL;
        pipe->decoding_user_data = r;
        const bool zip = x->compression == EXR_COMPRESSION_ZIP || x->compression == EXR_COMPRESSION_ZIPS;
        r->decompress = zip ? unpack_zip : pipe->decompress_fn; /* NULL if the file is uncompressed */
        r->ready = e == EXR_ERR_SUCCESS;
    }
    if (e != EXR_ERR_SUCCESS)
        return e;
    /* A chunk that would not shrink is stored uncompressed; the library does not handle that for B44. */
    pipe->decompress_fn = chunk->packed_size == chunk->unpacked_size ? NULL : r->decompress;
    e = exr_decoding_run(x->context, x->part, pipe);
    /* The library's decompressors report truncated input as out of memory. */
    if (e == EXR_ERR_OUT_OF_MEMORY && r->decompress != unpack_zip && pipe->packed_buffer && pipe->unpacked_buffer)
        e = EXR_ERR_CORRUPT_CHUNK;
    return e;
}

/* `found` is the library's result for the chunk's header. */
static enum err read_chunk(struct reader *r, exr_result_t found, const exr_chunk_info_t *chunk, const struct place *p)
{
    struct exr_file *x = r->x;
    char where[96];

    if (found != EXR_ERR_SUCCESS)
        return exr_file_say(x, found, p->name);
    if ((uint32_t)chunk->width != p->width || (uint32_t)chunk->height != p->height ||
        chunk->unpacked_size != (uint64_t)p->width * p->height * x->texel_bytes)
        return err_say(x->why, ERR_FORMAT, "%s: %s: a chunk of %dx%d texels where %ux%u are expected", x->name, p->name,
                       chunk->width, chunk->height, p->width, p->height);
    if (!exr_file_plausible(x, chunk->packed_size, chunk->unpacked_size) ||
        (x->compression == EXR_COMPRESSION_NONE && chunk->packed_size != chunk->unpacked_size))
        return err_say(x->why, ERR_FORMAT, "%s: %s, byte %" PRIu64 ": %" PRIu64 " bytes cannot hold %ux%u texels",
                       x->name, p->name, chunk->data_offset, chunk->packed_size, p->width, p->height);
    const exr_result_t e = unpack(r, chunk);
    if (e != EXR_ERR_SUCCESS) {
        snprintf(where, sizeof(where), "%s, byte %" PRIu64, p->name, chunk->data_offset);
        return exr_file_say(x, e, where);
    }
    spread_chunk(r, p);
    return ERR_OK;
}

/* Sanitises finished rows while they are still in the cache. */
static void finish_rows(const struct reader *r, uint32_t top, uint32_t rows)
{
    image_sanitise_texels(r->im->rgb + 3 * (size_t)top * r->im->width, (size_t)rows * r->im->width,
                          r->x->converts ? r->x->to_rec709 : NULL, &r->im->faults);
}

static uint32_t least(uint32_t a, uint32_t b)
{
    return a < b ? a : b;
}

static enum err read_scanlines(struct reader *r)
{
    struct exr_file *x = r->x;
    struct place p = { .width = x->width };
    exr_chunk_info_t chunk;
    int32_t lines = 0;
    const exr_result_t got = exr_get_scanlines_per_chunk(x->context, x->part, &lines);

    if (got != EXR_ERR_SUCCESS)
        return exr_file_say(x, got, "header");
    if (lines < 1) /* a scan-line file that declares tiles */
        return err_say(x->why, ERR_FORMAT, "%s: header: chunks of %d scanlines", x->name, lines);
    for (; p.top < x->height; p.top += p.height) {
        p.height = least(x->height - p.top, (uint32_t)lines);
        snprintf(p.name, sizeof(p.name), "scanline %d", x->top + (int32_t)p.top);
        const exr_result_t found = exr_read_scanline_chunk_info(x->context, x->part, x->top + (int32_t)p.top, &chunk);
        const enum err e = read_chunk(r, found, &chunk, &p);
        if (e)
            return e;
        finish_rows(r, p.top, p.height);
    }
    return ERR_OK;
}

static enum err read_tiles(struct reader *r)
{
    struct exr_file *x = r->x;
    struct place p = { .top = 0 };
    exr_chunk_info_t chunk;
    int32_t w = 0, h = 0;
    const exr_result_t got = exr_get_tile_sizes(x->context, x->part, 0, 0, &w, &h);

    if (got != EXR_ERR_SUCCESS)
        return exr_file_say(x, got, "header");
    if (w < 1 || h < 1)
        return err_say(x->why, ERR_FORMAT, "%s: header: tiles of %dx%d texels", x->name, w, h);
    for (int row = 0; p.top < x->height; p.top += p.height, row++) {
        p.height = least(x->height - p.top, (uint32_t)h);
        p.left = 0;
        for (int column = 0; p.left < x->width; p.left += p.width, column++) {
            p.width = least(x->width - p.left, (uint32_t)w);
            snprintf(p.name, sizeof(p.name), "tile %d, %d", column, row);
            const exr_result_t found = exr_read_tile_chunk_info(x->context, x->part, column, row, 0, 0, &chunk);
            const enum err e = read_chunk(r, found, &chunk, &p);
            if (e)
                return e;
        }
        finish_rows(r, p.top, p.height);
    }
    return ERR_OK;
}

enum err exr_chunks_read(struct exr_file *x, struct image *im)
{
    struct reader r = { .x = x, .im = im, .zip = { .scratch = im->scratch, .inflater = &im->inflater } };

    x->library_fault.text[0] = '\0';
    const enum err e = x->tiled ? read_tiles(&r) : read_scanlines(&r);
    exr_decoding_destroy(x->context, &r.pipe);
    exr_zip_finish(&r.zip);
    return e;
}
