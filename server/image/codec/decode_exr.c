#include "image/codec/decode.h"

#include "base/mem.h"
#include "image/codec/primaries.h"
#include "image/codec/exr_dwa.h"
#include "image/codec/exr_file.h"

#include <ctype.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

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

/* ---- Layers: all channels of a prefix ("ViewLayer.Combined.", ".", "") that hold a colour ---- */

enum { FULL_NAME = 160, LAYERS_SHOWN = 200 };

struct exr_layer {
    int part, channels[3];
    int rank;             /* the lowest is chosen */
    char name[FULL_NAME]; /* printable; "": the whole file */
};

/* Length of the channel's prefix with its last dot. Its last component is `name` or that word, in any case. */
static bool ends_in_colour(const char *channel, const char *name, const char *word, size_t *prefix)
{
    const char *dot = strrchr(channel, '.'), *last = dot ? dot + 1 : channel;

    *prefix = (size_t)(last - channel);
    return strcasecmp(last, name) == 0 || strcasecmp(last, word) == 0;
}

/* The index of the prefix's channel for a colour, or -1. */
static int find_channel(const exr_attr_chlist_t *list, const char *prefix, size_t length, const char *name,
                        const char *word)
{
    size_t other;

    for (int c = 0; c < list->num_channels; c++) {
        const char *s = list->entries[c].name.str;
        if (ends_in_colour(s, name, word, &other) && other == length && strncmp(s, prefix, length) == 0)
            return c;
    }
    return -1;
}

/* The channels of the layer that begins with channel c: R, G and B, else Y as grey. */
static bool layer_at(const exr_attr_chlist_t *list, int c, int out[3], size_t *prefix)
{
    const char *name = list->entries[c].name.str;

    if (ends_in_colour(name, "R", "red", prefix)) {
        out[0] = c;
        out[1] = find_channel(list, name, *prefix, "G", "green");
        out[2] = find_channel(list, name, *prefix, "B", "blue");
        return out[1] >= 0 && out[2] >= 0;
    }
    out[0] = out[1] = out[2] = c;
    return ends_in_colour(name, "Y", "luminance", prefix) &&
           (find_channel(list, name, *prefix, "R", "red") < 0 || find_channel(list, name, *prefix, "G", "green") < 0 ||
            find_channel(list, name, *prefix, "B", "blue") < 0) &&
           find_channel(list, name, *prefix, "X", "X") < 0; /* no vector */
}

/* The part's name and the prefix, which often begins with it. */
static void name_layer(const char *part, const char *channel, size_t prefix, char out[FULL_NAME])
{
    const size_t length = prefix > 0 ? prefix - 1 : 0, known = strlen(part);
    const bool repeats = length >= known && strncmp(channel, part, known) == 0;
    char text[FULL_NAME], own[FULL_NAME];

    decode_printable(channel, length, own, sizeof(own));
    snprintf(text, sizeof(text), "%.70s%s%.70s", repeats ? "" : part, repeats || !known || !length ? "" : ".", own);
    decode_printable(text, sizeof(text), out, FULL_NAME);
}

/* Whether a word of `words`, which commas separate and enclose, stands in the name: a short one by itself, a long one
 * also as a part of another, as in beautyPass. */
static bool has_word(const char *name, size_t length, const char *words)
{
    for (const char *w = words; w[1]; w += 1 + strcspn(w + 1, ",")) {
        const size_t n = strcspn(w + 1, ",");
        for (size_t i = 0; i + n <= length; i++) {
            const bool alone = (i == 0 || !isalnum((unsigned char)name[i - 1])) &&
                               (i + n == length || !isalnum((unsigned char)name[i + n]));
            if ((alone || n >= 6) && strncasecmp(name + i, w + 1, n) == 0)
                return true;
        }
    }
    return false;
}

/* What a renderer's layer of that name holds, by its last component before that of an eye: 0 and 1 the image, 2 perhaps
 * the image, 3 unknown, 4 a part of it or no light at all. Names of Blender, V-Ray, Arnold, RenderMan, Redshift, Octane
 * and Nuke. */
static int rank_of(const char *name)
{
    static const char *const words[] = {
        ",combined,beauty,rgb,rgba,ci,composite,effectsresult,",
        ",ao,occlusion,albedo,basecolor,diffcol,glosscol,transcol,normal,normals,n,position,p,pref,uv,depth,z,zdepth,"
        "mist,shadow,shadows,matte,mask,alpha,id,indexob,indexma,vector,velocity,motion,motionvector,variance,crypto,"
        "denoising,",
        ",color,colour,c,image,main,final,render,",
    };
    size_t end = strlen(name);

    if (end == 0)
        return 0;
    end -= end > 5 && strcasecmp(name + end - 5, ".left") == 0 ? 5 : 0;
    end -= end > 6 && strcasecmp(name + end - 6, ".right") == 0 ? 6 : 0;
    size_t begin = end;
    while (begin > 0 && name[begin - 1] != '.')
        begin--;
    const char *last = name + begin;
    const size_t n = end - begin;
    return has_word(last, n, words[0]) ? 1 : has_word(last, n, words[1]) ? 4 : has_word(last, n, words[2]) ? 2 : 3;
}

/* The user's name for a layer: all of it, or what follows a dot. */
static bool is_called(const char *name, const char *wanted)
{
    const size_t n = strlen(name), m = strlen(wanted);

    return m <= n && strcasecmp(name + n - m, wanted) == 0 && (m == n || name[n - m - 1] == '.');
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

/* Opens a part. Its channels are in *list, which the library owns. */
static enum err open_part(struct exr_file *x, int part, const exr_attr_chlist_t **list)
{
    exr_storage_t storage = EXR_STORAGE_LAST_TYPE;
    exr_result_t r = exr_get_storage(x->context, part, &storage);

    if (r == EXR_ERR_SUCCESS)
        r = exr_get_channels(x->context, part, list);
    if (r == EXR_ERR_SUCCESS)
        r = exr_get_compression(x->context, part, &x->compression);
    if (r != EXR_ERR_SUCCESS)
        return exr_file_say(x, r, "header");
    if (storage != EXR_STORAGE_SCANLINE && storage != EXR_STORAGE_TILED)
        return err_say(x->why, ERR_UNSUPPORTED, "%s: header: deep images are not supported", x->name);
    if ((*list)->num_channels < 1 || (*list)->num_channels > EXR_CHANNELS_MAX)
        return err_say(x->why, ERR_RANGE, "%s: header: %d channels; 1 to %d are supported", x->name,
                       (*list)->num_channels, EXR_CHANNELS_MAX);
    if ((int)x->compression < 0 || x->compression >= EXR_COMPRESSION_LAST_TYPE)
        return err_say(x->why, ERR_UNSUPPORTED, "%s: header: compression %d is unknown", x->name, (int)x->compression);
    x->part = part;
    x->tiled = storage == EXR_STORAGE_TILED;
    return ERR_OK;
}

struct search {
    const char *wanted; /* by the user; NULL: by meaning */
    struct exr_layer best;
    bool many;                 /* parts */
    unsigned count;            /* of layers that can be read */
    char others[LAYERS_SHOWN]; /* their names */
};

static void add_layer(struct search *s, const struct exr_layer *l)
{
    const size_t at = strlen(s->others);
    const char *name = l->name[0] ? l->name : "RGB";
    const bool called = s->wanted && is_called(name, s->wanted);

    snprintf(s->others + at, sizeof(s->others) - at, "%s%s", s->count ? ", " : "", name);
    s->count++;
    if (s->wanted ? called && s->best.part < 0 : s->best.part < 0 || l->rank < s->best.rank)
        s->best = *l;
}

/* Adds the part's layers. Without any, reports why. */
static enum err search_part(struct exr_file *x, int part, struct search *s)
{
    const exr_attr_chlist_t *list = NULL;
    const char *name = NULL;
    size_t prefix;
    bool found = false;

    enum err e = open_part(x, part, &list);
    if (e)
        return e;
    if (!s->many || exr_get_name(x->context, part, &name) != EXR_ERR_SUCCESS)
        name = NULL; /* a file's only part has its name for nothing */
    for (int c = 0; c < list->num_channels; c++) {
        struct exr_layer l = { .part = part };
        if (!layer_at(list, c, l.channels, &prefix))
            continue;
        const char *channel = list->entries[c].name.str;
        found = true;
        if (l.channels[0] == l.channels[1] && (find_channel(list, channel, prefix, "RY", "RY") >= 0 ||
                                               find_channel(list, channel, prefix, "BY", "BY") >= 0))
            e = err_say(x->why, ERR_UNSUPPORTED, "%s: header: luminance with chroma (Y, RY, BY) is not supported",
                        x->name);
        else
            e = check_channels(x, list, l.channels);
        name_layer(name ? name : "", channel, prefix, l.name);
        /* a lone grey channel is read where there is no colour */
        l.rank = 2 * rank_of(l.name) + (l.channels[0] == l.channels[1]);
        if (!e)
            add_layer(s, &l);
    }
    return e || found ? e : err_say(x->why, ERR_UNSUPPORTED, "%s: header: neither channels R, G, B nor Y", x->name);
}

/* Picks the layer to read, of all parts; if there is none, reports the first part's fault. */
static enum err choose_layer(struct exr_file *x)
{
    struct search s = { .wanted = x->into->layer && x->into->layer[0] ? x->into->layer : NULL, .best.part = -1 };
    const exr_attr_chlist_t *list = NULL;
    struct reason *const why = x->why;
    struct reason ignored = { "" };
    int count = 0;

    const exr_result_t r = exr_get_count(x->context, &count);
    if (r != EXR_ERR_SUCCESS)
        return exr_file_say(x, r, "header");
    s.many = count > 1;
    const enum err first = search_part(x, 0, &s);
    x->why = &ignored;
    for (int part = 1; part < count; part++)
        (void)search_part(x, part, &s);
    x->why = why;
    if (s.count == 0)
        return first;
    if (s.best.part < 0)
        return err_say(why, ERR_USAGE, "%s: it has no layer '%s'; its layers are %s", x->name, s.wanted, s.others);
    const enum err e = open_part(x, s.best.part, &list);
    if (!e && s.count > 1 && !s.wanted)
        snprintf(x->note, sizeof(x->note), "its layer %.90s is read, of %.160s; --layer chooses another",
                 s.best.name[0] ? s.best.name : "RGB", s.others);
    return e ? e : check_channels(x, list, s.best.channels);
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

/* Where the display window, which is the image's frame, lies about the data window. */
static enum err take_frame(struct exr_file *x)
{
    char where[512];
    exr_attr_box2i_t w;

    x->frame.width = 0;
    if (exr_get_display_window(x->context, x->part, &w) != EXR_ERR_SUCCESS)
        return ERR_OK;
    const int64_t width = (int64_t)w.max.x - w.min.x + 1, height = (int64_t)w.max.y - w.min.y + 1;
    const int64_t left = (int64_t)x->left - w.min.x, top = (int64_t)x->top - w.min.y;
    if (left == 0 && top == 0 && width == x->width && height == x->height)
        return ERR_OK;
    if (width < 1 || height < 1 || left >= width || top >= height || left + x->width <= 0 || top + x->height <= 0) {
        snprintf(x->window, sizeof(x->window), "its display window lies beside its data and is ignored");
        return ERR_OK;
    }
    snprintf(where, sizeof(where), "%s: header: display window", x->name);
    const enum err e = image_check_size(x->into, (uint64_t)width, (uint64_t)height, where, x->why);
    if (e)
        return e;
    x->frame = (struct exr_frame){ (uint32_t)width, (uint32_t)height, left, top };
    snprintf(x->window, sizeof(x->window),
             "its data, %ux%u from (%" PRId64 ", %" PRId64 "), are placed in its display window of %" PRId64 "x%" PRId64
             ", black where there are none",
             x->width, x->height, left, top, width, height);
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
    (void)exr_get_pixel_aspect_ratio(x->context, x->part, &x->aspect);
    x->layout = map == EXR_ENVMAP_LATLONG ? LAYOUT_LATLONG : map == EXR_ENVMAP_CUBE ? LAYOUT_CUBE : LAYOUT_AUTO;
}

/* Checks everything in the header against the limits before allocating memory. */
static enum err read_header(struct exr_file *x)
{
    enum err e = check_header(x);

    if (!e)
        e = open_header(x);
    if (!e)
        e = choose_layer(x);
    if (!e)
        e = check_size(x);
    if (!e)
        e = take_frame(x);
    if (!e)
        e = take_colour(x);
    if (!e)
        take_layout(x);
    return e;
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

/* Mends the texels, puts them into their frame and notes what was chosen. */
static enum err finish_image(const struct exr_file *x, struct image *im)
{
    image_mend(im);
    const enum err e =
        x->frame.width ? image_place(im, x->frame.width, x->frame.height, x->frame.left, x->frame.top) : ERR_OK;
    if (e)
        return err_say(x->why, e, "%s: out of memory for %ux%u texels", x->name, x->frame.width, x->frame.height);
    if (x->note[0])
        image_note(im, "%s", x->note);
    if (x->window[0])
        image_note(im, "%s", x->window);
    image_take_aspect(im, (double)x->aspect);
    return ERR_OK;
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
    exr_file_take_time(&x, im);
    e = x.compression == EXR_COMPRESSION_DWAA || x.compression == EXR_COMPRESSION_DWAB ? read_dwa(&x, im)
                                                                                       : exr_chunks_read(&x, im);
    if (!e)
        e = finish_image(&x, im);
done:
    if (x.context)
        exr_finish(&x.context);
    serving = NULL;
    return e;
}
