#include "image/codec/decode.h"

#include "base/mem.h"
#include "image/codec/calendar.h"
#include "image/codec/primaries.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Radiance images [Ward 1991; Radiance's colour and image file formats]: header lines up to an empty one, a line with
 * size and orientation, then scan lines of four bytes per texel, three mantissas and a shared exponent. */

#define LINE_ROOM 512 /* longest header line that is parsed */
#define NEW_RLE_MIN 8 /* shorter scan lines are flat or in the old encoding */
#define NEW_RLE_MAX 32767
#define SAME_COLOUR 1e-4 /* tolerance for chromaticities */
#define SCALE_MAX 1e30   /* EXPOSURE and COLORCORR; the light is divided by their product */

struct hdr {
    const uint8_t *bytes;
    size_t size, at;
    const char *name;
    const struct image *into; /* for its limits */
    struct reason *why;

    bool xyz;
    double exposure, correction[3]; /* products of all header lines; texels are divided by both */
    double aspect;                  /* height per width of a texel, likewise a product */
    bool has_primaries;
    struct chromaticities primaries;
    int64_t local_us, utc_us; /* CAPDATE and GMT, as image.taken_us */
    bool bad_time;            /* one of them is none */

    uint32_t width, height;
    uint32_t scanlines, length; /* in file order; a scan line is a column if X comes first */
    bool x_first, from_bottom, from_right;
};

/* Buffers reused for every scan line. */
struct row {
    uint8_t *plane[4]; /* red, green, blue, exponent: uint8_t[length] each */
    float *rgb;        /* float[length][3]; used if the image is stored in another order */
    float scale[256];  /* for each exponent byte: 2^(e - 136), 0 for 0 */
};

/* Reads the next line without its newline, truncated to room. False if the file ends inside the line. */
static bool next_line(struct hdr *h, char *line, size_t room, bool *cut)
{
    const uint8_t *from = h->bytes + h->at;
    const uint8_t *end = memchr(from, '\n', h->size - h->at);

    if (!end)
        return false;
    size_t length = (size_t)(end - from);
    h->at += length + 1;
    if (length > 0 && from[length - 1] == '\r') /* DOS line ends */
        length--;
    *cut = length >= room;
    if (*cut)
        length = room - 1;
    memcpy(line, from, length);
    line[length] = '\0';
    return true;
}

static enum err say_line(const struct hdr *h, size_t at, const char *line, enum err e, const char *what)
{
    char text[64];

    return err_say(h->why, e, "%s: byte %zu: '%s': %s", h->name, at, decode_printable(line, strlen(line), text, 64),
                   what);
}

/* Parses exactly `count` finite numbers. */
static bool read_numbers(const char *text, int count, double *out)
{
    char *end;

    for (int i = 0; i < count; i++, text = end) {
        out[i] = strtod(text, &end);
        if (end == text || !isfinite(out[i]))
            return false;
    }
    return text[strspn(text, " \t")] == '\0';
}

/* Programs that scale the texels record the factor: each line adds one, and radiance is the texel over their product.
 */
static bool take_factors(const char *text, int count, double *product)
{
    double factor[3];

    if (!read_numbers(text, count, factor))
        return false;
    for (int i = 0; i < count; i++) {
        product[i] *= factor[i];
        if (!(product[i] >= 1.0 / SCALE_MAX && product[i] <= SCALE_MAX))
            return false;
    }
    return true;
}

static bool take_primaries(struct hdr *h, const char *text)
{
    double v[8];
    bool zero = true;

    if (!read_numbers(text, 8, v))
        return false;
    for (int i = 0; i < 8; i++)
        zero = zero && v[i] == 0.0;
    h->has_primaries = !zero;
    h->primaries = (struct chromaticities){ { v[0], v[1] }, { v[2], v[3] }, { v[4], v[5] }, { v[6], v[7] } };
    return true;
}

static int64_t take_time(struct hdr *h, const char *text)
{
    text += strspn(text, " \t");
    const int64_t us = calendar_of_text(text, strlen(text));
    h->bad_time = h->bad_time || us == 0;
    return us;
}

static const char *after(const char *line, const char *key)
{
    const size_t n = strlen(key);

    return strncmp(line, key, n) == 0 ? line + n : NULL;
}

/* Parses one header line. Ignores comments, variables that do not affect radiance, and indented lines, which describe
 * source images. */
static enum err take_line(struct hdr *h, size_t at, const char *line)
{
    const char *value;
    double gamma;

    if ((value = after(line, "FORMAT="))) {
        value += strspn(value, " \t");
        h->xyz = after(value, "32-bit_rle_xyze") != NULL;
        if (!h->xyz && !after(value, "32-bit_rle_rgbe"))
            return say_line(h, at, line, ERR_UNSUPPORTED, "only 32-bit_rle_rgbe and 32-bit_rle_xyze are supported");
    } else if ((value = after(line, "EXPOSURE="))) {
        if (!take_factors(value, 1, &h->exposure))
            return say_line(h, at, line, ERR_FORMAT, "expected one positive number");
    } else if ((value = after(line, "COLORCORR="))) {
        if (!take_factors(value, 3, h->correction))
            return say_line(h, at, line, ERR_FORMAT, "expected three positive numbers");
    } else if ((value = after(line, "PIXASPECT="))) {
        if (!take_factors(value, 1, &h->aspect))
            return say_line(h, at, line, ERR_FORMAT, "expected one positive number");
    } else if ((value = after(line, "PRIMARIES="))) {
        if (!take_primaries(h, value))
            return say_line(h, at, line, ERR_FORMAT, "expected eight numbers");
    } else if ((value = after(line, "CAPDATE="))) {
        h->local_us = take_time(h, value);
    } else if ((value = after(line, "GMT="))) {
        h->utc_us = take_time(h, value);
    } else if ((value = after(line, "GAMMA="))) {
        if (!read_numbers(value, 1, &gamma) || fabs(gamma - 1.0) > 1e-3)
            return say_line(h, at, line, ERR_UNSUPPORTED, "only linear images are supported");
    }
    return ERR_OK;
}

/* Parses an axis and its length: "-Y" runs down, "+X" to the right. */
static bool take_axis(const char **text, char *axis, bool *plus, uint64_t *length)
{
    const char *s = *text;
    char *end;

    if ((s[0] != '-' && s[0] != '+') || (s[1] != 'X' && s[1] != 'Y') || s[2] != ' ')
        return false;
    *plus = s[0] == '+';
    *axis = s[1];
    s += 2 + strspn(s + 2, " ");
    if (*s < '0' || *s > '9')
        return false;
    *length = strtoull(s, &end, 10);
    *text = end + strspn(end, " ");
    return true;
}

static enum err take_resolution(struct hdr *h, size_t at, const char *line)
{
    char axis[2];
    bool plus[2];
    uint64_t length[2];
    char where[512];
    const char *rest = line;

    if (!take_axis(&rest, &axis[0], &plus[0], &length[0]) || !take_axis(&rest, &axis[1], &plus[1], &length[1]) ||
        *rest || axis[0] == axis[1])
        return say_line(h, at, line, ERR_FORMAT, "expected a size such as '-Y 512 +X 1024'");
    h->x_first = axis[0] == 'X';
    h->from_right = !plus[!h->x_first];
    h->from_bottom = plus[h->x_first];
    const uint64_t width = length[!h->x_first], height = length[h->x_first];
    if (width == 0 || height == 0)
        return say_line(h, at, line, ERR_FORMAT, "the image has no texels");
    snprintf(where, sizeof(where), "%s: byte %zu", h->name, at);
    const enum err e = image_check_size(h->into, width, height, where, h->why);
    if (e)
        return e;
    h->width = (uint32_t)width;
    h->height = (uint32_t)height;
    h->scanlines = (uint32_t)length[0];
    h->length = (uint32_t)length[1];
    return ERR_OK;
}

static enum err read_header(struct hdr *h)
{
    char line[LINE_ROOM];
    bool cut;
    size_t at = 0;

    if (!next_line(h, line, sizeof(line), &cut))
        return err_say(h->why, ERR_FORMAT, "%s: byte %zu: the header does not end", h->name, h->size);
    if (!after(line, "#?")) /* any program's name may follow */
        return say_line(h, at, line, ERR_FORMAT, "expected #?RADIANCE or #?RGBE");
    for (;;) {
        at = h->at;
        if (!next_line(h, line, sizeof(line), &cut))
            return err_say(h->why, ERR_FORMAT, "%s: byte %zu: the header does not end", h->name, h->size);
        if (line[0] == '\0' && !cut)
            break;
        const enum err e = take_line(h, at, line);
        if (e)
            return e;
    }
    at = h->at;
    if (!next_line(h, line, sizeof(line), &cut))
        return err_say(h->why, ERR_FORMAT, "%s: byte %zu: the line with the image's size is missing", h->name, h->size);
    return take_resolution(h, at, line);
}

/* The minimum number of bytes of an encoded scan line. Old runs: 255 texels, or 65535 in two steps, after one texel.
 * New runs: 127 values of one plane in two bytes, after four bytes of header. */
static size_t least_scanline(uint32_t length)
{
    const size_t steps = length > 256 ? 3 : length > 1 ? 2 : 1;

    return 4 * steps;
}

static enum err say_cut(const struct hdr *h, uint32_t scanline)
{
    return err_say(h->why, ERR_FORMAT, "%s: scanline %u, byte %zu: the file ends here; expected %u scanlines", h->name,
                   scanline, h->size, h->scanlines);
}

static enum err say_run(const struct hdr *h, uint32_t scanline, size_t count)
{
    return err_say(h->why, ERR_FORMAT, "%s: scanline %u, byte %zu: a run of %zu texels exceeds the row of %u", h->name,
                   scanline, h->at, count, h->length);
}

/* Four planes, each a sequence of runs (128 + count, value) and literals (count, values). */
static enum err read_new_rle(struct hdr *h, uint32_t scanline, struct row *row)
{
    for (int p = 0; p < 4; p++) {
        uint8_t *out = row->plane[p], *const end = out + h->length;
        while (out < end) {
            if (h->size - h->at < 2)
                return say_cut(h, scanline);
            const uint8_t code = h->bytes[h->at];
            const size_t count = code > 128 ? code - 128u : code;
            if (count == 0)
                return err_say(h->why, ERR_FORMAT, "%s: scanline %u, byte %zu: a run of 0 texels", h->name, scanline,
                               h->at);
            if (count > (size_t)(end - out))
                return say_run(h, scanline, count);
            const uint8_t *from = h->bytes + h->at + 1;
            if (code > 128) {
                memset(out, from[0], count);
                h->at += 2;
            } else {
                if (h->size - h->at - 1 < count)
                    return say_cut(h, scanline);
                memcpy(out, from, count);
                h->at += 1 + count;
            }
            out += count;
        }
    }
    return ERR_OK;
}

/* Flat texels of four bytes; (1, 1, 1, n) repeats the previous texel n times, and n counts 256 times as much directly
 * after such a run, then 65536 times. */
static enum err read_old_rle(struct hdr *h, uint32_t scanline, struct row *row)
{
    uint32_t x = 0;
    unsigned shift = 0;

    while (x < h->length) {
        if (h->size - h->at < 4)
            return say_cut(h, scanline);
        const uint8_t *t = h->bytes + h->at;
        if (t[0] == 1 && t[1] == 1 && t[2] == 1) {
            const uint64_t count = shift < 32 ? (uint64_t)t[3] << shift : UINT32_MAX;
            if (x == 0)
                return err_say(h->why, ERR_FORMAT, "%s: scanline %u, byte %zu: a run without a preceding texel",
                               h->name, scanline, h->at);
            if (count > h->length - x)
                return say_run(h, scanline, (size_t)count);
            for (int p = 0; p < 4; p++)
                memset(row->plane[p] + x, row->plane[p][x - 1], (size_t)count);
            x += (uint32_t)count;
            shift += 8;
        } else {
            for (int p = 0; p < 4; p++)
                row->plane[p][x] = t[p];
            x++;
            shift = 0;
        }
        h->at += 4;
    }
    return ERR_OK;
}

/* A new scan line starts with 2, 2 and its own length. No flat texel does, since a normalised texel has a mantissa of
 * at least 128. */
static enum err read_scanline(struct hdr *h, uint32_t scanline, struct row *row)
{
    if (h->length >= NEW_RLE_MIN && h->length <= NEW_RLE_MAX && h->size - h->at >= 4) {
        const uint8_t *t = h->bytes + h->at;
        if (t[0] == 2 && t[1] == 2 && t[2] < 128) {
            const uint32_t length = (uint32_t)t[2] << 8 | t[3];
            if (length != h->length)
                return err_say(h->why, ERR_FORMAT, "%s: scanline %u, byte %zu: has %u texels in an image of %u",
                               h->name, scanline, h->at, length, h->length);
            h->at += 4;
            return read_new_rle(h, scanline, row);
        }
    }
    return read_old_rle(h, scanline, row);
}

/* Mantissa m means m / 256 and not the interval's midpoint (m + 1/2) / 256 that Radiance uses. OpenImageIO, and with it
 * Cycles, which rendered our references, reads it this way; and a stored 0 stays 0. half: what is added to m. */
static void convert(const struct row *row, uint32_t length, float half, float *rgb)
{
    const uint8_t *restrict r = row->plane[0], *restrict g = row->plane[1], *restrict b = row->plane[2];
    const uint8_t *restrict e = row->plane[3];

    for (uint32_t i = 0; i < length; i++) {
        const float scale = row->scale[e[i]];
        rgb[3 * i] = ((float)r[i] + half) * scale;
        rgb[3 * i + 1] = ((float)g[i] + half) * scale;
        rgb[3 * i + 2] = ((float)b[i] + half) * scale;
    }
}

/* Writes texel 0 of the scan line at `first` and each following one `step` texels further. */
static void scatter(const float *rgb, uint32_t length, float *first, ptrdiff_t step)
{
    for (uint32_t i = 0; i < length; i++, first += 3 * step)
        memcpy(first, rgb + 3 * (size_t)i, 3 * sizeof(float));
}

static enum err read_texels(struct hdr *h, const float *to_rec709, struct row *row, struct image *im)
{
    const ptrdiff_t right = h->from_right ? -1 : 1;
    const ptrdiff_t down = h->from_bottom ? -(ptrdiff_t)h->width : (ptrdiff_t)h->width;
    const ptrdiff_t along = h->x_first ? down : right, across = h->x_first ? right : down;
    float *first =
        im->rgb + 3 * ((h->from_right ? h->width - 1 : 0) + (h->from_bottom ? (size_t)(h->height - 1) * h->width : 0));

    for (uint32_t s = 0; s < h->scanlines; s++) {
        const enum err e = read_scanline(h, s, row);
        if (e)
            return e;
        float *const start = first + 3 * across * (ptrdiff_t)s;
        float *const rgb = along == 1 ? start : row->rgb;
        convert(row, h->length, im->middle ? 0.5f : 0.0f, rgb);
        image_sanitise_texels(rgb, h->length, to_rec709, &im->faults);
        if (along != 1)
            scatter(rgb, h->length, start, along);
    }
    return ERR_OK;
}

/* The matrix from the file's primaries to Rec.709, divided by the scaling of the texels. *needed: it is not the
 * identity. */
static enum err colour_matrix(const struct hdr *h, float out[9], bool *needed)
{
    double m[9] = { 1, 0, 0, 0, 1, 0, 0, 0, 1 };

    *needed = h->xyz;
    if (h->xyz) {
        colour_xyz_to_rec709(m);
    } else if (h->has_primaries && !colour_same(&h->primaries, &colour_rec709, SAME_COLOUR)) {
        if (colour_to_rec709(&h->primaries, m))
            return err_say(h->why, ERR_FORMAT, "%s: header: PRIMARIES do not define a colour space", h->name);
        *needed = true;
    }
    for (int i = 0; i < 9; i++) {
        const double divisor = h->exposure * h->correction[i % 3];
        *needed = *needed || divisor != 1.0;
        out[i] = (float)(m[i] / divisor);
        if (!isfinite(out[i]))
            return err_say(h->why, ERR_RANGE, "%s: header: EXPOSURE times COLORCORR is %g, out of range", h->name,
                           divisor);
    }
    return ERR_OK;
}

static enum err row_init(struct row *row, uint32_t length, struct scratch *scratch)
{
    uint8_t *planes = scratch_alloc(scratch, (size_t)length * 4);

    row->plane[0] = planes;
    row->rgb = scratch_alloc(scratch, (size_t)length * 3 * sizeof(float));
    if (!planes || !row->rgb)
        return ERR_NOMEM;
    for (int p = 1; p < 4; p++)
        row->plane[p] = planes + (size_t)p * length;
    for (int e = 1; e < 256; e++)
        row->scale[e] = ldexpf(1.0f, e - 136);
    return ERR_OK;
}

static void finish_image(const struct hdr *h, struct image *im)
{
    image_mend(im);
    image_take_aspect(im, 1.0 / h->aspect);
    im->taken_us = h->utc_us ? h->utc_us : h->local_us;
    if (h->bad_time)
        image_note(im, "its CAPDATE or GMT is no time and is ignored");
}

enum err decode_hdr(const uint8_t *bytes, size_t size, const char *name, struct image *im, struct reason *why)
{
    struct hdr h = { .bytes = bytes,
                     .size = size,
                     .name = name,
                     .into = im,
                     .why = why,
                     .exposure = 1.0,
                     .correction = { 1.0, 1.0, 1.0 },
                     .aspect = 1.0 };
    struct row row = { .rgb = NULL };
    float to_rec709[9];
    bool needed = false;
    enum err e = read_header(&h);

    if (!e)
        e = colour_matrix(&h, to_rec709, &needed);
    if (e)
        return e;
    if (h.size - h.at < h.scanlines * least_scanline(h.length))
        return err_say(why, ERR_FORMAT, "%s: byte %zu: %ux%u texels cannot fit into the remaining %zu bytes", name,
                       h.at, h.width, h.height, h.size - h.at);
    if (!im->scratch)
        im->scratch = scratch_create();
    scratch_begin(im->scratch);
    e = image_resize(im, h.width, h.height);
    if (!e)
        e = row_init(&row, h.length, im->scratch);
    if (e)
        e = err_say(why, e, "%s: out of memory for %ux%u texels", name, h.width, h.height);
    else
        e = read_texels(&h, needed ? to_rec709 : NULL, &row, im);
    if (!e)
        finish_image(&h, im);
    scratch_free(im->scratch, row.rgb);
    scratch_free(im->scratch, row.plane[0]);
    return e;
}
