#include "image/codec/decode.h"

#include "base/luminance.h"
#include "base/mem.h"
#include "image/codec/markers.h"

#include <math.h>
#include <turbojpeg.h>

enum { CODES = 256 };

struct codes {   /* of one of the file's images, [height][width][3] */
    uint8_t *at; /* owned */
    uint32_t width, height;
};

/* The code values of the image that begins at bytes[0]. Its size is checked against the limits of `into`. */
static enum err read_codes(const uint8_t *bytes, size_t size, const char *name, const struct image *into,
                           struct codes *out, struct reason *why)
{
    int width = 0, height, subsampling, colours; /* all unset where a file ends before its image */
    enum err e;

    tjhandle tj = tjInitDecompress();
    if (!tj)
        return err_say(why, ERR_NOMEM, "%s: out of memory", name);
    if (tjDecompressHeader3(tj, bytes, size, &width, &height, &subsampling, &colours))
        e = err_say(why, ERR_FORMAT, "%s: JPEG: %s", name, tjGetErrorStr2(tj));
    else if (width == 0)
        e = err_say(why, ERR_FORMAT, "%s: JPEG: it contains no image", name);
    else if (colours == TJCS_CMYK || colours == TJCS_YCCK)
        e = err_say(why, ERR_UNSUPPORTED, "%s: a CMYK JPEG; convert it to RGB", name);
    else
        e = image_check_size(into, (uint64_t)width, (uint64_t)height, name, why);
    if (e)
        goto done;
    *out = (struct codes){ mem_alloc_raw((size_t)width * (size_t)height, 3), (uint32_t)width, (uint32_t)height };
    if (!out->at)
        e = err_say(why, ERR_NOMEM, "%s: out of memory for its texels", name);
    else if (tjDecompress2(tj, bytes, size, out->at, width, 0, height, TJPF_RGB, TJFLAG_STOPONWARNING))
        e = err_say(why, ERR_FORMAT, "%s: JPEG: %s", name, tjGetErrorStr2(tj));
    if (e) {
        mem_free(out->at);
        *out = (struct codes){ NULL, 0, 0 };
    }
done:
    tjDestroy(tj);
    return e;
}

static void take_codes(const struct codes *codes, struct image *im)
{
    const size_t count = 3 * (size_t)im->width * im->height;
    float light[CODES]; /* 1 for white */

    for (int i = 0; i < CODES; i++)
        light[i] = (float)srgb_decode(i / 255.0);
    for (size_t i = 0; i < count; i++)
        im->rgb[i] = light[codes->at[i]];
}

/* ---- Gain maps: a second JPEG behind the first ---- */

struct gain {
    struct codes map;
    float stops[3][CODES]; /* by channel and code value */
    float base[3], alternate[3];
};

static float stops_at(const struct gain *g, int64_t x, int64_t y, size_t channel)
{
    x = x < 0 ? 0 : x >= g->map.width ? g->map.width - 1 : x;
    y = y < 0 ? 0 : y >= g->map.height ? g->map.height - 1 : y;
    return g->stops[channel][g->map.at[3 * (size_t)(y * g->map.width + x) + channel]];
}

/* Bilinear, as texels have their values in their middles. */
static float gain_at(const struct gain *g, float x, float y, size_t channel)
{
    const float fx = floorf(x), fy = floorf(y), s = x - fx, t = y - fy;
    const int64_t i = (int64_t)fx, j = (int64_t)fy;
    const float above = (1.0f - s) * stops_at(g, i, j, channel) + s * stops_at(g, i + 1, j, channel);
    const float below = (1.0f - s) * stops_at(g, i, j + 1, channel) + s * stops_at(g, i + 1, j + 1, channel);

    return exp2f((1.0f - t) * above + t * below);
}

static void apply_gain(const struct gain *g, struct image *im)
{
    const float per_x = (float)g->map.width / (float)im->width, per_y = (float)g->map.height / (float)im->height;
    float *v = im->rgb;

    for (uint32_t y = 0; y < im->height; y++)
        for (uint32_t x = 0; x < im->width; x++)
            for (size_t c = 0; c < 3; c++, v++) {
                const float gain = gain_at(g, ((float)x + 0.5f) * per_x - 0.5f, ((float)y + 0.5f) * per_y - 0.5f, c);
                *v = fminf(fmaxf((*v + g->base[c]) * gain - g->alternate[c], 0.0f), IMAGE_MAX);
            }
}

/* `bytes` is the map's own JPEG. */
static enum err read_gain(const uint8_t *bytes, size_t size, const char *name, const struct gain_map *m,
                          struct image *im, struct reason *why)
{
    struct gain g;
    double most = 0.0;

    const enum err e = read_codes(bytes, size, name, im, &g.map, why);
    if (e)
        return e;
    for (int c = 0; c < 3; c++) {
        for (int i = 0; i < CODES; i++)
            g.stops[c][i] = (float)(m->low[c] + (m->high[c] - m->low[c]) * pow(i / 255.0, 1.0 / m->gamma[c]));
        g.base[c] = (float)m->base[c];
        g.alternate[c] = (float)m->alternate[c];
        most = fmax(most, m->high[c]);
    }
    apply_gain(&g, im);
    mem_free(g.map.at);
    im->low_range = false;
    image_note(im, "its gain map is applied in full: up to %.3g times white", exp2(most));
    return ERR_OK;
}

/* Images behind the first may be previews or depths: the first with a gain map's metadata is taken. */
static enum err find_gain(const uint8_t *bytes, size_t size, size_t end, const char *name, struct image *im,
                          struct reason *why)
{
    while (end + 4 < size) {
        const uint8_t *next = bytes + end;
        struct markers m;
        struct gain_map g;
        if (next[0] != 0xff || next[1] != 0xd8 || next[2] != 0xff) {
            end++;
            continue;
        }
        markers_of_jpeg(next, size - end, &m);
        if (markers_gain(&m, &g))
            return read_gain(next, m.end, name, &g, im, why);
        end += m.end;
    }
    return ERR_OK;
}

enum err decode_jpeg(const uint8_t *bytes, size_t size, const char *name, struct image *im, struct reason *why)
{
    struct codes codes;
    struct markers m;

    enum err e = read_codes(bytes, size, name, im, &codes, why);
    if (e)
        return e;
    if (image_resize(im, codes.width, codes.height))
        e = err_say(why, ERR_NOMEM, "%s: out of memory for its texels", name);
    else
        take_codes(&codes, im);
    mem_free(codes.at);
    if (e)
        return e;
    im->low_range = true;
    markers_of_jpeg(bytes, size, &m);
    e = find_gain(bytes, size, m.end, name, im, why);
    if (e)
        return e;
    e = markers_place(&m, im);
    return e ? err_say(why, e, "%s: too large as it is to be placed", name) : ERR_OK;
}
