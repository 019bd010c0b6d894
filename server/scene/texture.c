#include "scene/texture_parts.h"

#include <math.h>

/* A footprint is covered by a row of round filters along its longer axis, at most this many. */
#define TAPS_MAX 16

/* One level of the pyramid. */
struct level {
    const uint8_t *texels;
    uint32_t width, height;
};

/* The four texels around a place, and their weights. */
struct quad {
    const uint8_t *texel[4];
    float weight[4];
};

/* The texel of index x, a whole number, along a side of `size`. */
static uint32_t wrap(double x, uint32_t size, enum texture_wrap mode)
{
    if (mode == TEXTURE_CLAMP)
        return x < 0.0 ? 0 : x < size ? (uint32_t)x : size - 1;
    const double period = mode == TEXTURE_MIRROR ? 2.0 * size : size;
    const double r = x - floor(x / period) * period;
    const uint32_t i = r >= 0.0 && r < period ? (uint32_t)r : 0; /* rounding of a huge x */
    return i < size ? i : 2 * size - 1 - i;
}

/* The level after this one. */
static struct level next_level(struct level l)
{
    return (struct level){ l.texels + 4 * (size_t)l.width * l.height, texture_level_side(l.width, 1),
                           texture_level_side(l.height, 1) };
}

static struct level finest(const struct texture *t)
{
    return (struct level){ t->texels, t->width, t->height };
}

static void quad_at(const struct texture *t, struct level l, double u, double v, struct quad *out)
{
    const double x = u * l.width - 0.5, y = (1.0 - v) * l.height - 0.5;
    const double left = floor(x), top = floor(y);
    const float fx = (float)(x - left), fy = (float)(y - top);
    const size_t x0 = wrap(left, l.width, t->wrap_u), x1 = wrap(left + 1.0, l.width, t->wrap_u);
    const size_t y0 = wrap(top, l.height, t->wrap_v), y1 = wrap(top + 1.0, l.height, t->wrap_v);

    out->weight[0] = (1.0f - fx) * (1.0f - fy);
    out->weight[1] = fx * (1.0f - fy);
    out->weight[2] = (1.0f - fx) * fy;
    out->weight[3] = fx * fy;
    out->texel[0] = l.texels + 4 * (y0 * l.width + x0);
    out->texel[1] = l.texels + 4 * (y0 * l.width + x1);
    out->texel[2] = l.texels + 4 * (y1 * l.width + x0);
    out->texel[3] = l.texels + 4 * (y1 * l.width + x1);
}

static struct vec3 decode(const struct texture *t, const uint8_t *texel)
{
    if (t->values == TEXTURE_LINEAR)
        return vec3_scale(vec3_make(texel[0], texel[1], texel[2]), 1.0f / 255.0f);
    return vec3_make(texture_srgb[texel[0]], texture_srgb[texel[1]], texture_srgb[texel[2]]);
}

static struct vec3 bilinear(const struct texture *t, struct level l, double u, double v)
{
    struct vec3 sum = { 0 };
    struct quad q;

    quad_at(t, l, u, v, &q);
    for (int k = 0; k < 4; k++)
        sum = vec3_add(sum, vec3_scale(decode(t, q.texel[k]), q.weight[k]));
    return sum;
}

struct vec3 texture_lookup(const struct texture *t, float u, float v)
{
    if (!isfinite(u) || !isfinite(v))
        u = v = 0.0f;
    return bilinear(t, finest(t), u, v);
}

float texture_alpha(const struct texture *t, float u, float v)
{
    float sum = 0.0f;
    struct quad q;

    if (!isfinite(u) || !isfinite(v))
        u = v = 0.0f;
    quad_at(t, finest(t), u, v, &q);
    for (int k = 0; k < 4; k++)
        sum += q.weight[k] * (float)q.texel[k][3];
    return sum / 255.0f;
}

/* A round filter with the variance of a box of `width` texels of the finest level, w^2 / 12 along an axis. Bilinear
 * lookup of texels of size s has on average s^2 / 12 + s^2 / 6: equal for s = w / sqrt(3). Between two levels, which
 * have s^2 and 4 s^2, variances are linear. */
static struct vec3 trilinear(const struct texture *t, double width, double u, double v)
{
    const double most = texture_level_count(t->width, t->height) - 1;
    const double lod = fmin(fmax(floor(log2(width / sqrt(3.0))), 0.0), most);
    const double size = width / sqrt(3.0) / exp2(lod); /* in texels of that level */
    const float share = lod < most ? (float)fmax((size * size - 1.0) / 3.0, 0.0) : 0.0f;
    struct level l = finest(t);

    for (int i = 0; i < (int)lod; i++)
        l = next_level(l);
    const struct vec3 fine = bilinear(t, l, u, v);
    if (share <= 0.0f)
        return fine;
    return vec3_add(vec3_scale(fine, 1.0f - share), vec3_scale(bilinear(t, next_level(l), u, v), share));
}

struct vec3 texture_filter(const struct texture *t, float u, float v, const float step[2][2])
{
    const double edge[2][2] = { { (double)step[0][0] * t->width, (double)step[0][1] * t->height },
                                { (double)step[1][0] * t->width, (double)step[1][1] * t->height } };
    const double length[2] = { hypot(edge[0][0], edge[0][1]), hypot(edge[1][0], edge[1][1]) };
    const int longer = length[1] > length[0];
    const double major = length[longer];
    struct vec3 sum = { 0 };

    if (!isfinite(u) || !isfinite(v) || !isfinite(major) || major <= 1.0)
        return texture_lookup(t, u, v);
    /* The width across the longer edge. If that is much narrower, several filters cover the length. */
    const double minor = fabs(edge[0][0] * edge[1][1] - edge[0][1] * edge[1][0]) / major;
    const double width = fmax(fmax(minor, 1.0), major / TAPS_MAX);
    const int taps = (int)fmin(ceil(major / width), TAPS_MAX);
    for (int i = 0; i < taps; i++) {
        const double at = (i + 0.5) / taps - 0.5;
        sum = vec3_add(sum, trilinear(t, width, (double)u + at * (double)step[longer][0],
                                      (double)v + at * (double)step[longer][1]));
    }
    return vec3_scale(sum, 1.0f / (float)taps);
}
