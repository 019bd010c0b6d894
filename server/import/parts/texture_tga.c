/* TGA images [Truevision TGA File Format Specification, version 2.0]: true colour, grey and colour-mapped, also
 * run-length encoded. The format has no signature. */
#include "import/parts/texture_decode.h"

#include <string.h>

enum { HEADER = 18, RUN_LENGTH = 8, MAPPED = 1, TRUE_COLOUR = 2, GREY = 3 };

struct tga {
    const uint8_t *at, *end; /* of what has not been read */
    unsigned kind;           /* MAPPED, TRUE_COLOUR or GREY */
    bool packed, has_alpha, upwards, leftwards;
    uint32_t width, height;
    size_t bytes;       /* per pixel */
    const uint8_t *map; /* of MAPPED */
    size_t map_first, map_count, map_bytes;
};

static unsigned u16(const uint8_t *at)
{
    return at[0] | (unsigned)at[1] << 8;
}

/* Whether a colour of this many bits is one of the format's. */
static bool is_colour(unsigned bits)
{
    return bits == 15 || bits == 16 || bits == 24 || bits == 32;
}

bool tga_recognise(const void *bytes, size_t count)
{
    const uint8_t *h = bytes;

    if (count < HEADER)
        return false;
    const unsigned kind = h[2] & ~(unsigned)RUN_LENGTH, bits = h[16];
    const bool fits = kind == MAPPED        ? h[1] == 1 && bits == 8 && is_colour(h[7])
                      : kind == TRUE_COLOUR ? is_colour(bits)
                                            : kind == GREY && (bits == 8 || bits == 16);
    return fits && h[1] <= 1 && u16(h + 12) > 0 && u16(h + 14) > 0;
}

/* false: the file ends before its pixels. */
static bool read_header(const uint8_t *h, size_t count, struct tga *t)
{
    const size_t map_bytes = h[1] ? (h[7] + 7u) / 8 : 0, skip = HEADER + (size_t)h[0];

    *t = (struct tga){
        .kind = h[2] & ~(unsigned)RUN_LENGTH,
        .packed = h[2] & RUN_LENGTH,
        .leftwards = h[17] & 0x10,
        .upwards = !(h[17] & 0x20),
        .width = u16(h + 12),
        .height = u16(h + 14),
        .bytes = (h[16] + 7u) / 8,
        .map_first = u16(h + 3),
        .map_count = h[1] ? u16(h + 5) : 0,
        .map_bytes = map_bytes,
    };
    t->has_alpha = (h[17] & 0xf) > 0; /* many writers leave the fourth byte undefined, and say so */
    if (count < skip + t->map_count * map_bytes)
        return false;
    t->map = h + skip;
    t->at = t->map + t->map_count * map_bytes;
    t->end = h + count;
    return true;
}

static void put_colour(const uint8_t *from, size_t bytes, bool has_alpha, uint8_t *out)
{
    if (bytes == 2) { /* five bits each */
        const unsigned v = u16(from);
        for (unsigned k = 0; k < 3; k++)
            out[k] = (uint8_t)((v >> (10 - 5 * k) & 31u) * 255u / 31u);
        out[3] = has_alpha && !(v & 0x8000u) ? 0 : UINT8_MAX;
        return;
    }
    out[0] = from[2];
    out[1] = from[1];
    out[2] = from[0];
    out[3] = has_alpha && bytes == 4 ? from[3] : UINT8_MAX;
}

/* false: an index beyond the colour map. */
static bool put_pixel(const struct tga *t, const uint8_t *from, uint8_t *out)
{
    if (t->kind == TRUE_COLOUR) {
        put_colour(from, t->bytes, t->has_alpha, out);
    } else if (t->kind == GREY) {
        memset(out, from[0], 3);
        out[3] = t->has_alpha && t->bytes == 2 ? from[1] : UINT8_MAX;
    } else {
        if (from[0] < t->map_first || from[0] - t->map_first >= t->map_count)
            return false;
        put_colour(t->map + (from[0] - t->map_first) * t->map_bytes, t->map_bytes, t->has_alpha, out);
    }
    return true;
}

/* Reads the pixels in the file's order; false: the file ends before, or has a pixel that put_pixel refuses. */
static bool read_pixels(struct tga *t, uint8_t *texels)
{
    size_t left = 0; /* of a packet */
    bool repeat = false;

    for (uint32_t row = 0; row < t->height; row++) {
        uint8_t *out = texels + 4 * (size_t)t->width * (t->upwards ? t->height - 1 - row : row);
        for (uint32_t column = 0; column < t->width; column++) {
            if (t->packed && left == 0) {
                if (t->at == t->end)
                    return false;
                repeat = *t->at & 0x80;
                left = (size_t)(*t->at++ & 0x7f) + 1;
            }
            left -= t->packed;
            if ((size_t)(t->end - t->at) < t->bytes ||
                !put_pixel(t, t->at, out + 4 * (size_t)(t->leftwards ? t->width - 1 - column : column)))
                return false;
            if (!repeat || left == 0)
                t->at += t->bytes;
        }
    }
    return true;
}

enum err tga_decode(const void *bytes, size_t count, enum texture_values values, const char *name, struct texture *out,
                    struct reason *why)
{
    struct tga t;

    if (!read_header(bytes, count, &t))
        return err_say(why, ERR_FORMAT, "%s: TGA: the file ends before its pixels", name);
    enum err e = texture_check_size(t.width, t.height, name, why);
    if (!e)
        e = texture_init(out, t.width, t.height, values);
    if (!e && !read_pixels(&t, out->texels))
        e = err_say(why, ERR_FORMAT, "%s: TGA: the file is truncated, or a pixel is outside its colour map", name);
    return e;
}
