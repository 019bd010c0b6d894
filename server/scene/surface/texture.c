#include "scene/surface/texture.h"

#include <math.h>

/* A footprint is covered by a row of round filters along its longer axis, at most this many. */
#define TAPS_MAX 16

#define FOLD_MAX 0x1p52 /* beyond, a coordinate has no fraction; such places, and NaN, count as 0 */

/* One level of the pyramid. */
struct level {
    const uint8_t *texels;
    uint32_t width, height;
};

struct texel {
    struct vec3 colour; /* linear */
    float alpha;
};

/* The four texels around a place, and their weights. */
struct quad {
    const uint8_t *texel[4];
    float weight[4];
};

/* floor, without a call: the compiler's baseline has no instruction for it. Of numbers below 2^62. */
static double whole(double x)
{
    const double below = (double)(int64_t)x;
    return below > x ? below - 1.0 : below;
}

/* A coordinate in images folded into one, 0..1. */
static double fold(double x, enum texture_wrap mode)
{
    if (!(fabs(x) < FOLD_MAX))
        return 0.0;
    if (mode == TEXTURE_CLAMP)
        return x < 0.0 ? 0.0 : x < 1.0 ? x : 1.0;
    if (mode == TEXTURE_REPEAT)
        return x - whole(x);
    const double r = x - 2.0 * whole(0.5 * x);
    return r < 1.0 ? r : 2.0 - r;
}

/* The two texels about a coordinate in 0..1, along a side of `size`; returns the share of the second. */
static float between(double x, uint32_t size, enum texture_wrap mode, size_t index[2])
{
    const double at = x * size - 0.5, first = at < 0.0 ? -1.0 : whole(at);
    const uint32_t before = mode == TEXTURE_REPEAT ? size - 1 : 0, behind = mode == TEXTURE_REPEAT ? 0 : size - 1;
    const uint32_t last = (uint32_t)(first + 1.0);

    index[0] = last > 0 ? last - 1 : before;
    index[1] = last < size ? last : behind;
    return (float)(at - first);
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
    size_t x[2], y[2];
    const float fx = between(fold(u, t->wrap_u), l.width, t->wrap_u, x);
    const float fy = between(fold(1.0 - v, t->wrap_v), l.height, t->wrap_v, y);

    out->weight[0] = (1.0f - fx) * (1.0f - fy);
    out->weight[1] = fx * (1.0f - fy);
    out->weight[2] = (1.0f - fx) * fy;
    out->weight[3] = fx * fy;
    out->texel[0] = l.texels + 4 * (y[0] * l.width + x[0]);
    out->texel[1] = l.texels + 4 * (y[0] * l.width + x[1]);
    out->texel[2] = l.texels + 4 * (y[1] * l.width + x[0]);
    out->texel[3] = l.texels + 4 * (y[1] * l.width + x[1]);
}

static struct vec3 decode(const struct texture *t, const uint8_t *texel)
{
    if (t->values == TEXTURE_LINEAR)
        return vec3_scale(vec3_make(texel[0], texel[1], texel[2]), 1.0f / 255.0f);
    return vec3_make(texture_srgb[texel[0]], texture_srgb[texel[1]], texture_srgb[texel[2]]);
}

/* Exact where all four are the same. */
static float quad_alpha(const struct quad *q)
{
    const uint8_t first = q->texel[0][3];
    float sum = 0.0f;

    if (first == q->texel[1][3] && first == q->texel[2][3] && first == q->texel[3][3])
        return (float)first / 255.0f;
    for (int k = 0; k < 4; k++)
        sum += q->weight[k] * (float)q->texel[k][3];
    return sum / 255.0f;
}

static struct texel bilinear(const struct texture *t, struct level l, double u, double v)
{
    struct texel sum = { 0 };
    struct quad q;

    quad_at(t, l, u, v, &q);
    for (int k = 0; k < 4; k++)
        sum.colour = vec3_add(sum.colour, vec3_scale(decode(t, q.texel[k]), q.weight[k]));
    sum.alpha = quad_alpha(&q);
    return sum;
}

static struct texel mix(struct texel a, struct texel b, float share)
{
    return (struct texel){ vec3_add(vec3_scale(a.colour, 1.0f - share), vec3_scale(b.colour, share)),
                           a.alpha + share * (b.alpha - a.alpha) };
}

struct vec3 texture_lookup(const struct texture *t, float u, float v)
{
    return bilinear(t, finest(t), u, v).colour;
}

float texture_alpha(const struct texture *t, float u, float v)
{
    struct quad q;

    quad_at(t, finest(t), u, v, &q);
    return quad_alpha(&q);
}

/* A round filter with the variance of a box of `width` texels of the finest level, w^2 / 12 along an axis. Bilinear
 * lookup of texels of size s has on average s^2 / 12 + s^2 / 6: equal for s = w / sqrt(3). Between two levels, which
 * have s^2 and 4 s^2, variances are linear. */
static struct texel trilinear(const struct texture *t, double width, double u, double v)
{
    const double most = texture_level_count(t->width, t->height) - 1;
    const double lod = fmin(fmax(floor(log2(width / sqrt(3.0))), 0.0), most);
    const double size = width / sqrt(3.0) / exp2(lod); /* in texels of that level */
    const float share = lod < most ? (float)fmax((size * size - 1.0) / 3.0, 0.0) : 0.0f;
    struct level l = finest(t);

    for (int i = 0; i < (int)lod; i++)
        l = next_level(l);
    const struct texel fine = bilinear(t, l, u, v);
    if (share <= 0.0f)
        return fine;
    return mix(fine, bilinear(t, next_level(l), u, v), share);
}

static struct texel filter(const struct texture *t, float u, float v, const float step[2][2])
{
    const double edge[2][2] = { { (double)step[0][0] * t->width, (double)step[0][1] * t->height },
                                { (double)step[1][0] * t->width, (double)step[1][1] * t->height } };
    const double length[2] = { hypot(edge[0][0], edge[0][1]), hypot(edge[1][0], edge[1][1]) };
    const int longer = length[1] > length[0];
    const double major = length[longer];
    struct texel sum = { 0 };

    if (!isfinite(u) || !isfinite(v) || !isfinite(major) || major <= 1.0)
        return bilinear(t, finest(t), u, v);
    /* The width across the longer edge. If that is much narrower, several filters cover the length. */
    const double minor = fabs(edge[0][0] * edge[1][1] - edge[0][1] * edge[1][0]) / major;
    const double width = fmax(fmax(minor, 1.0), major / TAPS_MAX);
    const int taps = (int)fmin(ceil(major / width), TAPS_MAX);
    for (int i = 0; i < taps; i++) {
        const double at = (i + 0.5) / taps - 0.5;
        const struct texel one =
            trilinear(t, width, (double)u + at * (double)step[longer][0], (double)v + at * (double)step[longer][1]);
        sum = mix(sum, one, 1.0f / (float)(i + 1)); /* the mean so far */
    }
    return sum;
}

struct vec3 texture_filter(const struct texture *t, float u, float v, const float step[2][2])
{
    return filter(t, u, v, step).colour;
}

float texture_filter_alpha(const struct texture *t, float u, float v, const float step[2][2])
{
    return filter(t, u, v, step).alpha;
}

void texture_alpha_limits(const struct texture *t, float *low, float *high)
{
    const size_t count = (size_t)t->width * t->height;
    uint8_t least = UINT8_MAX, most = 0;

    for (size_t i = 0; i < count; i++) {
        const uint8_t a = t->texels[4 * i + 3];
        least = a < least ? a : least;
        most = a > most ? a : most;
    }
    *low = (float)least / 255.0f;
    *high = (float)most / 255.0f;
}

/* The four texels around a place reach at least half a texel from it in each direction. */
void texture_alpha_around(const struct texture *t, float u, float v, float width, float *low, float *high)
{
    const int most = (int)texture_level_count(t->width, t->height) - 1;
    const int lod = width > 0.5f ? (int)fminf(ceilf(log2f(2.0f * width)), (float)most) : 0;
    struct level l = finest(t);
    struct quad q;

    for (int i = 0; i < lod; i++)
        l = next_level(l);
    quad_at(t, l, u, v, &q);
    *low = 1.0f;
    *high = 0.0f;
    for (int k = 0; k < 4; k++) {
        *low = fminf(*low, (float)q.texel[k][3] / 255.0f);
        *high = fmaxf(*high, (float)q.texel[k][3] / 255.0f);
    }
}
