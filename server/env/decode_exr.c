#include "decode.h"

#include "colour.h"
#include "mem.h"

#include <assert.h>
#include <inttypes.h>
#include <openexr.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

#define CHANNELS_MOST 1024           /* the library counts them in 16 bits */
#define BLOCK_MOST ((size_t)1 << 30) /* bytes that the library may take at once */
#define SAME_COLOUR 1e-4f            /* of chromaticities: equal for what floats in a header are worth */
#define TEXEL ((int32_t)(3 * sizeof(float)))

struct exr {
    const uint8_t *bytes;
    size_t size;
    const char *name;
    struct reason *why;

    exr_context_t file;
    struct reason said; /* the library's own first complaint since it was last cleared */

    int part;
    bool tiled;
    exr_compression_t compression;
    int channel[3]; /* places of R, G, B in the part's list of channels; grey: Y three times */
    uint32_t width, height;
    int32_t left, top;    /* of the data window */
    uint64_t texel_bytes; /* of all channels, unpacked */
    bool converts;
    float to_rec709[9];

    exr_decode_pipeline_t pipe;
    bool pipe_ready;
    exr_result_t (*decompress)(exr_decode_pipeline_t *); /* what the library chose; NULL: nothing to undo */
};

static const char *const compression_names[] = {
    "no", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB",
};

/* How many bytes one packed byte can stand for at most, rounded up. RLE: a run of 128 in 2. ZIP: deflate's 1032. PIZ:
 * 255 values of 2 bytes in a Huffman code of 9 bits. PXR24: deflate's, and floats lose one byte of four. B44A: 32
 * bytes in 3. DWA: 64 half floats come to one coefficient and one end mark, both deflated. */
static const uint64_t compression_ratios[] = { 1, 64, 1032, 1032, 454, 1376, 11, 11, 65536, 65536 };

/* As pread: what there is, and less at the end; the library itself says where that is too little. */
static int64_t read_bytes(exr_const_context_t ctx, void *user, void *out, uint64_t count, uint64_t offset,
                          exr_stream_error_func_ptr_t fail)
{
    const struct exr *x = user;

    (void)ctx;
    (void)fail;
    if (offset >= x->size)
        return 0;
    if (count > x->size - offset)
        count = x->size - offset;
    memcpy(out, x->bytes + offset, (size_t)count);
    return (int64_t)count;
}

static int64_t count_bytes(exr_const_context_t ctx, void *user)
{
    (void)ctx;
    return (int64_t)((const struct exr *)user)->size;
}

static void hear(exr_const_context_t ctx, exr_result_t code, const char *text)
{
    void *user = NULL;

    (void)code;
    if (exr_get_user_data(ctx, &user) != EXR_ERR_SUCCESS || !user)
        return;
    struct exr *x = user;
    if (!x->said.text[0])
        decode_plain(text, strlen(text), x->said.text, sizeof(x->said.text));
}

/* Zeroed, so that a chunk that unpacks to less than it claims shows black and not another picture's remains. */
static void *take_block(size_t bytes)
{
    return bytes > BLOCK_MOST ? NULL : mem_alloc(bytes, 1);
}

/* The fault at `where`, in the library's words or, where it had none, in those for its code. */
static enum err say_result(struct exr *x, exr_result_t r, const char *where)
{
    const char *text = x->said.text[0] ? x->said.text : exr_get_default_error_message(r);

    return err_say(x->why, r == EXR_ERR_OUT_OF_MEMORY ? ERR_NOMEM : ERR_FORMAT, "%s: %s: %s", x->name, where, text);
}

/* The library's decompressors call it a want of memory when their input ends early; it is one only if a buffer is
 * missing. */
static exr_result_t true_result(const struct exr *x, exr_result_t r)
{
    if (r == EXR_ERR_OUT_OF_MEMORY && x->pipe.packed_buffer && x->pipe.unpacked_buffer)
        return EXR_ERR_CORRUPT_CHUNK;
    return r;
}

static enum err open_header(struct exr *x)
{
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;

    init.error_handler_fn = hear;
    init.alloc_fn = take_block;
    init.free_fn = mem_free;
    init.user_data = x;
    init.read_fn = read_bytes;
    init.size_fn = count_bytes;
    /* Strict: a header with a fault is refused, not mended. No table rebuilt: who left it out did not finish writing.
     */
    init.flags = EXR_CONTEXT_FLAG_STRICT_HEADER | EXR_CONTEXT_FLAG_DISABLE_CHUNK_RECONSTRUCTION;
    const exr_result_t r = exr_start_read(&x->file, x->name, &init);
    return r == EXR_ERR_SUCCESS ? ERR_OK : say_result(x, r, "header");
}

/* The channel called layer + name, or -1. `layer` need not end in NUL. */
static int find_channel(const exr_attr_chlist_t *list, const char *layer, size_t layer_length, const char *name)
{
    for (int c = 0; c < list->num_channels; c++) {
        const char *s = list->entries[c].name.str;
        if (strncmp(s, layer, layer_length) == 0 && strcmp(s + layer_length, name) == 0)
            return c;
    }
    return -1;
}

static bool find_rgb(const exr_attr_chlist_t *list, const char *layer, size_t layer_length, int out[3])
{
    static const char *const names[] = { "R", "G", "B" };

    for (int i = 0; i < 3; i++) {
        out[i] = find_channel(list, layer, layer_length, names[i]);
        if (out[i] < 0)
            return false;
    }
    return true;
}

/* R, G, B; else Y; else the first layer that has R, G and B. */
static enum err choose_channels(struct exr *x, const exr_attr_chlist_t *list)
{
    if (find_rgb(list, "", 0, x->channel))
        return ERR_OK;
    const int y = find_channel(list, "", 0, "Y");
    if (y >= 0) {
        if (find_channel(list, "", 0, "RY") >= 0 || find_channel(list, "", 0, "BY") >= 0)
            return err_say(x->why, ERR_UNSUPPORTED, "%s: header: luminance with chroma (Y, RY, BY) is not read",
                           x->name);
        x->channel[0] = x->channel[1] = x->channel[2] = y;
        return ERR_OK;
    }
    for (int c = 0; c < list->num_channels; c++) {
        const char *name = list->entries[c].name.str;
        const size_t length = strlen(name);
        if (length > 2 && strcmp(name + length - 2, ".R") == 0 && find_rgb(list, name, length - 1, x->channel))
            return ERR_OK;
    }
    return err_say(x->why, ERR_UNSUPPORTED, "%s: header: no channels R, G, B and no Y", x->name);
}

/* Any subsampled channel is refused, used or not: its part's chunks are counted by rules of their own. */
static enum err check_channels(struct exr *x, const exr_attr_chlist_t *list)
{
    char text[32];

    x->texel_bytes = 0;
    for (int c = 0; c < list->num_channels; c++) {
        const exr_attr_chlist_entry_t *e = &list->entries[c];
        x->texel_bytes += e->pixel_type == EXR_PIXEL_HALF ? 2 : 4;
        if (e->x_sampling != 1 || e->y_sampling != 1)
            return err_say(x->why, ERR_UNSUPPORTED, "%s: header: channel %s is subsampled %dx%d", x->name,
                           decode_plain(e->name.str, strlen(e->name.str), text, sizeof(text)), e->x_sampling,
                           e->y_sampling);
    }
    for (int i = 0; i < 3; i++) {
        const exr_attr_chlist_entry_t *e = &list->entries[x->channel[i]];
        if (e->pixel_type != EXR_PIXEL_HALF && e->pixel_type != EXR_PIXEL_FLOAT)
            return err_say(x->why, ERR_UNSUPPORTED, "%s: header: channel %s holds integers", x->name,
                           decode_plain(e->name.str, strlen(e->name.str), text, sizeof(text)));
    }
    return ERR_OK;
}

static enum err try_part(struct exr *x, int part)
{
    exr_storage_t storage = EXR_STORAGE_LAST_TYPE;
    const exr_attr_chlist_t *list = NULL;
    exr_result_t r = exr_get_storage(x->file, part, &storage);

    if (r == EXR_ERR_SUCCESS)
        r = exr_get_channels(x->file, part, &list);
    if (r == EXR_ERR_SUCCESS)
        r = exr_get_compression(x->file, part, &x->compression);
    if (r != EXR_ERR_SUCCESS)
        return say_result(x, r, "header");
    if (storage != EXR_STORAGE_SCANLINE && storage != EXR_STORAGE_TILED)
        return err_say(x->why, ERR_UNSUPPORTED, "%s: header: deep pictures are not read", x->name);
    if (list->num_channels < 1 || list->num_channels > CHANNELS_MOST)
        return err_say(x->why, ERR_RANGE, "%s: header: %d channels, 1 to %d are read", x->name, list->num_channels,
                       CHANNELS_MOST);
    if ((int)x->compression < 0 || x->compression >= EXR_COMPRESSION_LAST_TYPE)
        return err_say(x->why, ERR_UNSUPPORTED, "%s: header: compression %d is unknown", x->name, (int)x->compression);
    if (x->compression == EXR_COMPRESSION_DWAA || x->compression == EXR_COMPRESSION_DWAB)
        return err_say(x->why, ERR_UNSUPPORTED, "%s: header: %s compression is not read, ZIP and PIZ are", x->name,
                       compression_names[x->compression]);
    x->part = part;
    x->tiled = storage == EXR_STORAGE_TILED;
    const enum err e = choose_channels(x, list);
    return e ? e : check_channels(x, list);
}

/* The first part that can be read; when there is none, what is wrong with the first. */
static enum err choose_part(struct exr *x)
{
    int count = 0;
    struct reason *const why = x->why;
    struct reason ignored = { "" };
    const exr_result_t r = exr_get_count(x->file, &count);

    if (r != EXR_ERR_SUCCESS || count < 1)
        return say_result(x, r, "header");
    const enum err first = try_part(x, 0);
    enum err e = first;
    x->why = &ignored;
    for (int part = 1; part < count && e; part++)
        e = try_part(x, part);
    x->why = why;
    return e ? first : ERR_OK;
}

/* The window must be within the limits, and such that the file could hold it: each chunk has a place in the table and
 * eight bytes of its own, and no compression gives more than its ratio. */
static enum err check_size(struct exr *x)
{
    exr_attr_box2i_t w;
    int32_t chunks = 0;
    exr_result_t r = exr_get_data_window(x->file, x->part, &w);

    if (r == EXR_ERR_SUCCESS)
        r = exr_get_chunk_count(x->file, x->part, &chunks);
    if (r != EXR_ERR_SUCCESS)
        return say_result(x, r, "header");
    const int64_t width = (int64_t)w.max.x - w.min.x + 1, height = (int64_t)w.max.y - w.min.y + 1;
    if (width < 1 || height < 1)
        return err_say(x->why, ERR_FORMAT, "%s: header: the data window is empty", x->name);
    if (width > IMAGE_MAX_SIDE || height > IMAGE_MAX_SIDE || (uint64_t)(width * height) > IMAGE_MAX_TEXELS)
        return err_say(x->why, ERR_RANGE,
                       "%s: header: a picture of %" PRId64 "x%" PRId64
                       " texels is too large, at most %d a side and %zu in all are read",
                       x->name, width, height, IMAGE_MAX_SIDE, IMAGE_MAX_TEXELS);
    if (chunks < 1 || (uint64_t)chunks > x->size / 16 ||
        (uint64_t)(width * height) * x->texel_bytes > x->size * compression_ratios[x->compression])
        return err_say(x->why, ERR_FORMAT,
                       "%s: header: %" PRId64 "x%" PRId64
                       " texels with %s compression cannot be in a file of %zu bytes",
                       x->name, width, height, compression_names[x->compression], x->size);
    x->width = (uint32_t)width;
    x->height = (uint32_t)height;
    x->left = w.min.x;
    x->top = w.min.y;
    return ERR_OK;
}

static enum err take_colour(struct exr *x)
{
    exr_attr_chromaticities_t a;
    double m[9];

    if (exr_attr_get_chromaticities(x->file, x->part, "chromaticities", &a) != EXR_ERR_SUCCESS)
        return ERR_OK;
    const struct chromaticities c = {
        { a.red_x, a.red_y }, { a.green_x, a.green_y }, { a.blue_x, a.blue_y }, { a.white_x, a.white_y }
    };
    if (colour_same(&c, &colour_rec709, SAME_COLOUR))
        return ERR_OK;
    if (colour_to_rec709(&c, m))
        return err_say(x->why, ERR_FORMAT, "%s: header: chromaticities span no space of colours", x->name);
    for (int i = 0; i < 9; i++)
        x->to_rec709[i] = (float)m[i];
    x->converts = x->channel[0] != x->channel[1]; /* grey is white's, and white stays white */
    return ERR_OK;
}

static enum layout layout_of(const struct exr *x)
{
    exr_envmap_t map;

    if (exr_attr_get_envmap(x->file, x->part, "envmap", &map) != EXR_ERR_SUCCESS)
        return LAYOUT_AUTO;
    return map == EXR_ENVMAP_LATLONG ? LAYOUT_LATLONG : map == EXR_ENVMAP_CUBE ? LAYOUT_CUBE : LAYOUT_AUTO;
}

/* Where the library puts the chunk's channels: straight into the picture, every third float. */
static exr_result_t aim(struct exr *x, const exr_chunk_info_t *chunk, float *to)
{
    exr_result_t r;

    if (x->pipe_ready)
        r = exr_decoding_update(x->file, x->part, chunk, &x->pipe);
    else
        r = exr_decoding_initialize(x->file, x->part, chunk, &x->pipe);
    if (r != EXR_ERR_SUCCESS)
        return r;
    for (int i = 0; i < 3; i++) {
        exr_coding_channel_info_t *c = &x->pipe.channels[x->channel[i]];
        if (i > 0 && x->channel[i] == x->channel[0]) /* grey is spread afterwards */
            break;
        c->decode_to_ptr = (uint8_t *)(to + i);
        c->user_bytes_per_element = (int16_t)sizeof(float);
        c->user_data_type = EXR_PIXEL_FLOAT;
        c->user_pixel_stride = TEXEL;
        c->user_line_stride = TEXEL * (int32_t)x->width;
    }
    if (!x->pipe_ready) {
        r = exr_decoding_choose_default_routines(x->file, x->part, &x->pipe);
        x->decompress = x->pipe.decompress_fn;
    }
    x->pipe_ready = r == EXR_ERR_SUCCESS;
    /* A chunk that would not shrink is stored plain; the library forgets that for B44. */
    x->pipe.decompress_fn = chunk->packed_size == chunk->unpacked_size ? NULL : x->decompress;
    return r;
}

/* One chunk whose texels belong to the rectangle at (left, top) of the picture, which must hold all of them. */
static enum err decode_chunk(struct exr *x, const exr_chunk_info_t *chunk, uint32_t left, uint32_t top,
                             struct image *im, const char *where)
{
    /* some decompressors of the library leave alone what the data do not reach, or read on past their end */
    if (chunk->width < 1 || chunk->height < 1 || (uint32_t)chunk->width > im->width - left ||
        (uint32_t)chunk->height > im->height - top ||
        chunk->unpacked_size != (uint64_t)chunk->width * (uint64_t)chunk->height * x->texel_bytes)
        return err_say(x->why, ERR_FORMAT, "%s: %s: %dx%d texels are out of place", x->name, where, chunk->width,
                       chunk->height);
    if (chunk->unpacked_size > chunk->packed_size * compression_ratios[x->compression] ||
        (x->compression == EXR_COMPRESSION_NONE && chunk->packed_size != chunk->unpacked_size))
        return err_say(x->why, ERR_FORMAT, "%s: %s, byte %" PRIu64 ": %" PRIu64 " bytes cannot hold %dx%d texels",
                       x->name, where, chunk->data_offset, chunk->packed_size, chunk->width, chunk->height);
    exr_result_t r = aim(x, chunk, im->rgb + 3 * ((size_t)top * im->width + left));
    if (r == EXR_ERR_SUCCESS)
        r = exr_decoding_run(x->file, x->part, &x->pipe);
    if (r == EXR_ERR_SUCCESS)
        return ERR_OK;
    char place[96];
    snprintf(place, sizeof(place), "%s, byte %" PRIu64, where, chunk->data_offset);
    return say_result(x, true_result(x, r), place);
}

/* Rows that are complete: grey becomes three channels, then all is put right while it is still in the cache. */
static void finish_rows(const struct exr *x, struct image *im, uint32_t top, uint32_t rows)
{
    float *rgb = im->rgb + 3 * (size_t)top * im->width;
    const size_t texels = (size_t)rows * im->width;

    if (x->channel[0] == x->channel[1])
        for (size_t i = 0; i < texels; i++)
            rgb[3 * i + 1] = rgb[3 * i + 2] = rgb[3 * i];
    image_sanitise_texels(rgb, texels, x->converts ? x->to_rec709 : NULL, &im->faults);
}

static enum err decode_scanlines(struct exr *x, struct image *im)
{
    int32_t lines = 0;
    const exr_result_t got = exr_get_scanlines_per_chunk(x->file, x->part, &lines);
    char where[64];

    if (got != EXR_ERR_SUCCESS || lines < 1)
        return say_result(x, got, "header");
    for (uint32_t y = 0; y < x->height; y += (uint32_t)lines) {
        exr_chunk_info_t chunk;
        snprintf(where, sizeof(where), "scanline %d", x->top + (int32_t)y);
        const exr_result_t r = exr_read_scanline_chunk_info(x->file, x->part, x->top + (int32_t)y, &chunk);
        if (r != EXR_ERR_SUCCESS)
            return say_result(x, r, where);
        const enum err e = decode_chunk(x, &chunk, 0, y, im, where);
        if (e)
            return e;
        finish_rows(x, im, y, (uint32_t)chunk.height);
    }
    return ERR_OK;
}

static enum err decode_tiles(struct exr *x, struct image *im)
{
    int32_t tile_w = 0, tile_h = 0;
    const exr_result_t got = exr_get_tile_sizes(x->file, x->part, 0, 0, &tile_w, &tile_h);
    char where[64];

    if (got != EXR_ERR_SUCCESS || tile_w < 1 || tile_h < 1)
        return say_result(x, got, "header");
    for (uint32_t top = 0, row = 0; top < x->height; top += (uint32_t)tile_h, row++) {
        for (uint32_t left = 0, column = 0; left < x->width; left += (uint32_t)tile_w, column++) {
            exr_chunk_info_t chunk;
            snprintf(where, sizeof(where), "tile %u, %u", column, row);
            const exr_result_t r = exr_read_tile_chunk_info(x->file, x->part, (int)column, (int)row, 0, 0, &chunk);
            if (r != EXR_ERR_SUCCESS)
                return say_result(x, r, where);
            const enum err e = decode_chunk(x, &chunk, left, top, im, where);
            if (e)
                return e;
        }
        const uint32_t rows = x->height - top < (uint32_t)tile_h ? x->height - top : (uint32_t)tile_h;
        finish_rows(x, im, top, rows);
    }
    return ERR_OK;
}

static enum err decode_part(struct exr *x, struct image *im)
{
    enum err e = choose_part(x);

    if (!e)
        e = check_size(x);
    if (!e)
        e = take_colour(x);
    if (e)
        return e;
    e = image_resize(im, x->width, x->height);
    if (e)
        return err_say(x->why, e, "%s: no memory for %ux%u texels", x->name, x->width, x->height);
    im->layout = layout_of(x);
    x->said.text[0] = '\0';
    return x->tiled ? decode_tiles(x, im) : decode_scanlines(x, im);
}

enum err decode_exr(const uint8_t *bytes, size_t size, const char *name, struct image *im, struct reason *why)
{
    struct exr x = { .bytes = bytes, .size = size, .name = name, .why = why };
    enum err e = open_header(&x);

    if (!e)
        e = decode_part(&x, im);
    if (x.file) {
        exr_decoding_destroy(x.file, &x.pipe);
        exr_finish(&x.file);
    }
    return e;
}
