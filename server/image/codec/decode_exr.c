#include "image/codec/decode.h"

#include "base/scratch.h"
#include "image/codec/colour.h"
#include "image/codec/exr_dwa.h"
#include "image/codec/exr_file.h"
#include "image/codec/exr_policy.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#define BLOCK_MAX ((size_t)1 << 30)                       /* bytes that the library may allocate at once */
#define CHANNEL_LIST_MAX ((size_t)EXR_CHANNELS_MAX * 272) /* bytes: the longest names, and 16 for each channel */
#define FLAG_PARTS 0x10
#define SAME_COLOUR 1e-4 /* tolerance for chromaticities, which headers store as float */

/* Upper bounds on unpacked bytes per packed byte, rounded up. RLE: a run of 128 in 2 bytes. ZIP: deflate's 1032. PIZ:
 * 255 values of 2 bytes in a Huffman code of 9 bits. PXR24: deflate's, and floats lose one byte of four. B44A: 32 bytes
 * in 3. DWA: 64 floats become two values of 2 bytes, both deflated. */
static const uint64_t compression_ratios[] = { 1, 64, 1032, 1032, 454, 1376, 11, 11, 70000, 70000 };

/* As pread: returns fewer bytes at the end of the file; the library reports an error if that is too few. */
static int64_t read_bytes(exr_const_context_t ctx, void *user, void *out, uint64_t count, uint64_t offset,
                          exr_stream_error_func_ptr_t fail)
{
    const struct exr_file *x = user;

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
    return (int64_t)((const struct exr_file *)user)->size;
}

static void on_library_error(exr_const_context_t ctx, exr_result_t code, const char *text)
{
    void *user = NULL;

    (void)code;
    if (exr_get_user_data(ctx, &user) != EXR_ERR_SUCCESS || !user)
        return;
    struct exr_file *x = user;
    if (!x->library_fault.text[0])
        decode_printable(text, strlen(text), x->library_fault.text, sizeof(x->library_fault.text));
}

/* The arena that serves this thread's file: the library's allocation hooks have no context argument. Set while
 * decode_exr runs. */
static _Thread_local struct scratch *serving;
static _Thread_local bool
    refused; /* an allocation failed; some of the library's decoders report that as a damaged file */

/* Zeroed, so that a chunk that unpacks to less than it claims yields black instead of an earlier image's data. */
static void *take_block(size_t bytes)
{
    void *p = bytes > BLOCK_MAX ? NULL : scratch_alloc(serving, bytes);

    refused = refused || (!p && bytes <= BLOCK_MAX);
    return p;
}

static void give_block(void *p)
{
    scratch_free(serving, p);
}

static uint64_t little_endian(const uint8_t *at, size_t bytes)
{
    uint64_t v = 0;

    while (bytes-- > 0)
        v = v << 8 | at[bytes];
    return v;
}

/* The byte behind the last chunk, by the chunk table, if the file ends before it; else 0. */
static uint64_t missing_end(const struct exr_file *x)
{
    const size_t leader = x->tiled ? 20 : 8; /* the last number of which is the chunk's size */
    int32_t count = 0;
    uint64_t last = 0;

    if (x->table_at == 0 || !x->context || exr_get_chunk_count(x->context, x->part, &count) != EXR_ERR_SUCCESS)
        return 0;
    for (int32_t k = 0; k < count; k++) {
        const uint64_t at = x->table_at + 8 * (uint64_t)k;
        if (at + 8 > x->size)
            return at + 8;
        const uint64_t chunk = little_endian(x->bytes + at, 8);
        last = chunk > last ? chunk : last;
    }
    if (last > x->size || leader > x->size - last)
        return last > UINT64_MAX - leader ? last : last + leader;
    const uint64_t end = last + leader + little_endian(x->bytes + last + leader - 4, 4);
    return end > x->size ? end : 0;
}

/* Reports an error at `where` with the library's message or, without one, the text of its code. */
enum err exr_file_say(struct exr_file *x, exr_result_t r, const char *where)
{
    const uint64_t end = r == EXR_ERR_OUT_OF_MEMORY || refused ? 0 : missing_end(x);

    if (end > 0)
        return err_say(x->why, ERR_FORMAT,
                       "%s: %s: the file is cut off: it has %zu bytes, and its data go up to byte %" PRIu64, x->name,
                       where, x->size, end);
    const char *text = x->library_fault.text[0] ? x->library_fault.text : exr_get_default_error_message(r);

    return err_say(x->why, r == EXR_ERR_OUT_OF_MEMORY || refused ? ERR_NOMEM : ERR_FORMAT, "%s: %s: %s", x->name, where,
                   text);
}

bool exr_file_plausible(const struct exr_file *x, uint64_t packed, uint64_t unpacked)
{
    return unpacked / compression_ratios[x->compression] <= packed;
}

/* The library locates each attribute and channel by a linear search, which takes hours for a header with a million of
 * them. Count them first. */
static enum err check_header(struct exr_file *x)
{
    struct exr_header h = { x->bytes, x->size, 8, x->name, x->why };
    const bool parts = x->size > 5 && x->bytes[5] & FLAG_PARTS;
    int attributes = 0;

    while (h.at < x->size) {
        struct exr_entry a;
        if (x->bytes[h.at] == 0) { /* end of a part's header; an empty one ends the list */
            x->table_at = parts ? 0 : h.at + 1;
            if (!parts || (++h.at < x->size && x->bytes[h.at] == 0))
                return ERR_OK;
            attributes = 0;
            continue;
        }
        const size_t begin = h.at;
        const enum err e = exr_header_next(&h, &a);
        if (e)
            return e;
        if (++attributes > EXR_POLICY_ATTRIBUTES)
            return err_say(x->why, ERR_RANGE, "%s: header: byte %zu: more than %d attributes", x->name, begin,
                           EXR_POLICY_ATTRIBUTES);
        if (strcmp(a.type, "chlist") == 0 && a.size > CHANNEL_LIST_MAX)
            return err_say(x->why, ERR_RANGE, "%s: header: byte %zu: the channel list has %zu bytes, too many", x->name,
                           begin, a.size);
    }
    return err_say(x->why, ERR_FORMAT, "%s: header: byte %zu: the file ends here", x->name, x->size);
}

static enum err open_header(struct exr_file *x)
{
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;

    init.error_handler_fn = on_library_error;
    init.alloc_fn = take_block;
    init.free_fn = give_block;
    init.user_data = x;
    init.read_fn = read_bytes;
    init.size_fn = count_bytes;
    /* Strict: rejects a faulty header instead of repairing it. No chunk table reconstruction: a file without one was
     * not written completely. */
    init.flags = EXR_CONTEXT_FLAG_STRICT_HEADER | EXR_CONTEXT_FLAG_DISABLE_CHUNK_RECONSTRUCTION;
    const exr_result_t r = exr_start_read(&x->context, x->name, &init);
    return r == EXR_ERR_SUCCESS ? ERR_OK : exr_file_say(x, r, "header");
}

/* The index of channel layer + name, or -1. `layer` need not be NUL-terminated. */
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
static enum err choose_channels(struct exr_file *x, const exr_attr_chlist_t *list, int out[3])
{
    if (find_rgb(list, "", 0, out))
        return ERR_OK;
    const int y = find_channel(list, "", 0, "Y");
    if (y >= 0) {
        if (find_channel(list, "", 0, "RY") >= 0 || find_channel(list, "", 0, "BY") >= 0)
            return err_say(x->why, ERR_UNSUPPORTED, "%s: header: luminance with chroma (Y, RY, BY) is not supported",
                           x->name);
        out[0] = out[1] = out[2] = y;
        return ERR_OK;
    }
    for (int c = 0; c < list->num_channels; c++) {
        const char *name = list->entries[c].name.str;
        const size_t length = strlen(name);
        if (length > 2 && strcmp(name + length - 2, ".R") == 0 && find_rgb(list, name, length - 1, out))
            return ERR_OK;
    }
    return err_say(x->why, ERR_UNSUPPORTED, "%s: header: neither channels R, G, B nor Y", x->name);
}

/* Rejects any subsampled channel, even an unused one: such a part counts its chunks differently. */
static enum err check_channels(struct exr_file *x, const exr_attr_chlist_t *list, const int chosen[3])
{
    char text[32];

    x->texel_bytes = 0;
    for (int c = 0; c < list->num_channels; c++) {
        const exr_attr_chlist_entry_t *e = &list->entries[c];
        for (int i = 0; i < 3; i++)
            if (chosen[i] == c)
                x->source[i] = (struct exr_source){ c, e->pixel_type == EXR_PIXEL_HALF, x->texel_bytes };
        x->texel_bytes += e->pixel_type == EXR_PIXEL_HALF ? 2 : 4;
        if (e->x_sampling != 1 || e->y_sampling != 1)
            return err_say(x->why, ERR_UNSUPPORTED, "%s: header: channel %s is subsampled %dx%d", x->name,
                           decode_printable(e->name.str, strlen(e->name.str), text, sizeof(text)), e->x_sampling,
                           e->y_sampling);
    }
    for (int i = 0; i < 3; i++) {
        const exr_attr_chlist_entry_t *e = &list->entries[chosen[i]];
        if (e->pixel_type != EXR_PIXEL_HALF && e->pixel_type != EXR_PIXEL_FLOAT)
            return err_say(x->why, ERR_UNSUPPORTED, "%s: header: channel %s holds integers", x->name,
                           decode_printable(e->name.str, strlen(e->name.str), text, sizeof(text)));
    }
    x->grey = chosen[0] == chosen[1];
    return ERR_OK;
}

static enum err try_part(struct exr_file *x, int part)
{
    exr_storage_t storage = EXR_STORAGE_LAST_TYPE;
    const exr_attr_chlist_t *list = NULL;
    int chosen[3];
    exr_result_t r = exr_get_storage(x->context, part, &storage);

    if (r == EXR_ERR_SUCCESS)
        r = exr_get_channels(x->context, part, &list);
    if (r == EXR_ERR_SUCCESS)
        r = exr_get_compression(x->context, part, &x->compression);
    if (r != EXR_ERR_SUCCESS)
        return exr_file_say(x, r, "header");
    if (storage != EXR_STORAGE_SCANLINE && storage != EXR_STORAGE_TILED)
        return err_say(x->why, ERR_UNSUPPORTED, "%s: header: deep images are not supported", x->name);
    if (list->num_channels < 1 || list->num_channels > EXR_CHANNELS_MAX)
        return err_say(x->why, ERR_RANGE, "%s: header: %d channels; 1 to %d are supported", x->name, list->num_channels,
                       EXR_CHANNELS_MAX);
    if ((int)x->compression < 0 || x->compression >= EXR_COMPRESSION_LAST_TYPE)
        return err_say(x->why, ERR_UNSUPPORTED, "%s: header: compression %d is unknown", x->name, (int)x->compression);
    x->part = part;
    x->tiled = storage == EXR_STORAGE_TILED;
    const enum err e = choose_channels(x, list, chosen);
    return e ? e : check_channels(x, list, chosen);
}

/* Picks the first part that can be read; if there is none, reports the first part's fault. */
static enum err choose_part(struct exr_file *x)
{
    int count = 0;
    struct reason *const why = x->why;
    struct reason ignored = { "" };
    const exr_result_t r = exr_get_count(x->context, &count);

    if (r != EXR_ERR_SUCCESS)
        return exr_file_say(x, r, "header");
    const enum err first = try_part(x, 0);
    enum err e = first;
    x->why = &ignored;
    for (int part = 1; part < count && e; part++)
        e = try_part(x, part);
    x->why = why;
    return e ? first : ERR_OK;
}

/* Checks the data window against the limits and against the file's size: each chunk has an entry in the offset table
 * and eight bytes of its own, and no compression exceeds its ratio. */
static enum err check_size(struct exr_file *x)
{
    char where[512];
    exr_attr_box2i_t w;
    int32_t chunks = 0;
    exr_result_t r = exr_get_data_window(x->context, x->part, &w);

    if (r == EXR_ERR_SUCCESS)
        r = exr_get_chunk_count(x->context, x->part, &chunks);
    if (r != EXR_ERR_SUCCESS)
        return exr_file_say(x, r, "header");
    const int64_t width = (int64_t)w.max.x - w.min.x + 1, height = (int64_t)w.max.y - w.min.y + 1;
    if (width < 1 || height < 1)
        return err_say(x->why, ERR_FORMAT, "%s: header: the data window is empty", x->name);
    snprintf(where, sizeof(where), "%s: header", x->name);
    const enum err e = image_check_size(x->into, (uint64_t)width, (uint64_t)height, where, x->why);
    if (e)
        return e;
    if (chunks < 1 || (uint64_t)chunks > x->size / 16 ||
        !exr_file_plausible(x, x->size, (uint64_t)(width * height) * x->texel_bytes))
        return err_say(x->why, ERR_FORMAT,
                       "%s: header: %" PRId64 "x%" PRId64
                       " texels with %s compression cannot fit into a file of %zu bytes",
                       x->name, width, height, exr_compression_names[x->compression], x->size);
    x->width = (uint32_t)width;
    x->height = (uint32_t)height;
    x->left = w.min.x;
    x->top = w.min.y;
    return ERR_OK;
}

static enum err take_colour(struct exr_file *x)
{
    exr_attr_chromaticities_t a;
    double m[9];

    if (exr_attr_get_chromaticities(x->context, x->part, "chromaticities", &a) != EXR_ERR_SUCCESS)
        return ERR_OK;
    const struct chromaticities c = {
        { a.red_x, a.red_y }, { a.green_x, a.green_y }, { a.blue_x, a.blue_y }, { a.white_x, a.white_y }
    };
    if (colour_same(&c, &colour_rec709, SAME_COLOUR))
        return ERR_OK;
    if (colour_to_rec709(&c, m))
        return err_say(x->why, ERR_FORMAT, "%s: header: the chromaticities do not define a colour space", x->name);
    for (int i = 0; i < 9; i++)
        x->to_rec709[i] = (float)m[i];
    x->converts = !x->grey; /* grey is neutral, so conversion leaves it unchanged */
    return ERR_OK;
}

static void take_layout(struct exr_file *x)
{
    exr_envmap_t map = EXR_ENVMAP_LAST_TYPE;

    if (exr_attr_get_envmap(x->context, x->part, "envmap", &map) != EXR_ERR_SUCCESS)
        map = EXR_ENVMAP_LAST_TYPE;
    x->layout = map == EXR_ENVMAP_LATLONG ? LAYOUT_LATLONG : map == EXR_ENVMAP_CUBE ? LAYOUT_CUBE : LAYOUT_AUTO;
}

/* Checks everything in the header against the limits before allocating memory. */
static enum err read_header(struct exr_file *x)
{
    enum err e = check_header(x);

    if (!e)
        e = open_header(x);
    if (!e)
        e = choose_part(x);
    if (!e)
        e = check_size(x);
    if (!e)
        e = take_colour(x);
    if (!e)
        take_layout(x);
    return e;
}

static bool is_dwa(const struct exr_file *x)
{
    return x->compression == EXR_COMPRESSION_DWAA || x->compression == EXR_COMPRESSION_DWAB;
}

static enum err read_dwa(struct exr_file *x, struct image *im)
{
    struct exr_dwa d = { x->bytes, x->size, x->part, { NULL }, x->left, x->top, x->width, x->height };
    const exr_attr_chlist_t *list = NULL;
    char fault[128] = "";
    const exr_result_t r = exr_get_channels(x->context, x->part, &list);

    if (r != EXR_ERR_SUCCESS)
        return exr_file_say(x, r, "header");
    for (int i = 0; i < 3; i++)
        d.channels[i] = list->entries[x->source[i].channel].name.str;
    const enum exr_dwa_result result = exr_dwa_read(&d, im->rgb, fault);
    if (result == EXR_DWA_OK) {
        image_sanitise_texels(im->rgb, (size_t)im->width * im->height, x->converts ? x->to_rec709 : NULL, &im->faults);
        return ERR_OK;
    }
    decode_printable(fault, strlen(fault), x->library_fault.text, sizeof(x->library_fault.text));
    return exr_file_say(x, result == EXR_DWA_NO_MEMORY ? EXR_ERR_OUT_OF_MEMORY : EXR_ERR_CORRUPT_CHUNK, "DWA");
}

enum err decode_exr(const uint8_t *bytes, size_t size, const char *name, struct image *im, struct reason *why)
{
    struct exr_file x = { .bytes = bytes, .size = size, .name = name, .into = im, .why = why };

    if (!im->scratch)
        im->scratch = scratch_create(); /* may fail; without an arena the library allocates from the system */
    scratch_begin(im->scratch);
    serving = im->scratch;
    refused = false;
    enum err e = read_header(&x);
    if (e)
        goto done;
    e = image_resize(im, x.width, x.height);
    if (e) {
        e = err_say(why, e, "%s: out of memory for %ux%u texels", name, x.width, x.height);
        goto done;
    }
    im->layout = x.layout;
    e = is_dwa(&x) ? read_dwa(&x, im) : exr_chunks_read(&x, im);
done:
    if (x.context)
        exr_finish(&x.context);
    serving = NULL;
    return e;
}
