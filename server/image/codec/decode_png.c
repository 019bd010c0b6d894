#include "image/codec/decode.h"

#include "base/luminance.h"
#include "base/mem.h"
#include "image/codec/primaries.h"
#include "image/codec/markers.h"
#include "image/codec/signal.h"

#include <math.h>
#include <png.h>
#include <setjmp.h>
#include <string.h>

#define SAME_COLOUR 1e-3 /* tolerance of chromaticities, which files hold in five digits */
#define SAME_GAMMA 0.02  /* of the power that stands for sRGB's curve, 1 / 2.2 */

struct png_file {
    const uint8_t *bytes;
    size_t size, at;
    const char *name;
    struct reason *why;
    jmp_buf fault;
    png_structp png;
    png_infop info;
    uint8_t *codes;  /* owned; uint8_t or uint16_t [height][width][3] */
    png_bytep *rows; /* owned */
    bool wide;       /* 16 bits */
};

static void on_error(png_structp png, png_const_charp text)
{
    struct png_file *f = png_get_error_ptr(png);

    (void)err_say(f->why, ERR_FORMAT, "%s: PNG: %s", f->name, text);
    longjmp(f->fault, 1);
}

static void on_warning(png_structp png, png_const_charp text)
{
    (void)png;
    (void)text;
}

static void read_bytes(png_structp png, png_bytep out, size_t count)
{
    struct png_file *f = png_get_io_ptr(png);

    if (count > f->size - f->at)
        png_error(png, "the file ends too early");
    memcpy(out, f->bytes + f->at, count);
    f->at += count;
}

/* Straight code values, without alpha. May jump to f->fault. */
static enum err read_codes(struct png_file *f, struct image *im)
{
    png_set_read_fn(f->png, f, read_bytes);
    png_set_keep_unknown_chunks(f->png, PNG_HANDLE_CHUNK_ALWAYS, (png_const_bytep) "cICP", 1);
    png_read_info(f->png, f->info);
    const uint32_t width = png_get_image_width(f->png, f->info), height = png_get_image_height(f->png, f->info);
    const enum err e = image_check_size(im, width, height, f->name, f->why);
    if (e)
        return e;
    f->wide = png_get_bit_depth(f->png, f->info) == 16;
    png_set_expand(f->png);
    png_set_gray_to_rgb(f->png);
    png_set_strip_alpha(f->png);
    if (f->wide)
        png_set_swap(f->png); /* to the processor's order */
    (void)png_set_interlace_handling(f->png);
    png_read_update_info(f->png, f->info);
    const size_t pitch = 3 * (size_t)width * (f->wide ? 2 : 1);
    f->codes = mem_alloc_raw(height, pitch);
    f->rows = mem_alloc_raw(height, sizeof(*f->rows));
    if (!f->codes || !f->rows || png_get_rowbytes(f->png, f->info) != pitch || image_resize(im, width, height))
        return err_say(f->why, ERR_NOMEM, "%s: out of memory for its texels", f->name);
    for (uint32_t y = 0; y < height; y++)
        f->rows[y] = f->codes + y * pitch;
    png_read_image(f->png, f->rows);
    return ERR_OK;
}

/* ---- What the code values mean: cICP, else sRGB or an ICC profile, else gAMA and cHRM [PNG, third edition, 4.3] ----
 */

static float code_at(const struct png_file *f, size_t i)
{
    return f->wide ? (float)((const uint16_t *)(const void *)f->codes)[i] : (float)f->codes[i];
}

/* Code points of H.273; NULL: none. */
static const uint8_t *find_cicp(const struct png_file *f)
{
    png_unknown_chunkp chunks = NULL;
    const int count = png_get_unknown_chunks(f->png, f->info, &chunks);

    for (int i = 0; i < count; i++)
        if (memcmp(chunks[i].name, "cICP", 4) == 0 && chunks[i].size == 4)
            return chunks[i].data;
    return NULL;
}

/* As video, with its white, 203 cd/m^2, at 1. */
static enum err take_signal(const struct png_file *f, const uint8_t cicp[4], struct image *im)
{
    const size_t count = (size_t)im->width * im->height;
    const struct signal_desc d = { .primaries = cicp[0],
                                   .transfer = cicp[1],
                                   .matrix = 0,
                                   .full_range = cicp[3] != 0,
                                   .rgb = true,
                                   .depth = f->wide ? 16 : 8 };
    struct signal *s = mem_alloc(1, sizeof(*s));

    const enum err e =
        s ? signal_prepare(&d, f->name, s, f->why) : err_say(f->why, ERR_NOMEM, "%s: out of memory", f->name);
    for (size_t t = 0; !e && t < count; t++) {
        const float rgb[3] = { code_at(f, 3 * t), code_at(f, 3 * t + 1), code_at(f, 3 * t + 2) };
        signal_row(s, &rgb[0], &rgb[1], &rgb[2], 1, im->rgb + 3 * t);
        for (size_t c = 0; c < 3; c++)
            im->rgb[3 * t + c] /= (float)SIGNAL_WHITE_CDM2;
    }
    if (!e) {
        image_sanitise_texels(im->rgb, count, NULL, &im->faults);
        im->low_range = s->transfer != SIGNAL_PQ && s->transfer != SIGNAL_HLG && s->transfer != SIGNAL_LINEAR;
        if (!im->low_range)
            image_note(im, "its transfer function is %s: 1 is %g cd/m^2", signal_transfer_name(s->transfer),
                       SIGNAL_WHITE_CDM2);
    }
    mem_free(s);
    return e;
}

/* The file's matrix to Rec.709; false: it is the identity. */
static bool find_matrix(const struct png_file *f, float out[9])
{
    struct chromaticities c;
    double m[9];

    if (!png_get_cHRM(f->png, f->info, &c.white[0], &c.white[1], &c.red[0], &c.red[1], &c.green[0], &c.green[1],
                      &c.blue[0], &c.blue[1]) ||
        colour_same(&c, &colour_rec709, SAME_COLOUR) || colour_to_rec709(&c, m))
        return false;
    for (int i = 0; i < 9; i++)
        out[i] = (float)m[i];
    return true;
}

static enum err take_codes(const struct png_file *f, struct image *im, struct markers *m)
{
    const size_t count = 3 * (size_t)im->width * im->height, codes = f->wide ? 65536 : 256;
    int intent, method;
    png_charp profile_name;
    png_uint_32 profile_size;
    png_bytep profile;
    double gamma = 1.0 / 2.2;
    float to_rec709[9];

    const bool has_srgb = png_get_sRGB(f->png, f->info, &intent);
    const bool has_icc = png_get_iCCP(f->png, f->info, &profile_name, &method, &profile, &profile_size);
    if (has_icc && !has_srgb)
        m->icc = (struct marker){ profile, profile_size };
    const bool own = !has_srgb && !has_icc;
    if (own)
        (void)png_get_gAMA(f->png, f->info, &gamma);
    const bool is_srgb = fabs(gamma - 1.0 / 2.2) < SAME_GAMMA || !(gamma > 0.0);
    float *light = mem_alloc_raw(codes, sizeof(*light));
    if (!light)
        return err_say(f->why, ERR_NOMEM, "%s: out of memory", f->name);
    for (size_t i = 0; i < codes; i++) {
        const double v = (double)i / (double)(codes - 1);
        light[i] = (float)(is_srgb ? srgb_decode(v) : pow(v, 1.0 / gamma));
    }
    for (size_t i = 0; i < count; i++)
        im->rgb[i] = light[(size_t)code_at(f, i)];
    mem_free(light);
    if (own && find_matrix(f, to_rec709)) {
        image_sanitise_texels(im->rgb, count / 3, to_rec709, &im->faults);
        im->faults = (struct image_faults){ .nan = 0 }; /* colours outside of Rec.709 */
    }
    im->low_range = true;
    return ERR_OK;
}

static struct marker find_xmp(const struct png_file *f)
{
    png_textp texts = NULL;
    const int count = png_get_text(f->png, f->info, &texts, NULL);

    for (int i = 0; i < count; i++)
        if (strcmp(texts[i].key, "XML:com.adobe.xmp") == 0)
            return (struct marker){ (const uint8_t *)texts[i].text,
                                    texts[i].itxt_length ? texts[i].itxt_length : texts[i].text_length };
    return (struct marker){ .size = 0 };
}

static enum err decode(struct png_file *f, struct image *im)
{
    struct markers m = { 0 };
    png_uint_32 exif_size;
    png_bytep exif;

    if (setjmp(f->fault))
        return ERR_FORMAT;
    enum err e = read_codes(f, im);
    if (e)
        return e;
    if (setjmp(f->fault) == 0)
        png_read_end(f->png, f->info); /* Exif may follow the texels; a fault there is none of theirs */
    const uint8_t *cicp = find_cicp(f);
    e = cicp ? take_signal(f, cicp, im) : take_codes(f, im, &m);
    if (e)
        return e;
    m.aspect = (double)png_get_pixel_aspect_ratio(f->png, f->info);
    m.xmp = find_xmp(f);
    if (png_get_eXIf_1(f->png, f->info, &exif_size, &exif)) {
        m.orientation = markers_orientation(exif, exif_size);
        m.exif = (struct marker){ exif, exif_size };
    }
    e = markers_place(&m, im);
    return e ? err_say(f->why, e, "%s: out of memory to turn it", f->name) : ERR_OK;
}

enum err decode_png(const uint8_t *bytes, size_t size, const char *name, struct image *im, struct reason *why)
{
    struct png_file f = { .bytes = bytes, .size = size, .name = name, .why = why };
    enum err e = ERR_NOMEM;

    f.png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &f, on_error, on_warning);
    f.info = f.png ? png_create_info_struct(f.png) : NULL;
    if (f.info) {
        png_set_user_limits(f.png, IMAGE_MAX_SIDE, IMAGE_MAX_SIDE);
        e = decode(&f, im);
    } else {
        e = err_say(why, e, "%s: out of memory", name);
    }
    png_destroy_read_struct(&f.png, &f.info, NULL);
    mem_free(f.codes);
    mem_free(f.rows);
    return e;
}
