#include "light/denoise/filter_kernel.h"

#include <string.h>

#define UNLIKE 9.0f       /* squared difference, in variances, from which light is not mixed */
#define PLANE_WIDTHS 2.0f /* s, in widths of a step */
#define NO_POINT -1.0f    /* kinds that equal no other */
#define NO_NEIGHBOUR -2.0f
#define LEAST 1e-15f /* weight: light times the square of it is still a normal number */

#define PLANES (SURFACE_PLANES + LIGHT_PLANES)
#define LIGHT SURFACE_PLANES /* the first of light among them */
#define ROW_MOST (FILTER_COUNT_MAX + 2 * FILTER_RADIUS * (1 << (FILTER_LEVELS - 1)))
#define ALIGN 64 /* a vector of AVX-512 */
#define LANES 16 /* loops run over multiples of this: no remainders */

/* Sums over the neighbours: light and variance, planes as LIGHT_, and the weights of both halves. */
enum { SUM_WEIGHT = LIGHT_PLANES, SUMS = LIGHT_PLANES + 2 };

/* Where the pixels of such points are. */
struct places {
    uint32_t x[FILTER_COUNT_MAX], y[FILTER_COUNT_MAX];
};

/* What the inner loops read and write, copied together: planes at constant distances leave registers for the sums. */
struct tile {
    _Alignas(ALIGN) float own[PLANES][FILTER_COUNT_MAX]; /* the points; for their width, 1 / s */
    _Alignas(ALIGN) float near[PLANES][ROW_MOST];        /* a row of the image around them */
    _Alignas(ALIGN) float sum[SUMS][FILTER_COUNT_MAX];
    uint32_t count; /* of the points, rounded up to LANES */
};

/* planes: SURFACE_PLANES without the light. Points beyond at->count have the kind of none. */
static void put_own(struct tile *t, const struct filter_points *at, int planes, float reach)
{
    t->count = (at->count + LANES - 1) / LANES * LANES;
    for (int k = 0; k < SUMS; k++)
        memset(t->sum[k], 0, t->count * sizeof(float));
    for (int k = 0; k < planes; k++) {
        memcpy(t->own[k], k < LIGHT ? at->surface[k] : at->light[k - LIGHT], at->count * sizeof(float));
        for (uint32_t i = at->count; i < t->count; i++)
            t->own[k][i] = k == SURFACE_KIND ? NO_POINT : k == SURFACE_WIDTH ? 1.0f : 0.0f;
    }
    for (uint32_t i = 0; i < t->count; i++)
        t->own[SURFACE_WIDTH][i] = 1.0f / (reach * t->own[SURFACE_WIDTH][i]);
}

/* Row y from column x - beside on, until `beside` columns after the last point. Columns outside the image have the
 * kind of none. false: the whole row is outside. */
static bool put_near(struct tile *t, const struct filter_image *p, const struct filter_points *at, int planes, int dy,
                     uint32_t beside)
{
    const int64_t y = (int64_t)at->y + dy, x = (int64_t)at->x - beside;
    const uint32_t wide = at->count + 2 * beside;

    if (y < 0 || y >= (int64_t)p->height)
        return false;
    const uint32_t first = x < 0 ? (uint32_t)-x : 0;
    const uint32_t end = x + wide > (int64_t)p->width ? (uint32_t)((int64_t)p->width - x) : wide;
    const size_t from = (size_t)y * p->pitch + (size_t)(x + first);
    for (int k = 0; k < planes; k++) {
        const float none = k == SURFACE_KIND ? NO_NEIGHBOUR : 0.0f;
        for (uint32_t i = 0; i < first; i++)
            t->near[k][i] = none;
        memcpy(t->near[k] + first, (k < LIGHT ? p->surface[k] : p->light[k - LIGHT]) + from,
               (end - first) * sizeof(float));
        for (uint32_t i = end; i < wide; i++)
            t->near[k][i] = none;
    }
    return true;
}

/* The neighbours at a distance of dx, dy from each point's pixel. */
static void put_near_each(struct tile *t, const struct filter_image *p, const struct places *at, int dx, int dy)
{
    uint32_t from[FILTER_COUNT_MAX];

    for (uint32_t i = 0; i < t->count; i++) {
        const uint32_t x = at->x[i] + (uint32_t)dx, y = at->y[i] + (uint32_t)dy;
        from[i] = x < p->width && y < p->height ? y * (uint32_t)p->pitch + x : UINT32_MAX;
    }
    for (int k = 0; k < PLANES; k++) {
        const float *plane = k < LIGHT ? p->surface[k] : p->light[k - LIGHT];
        for (uint32_t i = 0; i < t->count; i++)
            t->near[k][i] = plane[from[i] == UINT32_MAX ? 0 : from[i]];
    }
    for (uint32_t i = 0; i < t->count; i++)
        t->near[SURFACE_KIND][i] = from[i] == UINT32_MAX ? NO_NEIGHBOUR : t->near[SURFACE_KIND][i];
}

static inline float positive(float x)
{
    return x > 0.0f ? x : 0.0f;
}

/* The factor of a weight that depends on the surfaces, of point i and neighbour k. */
static inline float likeness(const struct tile *t, size_t i, size_t k)
{
    const float(*a)[FILTER_COUNT_MAX] = t->own;
    const float(*b)[ROW_MOST] = t->near;
    float c = 0.0f, off = 0.0f;

    for (int d = 0; d < 3; d++) {
        c += a[SURFACE_NORMAL + d][i] * b[SURFACE_NORMAL + d][k];
        off += a[SURFACE_NORMAL + d][i] * (b[SURFACE_PLACE + d][k] - a[SURFACE_PLACE + d][i]);
    }
    const float s = off * a[SURFACE_WIDTH][i];
    c = positive(c);
    c *= c; /* 2 */
    c *= c;
    c *= c;
    c *= c;
    c *= c;
    c *= c; /* 64 */
    return a[SURFACE_KIND][i] == b[SURFACE_KIND][k] ? c * positive(1.0f - s * s) : 0.0f;
}

/* The part that the light of half h gives. per_noise: 1 over UNLIKE times the variances. */
static inline float alike(const struct tile *t, size_t i, size_t k, int h, float per_noise)
{
    float d = 0.0f;

    for (int c = LIGHT + 3 * h; c < LIGHT + 3 * h + 3; c++) {
        const float x = t->own[c][i] - t->near[c][k];
        d += x * x;
    }
    const float w = positive(1.0f - d * per_noise);
    return w * w;
}

/* Adds a neighbour of each point, from index `from` of the row on. */
static inline void add_tap(struct tile *t, size_t from, float h)
{
#pragma omp simd
    for (size_t i = 0; i < t->count; i++) {
        const size_t k = from + i;
        const float v = t->near[LIGHT + LIGHT_VARIANCE][k];
        const float g = h * likeness(t, i, k);
        const float per_noise = 1.0f / (UNLIKE * (t->own[LIGHT + LIGHT_VARIANCE][i] + v) + 1e-30f);
        const float a = g * alike(t, i, k, 1, per_noise);
        const float b = g * alike(t, i, k, 0, per_noise);
        t->sum[SUM_WEIGHT][i] += a;
        t->sum[SUM_WEIGHT + 1][i] += b;
        for (int c = 0; c < 3; c++) {
            t->sum[c][i] += a * t->near[LIGHT + c][k];
            t->sum[3 + c][i] += b * t->near[LIGHT + 3 + c][k];
        }
        t->sum[LIGHT_VARIANCE][i] += a * b * v;
    }
}

/* Writes a sum over its weight, or what the points had where hardly anything has weight: where all neighbours are
 * turned away, the product of weight and light may be too small for a float. */
static void put_out(const struct filter_points *at, int plane, const float *sum, const float *weight, float least,
                    const float *had)
{
    float *out = at->out[plane];

#pragma omp simd
    for (uint32_t i = 0; i < at->count; i++)
        out[i] = weight[i] > least ? sum[i] / weight[i] : had[i];
}

static void level(const struct filter_image *p, const struct filter_points *at, uint32_t step)
{
    static const float spline[2 * FILTER_RADIUS + 1] = { 1.0f / 16, 4.0f / 16, 6.0f / 16, 4.0f / 16, 1.0f / 16 };
    struct tile t;
    struct places own;

    put_own(&t, at, PLANES, PLANE_WIDTHS * (float)step);
    for (uint32_t i = 0; i < t.count && at->pixel; i++) {
        const uint32_t pixel = at->pixel[i < at->count ? i : 0];
        own.x[i] = pixel % p->width;
        own.y[i] = pixel / p->width;
    }
    for (int dy = 0; dy <= 2 * FILTER_RADIUS; dy++) {
        const int down = (dy - FILTER_RADIUS) * (int)step;
        if (!at->pixel && !put_near(&t, p, at, PLANES, down, FILTER_RADIUS * step))
            continue;
        for (int dx = 0; dx <= 2 * FILTER_RADIUS; dx++) {
            if (at->pixel)
                put_near_each(&t, p, &own, (dx - FILTER_RADIUS) * (int)step, down);
            add_tap(&t, at->pixel ? 0 : (size_t)dx * step, spline[dx] * spline[dy]);
        }
    }
    for (int c = 0; c < 6; c++)
        put_out(at, c, t.sum[c], t.sum[SUM_WEIGHT + c / 3], LEAST, t.own[LIGHT + c]);
    for (uint32_t i = 0; i < t.count; i++)
        t.sum[SUM_WEIGHT][i] *= t.sum[SUM_WEIGHT + 1][i];
    put_out(at, LIGHT_VARIANCE, t.sum[LIGHT_VARIANCE], t.sum[SUM_WEIGHT], LEAST * LEAST, t.own[LIGHT + LIGHT_VARIANCE]);
}

static void spread_tap(struct tile *t, size_t from)
{
#pragma omp simd
    for (size_t i = 0; i < t->count; i++) {
        const float w = likeness(t, i, from + i);
        t->sum[SUM_WEIGHT][i] += w;
        t->sum[LIGHT_VARIANCE][i] += w * t->near[LIGHT + LIGHT_VARIANCE][from + i];
    }
}

static void spread(const struct filter_image *p, const struct filter_points *at)
{
    struct tile t;

    put_own(&t, at, SURFACE_PLANES, PLANE_WIDTHS);
    for (int dy = -SPREAD_RADIUS; dy <= SPREAD_RADIUS; dy++) {
        if (!put_near(&t, p, at, PLANES, dy, SPREAD_RADIUS))
            continue;
        for (uint32_t dx = 0; dx <= 2 * SPREAD_RADIUS; dx++)
            spread_tap(&t, dx);
    }
    put_out(at, LIGHT_VARIANCE, t.sum[LIGHT_VARIANCE], t.sum[SUM_WEIGHT], LEAST, at->light[LIGHT_VARIANCE]);
}

extern const struct filter_kernel KERNEL(filter_kernel);
const struct filter_kernel KERNEL(filter_kernel) = { KERNEL_CPU, level, spread };
