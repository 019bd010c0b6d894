#include "filter/filter_kernel.h"

#include <string.h>

#define UNLIKE 9.0f       /* squared difference, in variances, from which light is not mixed */
#define PLANE_WIDTHS 2.0f /* s, in widths of a step */

struct sums {
    float weight[2][FILTER_COUNT_MAX];
    float light[6][FILTER_COUNT_MAX];
    float squares[FILTER_COUNT_MAX], variance[FILTER_COUNT_MAX];
};

/* Pixels of a row whose neighbour dx away is in the picture. */
struct span {
    uint32_t first, end; /* of the points */
    ptrdiff_t tap;       /* index of the first point's neighbour, as if it were there */
};

static bool span_of(const struct filter_picture *p, const struct filter_points *at, int dx, int dy, struct span *out)
{
    const int64_t y = (int64_t)at->y + dy, x = (int64_t)at->x + dx;

    if (y < 0 || y >= (int64_t)p->height)
        return false;
    const int64_t first = x < 0 ? -x : 0, end = (int64_t)p->width - x;
    out->first = (uint32_t)(first < at->count ? first : at->count);
    out->end = (uint32_t)(end < 0 ? 0 : end < at->count ? end : at->count);
    out->tap = (ptrdiff_t)((size_t)y * p->pitch) + (ptrdiff_t)x;
    return out->first < out->end;
}

static inline float positive(float x)
{
    return x > 0.0f ? x : 0.0f;
}

/* The factor of a weight that depends on the surfaces. a and b are planes, read at i and k. */
static inline float likeness(const float *const a[], uint32_t i, const float *const b[], ptrdiff_t k, float reach)
{
    const float *const *n = a + SURFACE_NORMAL, *const *m = b + SURFACE_NORMAL;
    const float *const *u = a + SURFACE_PLACE, *const *v = b + SURFACE_PLACE;
    float c = positive(n[0][i] * m[0][k] + n[1][i] * m[1][k] + n[2][i] * m[2][k]);
    const float off = n[0][i] * (v[0][k] - u[0][i]) + n[1][i] * (v[1][k] - u[1][i]) + n[2][i] * (v[2][k] - u[2][i]);
    const float s = off / (reach * a[SURFACE_WIDTH][i]);

    c *= c; /* 2 */
    c *= c;
    c *= c;
    c *= c;
    c *= c;
    c *= c; /* 64 */
    return a[SURFACE_KIND][i] == b[SURFACE_KIND][k] ? c * positive(1.0f - s * s) : 0.0f;
}

/* The part that the light of half h gives. */
static inline float alike(const float *const a[], uint32_t i, const float *const b[], ptrdiff_t k, int h, float noise)
{
    float d = 0.0f;

    for (int c = 3 * h; c < 3 * h + 3; c++) {
        const float x = a[c][i] - b[c][k];
        d += x * x;
    }
    const float w = positive(1.0f - d / noise);
    return w * w;
}

static void add_tap(const struct filter_picture *p, const struct filter_points *at, const struct span *s, float h,
                    float reach, struct sums *sum)
{
#pragma omp simd
    for (uint32_t i = s->first; i < s->end; i++) {
        const ptrdiff_t k = s->tap + (ptrdiff_t)i;
        const float g = h * likeness(at->surface, i, p->surface, k, reach);
        const float noise = UNLIKE * (at->light[LIGHT_VARIANCE][i] + p->light[LIGHT_VARIANCE][k]) + 1e-30f;
        const float a = g * alike(at->light, i, p->light, k, 1, noise);
        const float b = g * alike(at->light, i, p->light, k, 0, noise);
        sum->weight[0][i] += a;
        sum->weight[1][i] += b;
        for (int c = 0; c < 3; c++) {
            sum->light[c][i] += a * p->light[c][k];
            sum->light[3 + c][i] += b * p->light[3 + c][k];
        }
        sum->variance[i] += a * b * p->light[LIGHT_VARIANCE][k];
    }
}

static void clear(struct sums *sum, uint32_t count)
{
    for (int k = 0; k < 2; k++)
        memset(sum->weight[k], 0, count * sizeof(float));
    for (int k = 0; k < 6; k++)
        memset(sum->light[k], 0, count * sizeof(float));
    memset(sum->variance, 0, count * sizeof(float));
}

static void level(const struct filter_picture *p, const struct filter_points *at, uint32_t step)
{
    static const float spline[2 * FILTER_RADIUS + 1] = { 1.0f / 16, 4.0f / 16, 6.0f / 16, 4.0f / 16, 1.0f / 16 };
    const float reach = PLANE_WIDTHS * (float)step;
    struct sums sum;
    struct span s;

    clear(&sum, at->count);
    for (int dy = -FILTER_RADIUS; dy <= FILTER_RADIUS; dy++)
        for (int dx = -FILTER_RADIUS; dx <= FILTER_RADIUS; dx++)
            if (span_of(p, at, dx * (int)step, dy * (int)step, &s))
                add_tap(p, at, &s, spline[dx + FILTER_RADIUS] * spline[dy + FILTER_RADIUS], reach, &sum);
    for (uint32_t i = 0; i < at->count; i++) {
        for (int c = 0; c < 6; c++)
            at->out[c][i] = sum.weight[c / 3][i] > 0.0f ? sum.light[c][i] / sum.weight[c / 3][i] : at->light[c][i];
        const float w = sum.weight[0][i] * sum.weight[1][i];
        at->out[LIGHT_VARIANCE][i] = w > 0.0f ? sum.variance[i] / w : at->light[LIGHT_VARIANCE][i];
    }
}

static void spread_tap(const struct filter_picture *p, const struct filter_points *at, const struct span *s,
                       struct sums *sum)
{
#pragma omp simd
    for (uint32_t i = s->first; i < s->end; i++) {
        const ptrdiff_t k = s->tap + (ptrdiff_t)i;
        const float w = likeness(at->surface, i, p->surface, k, PLANE_WIDTHS);
        sum->weight[0][i] += w;
        sum->variance[i] += w * p->light[LIGHT_VARIANCE][k];
    }
}

static void spread(const struct filter_picture *p, const struct filter_points *at)
{
    struct sums sum;
    struct span s;

    clear(&sum, at->count);
    for (int dy = -SPREAD_RADIUS; dy <= SPREAD_RADIUS; dy++)
        for (int dx = -SPREAD_RADIUS; dx <= SPREAD_RADIUS; dx++)
            if (span_of(p, at, dx, dy, &s))
                spread_tap(p, at, &s, &sum);
    for (uint32_t i = 0; i < at->count; i++)
        at->out[LIGHT_VARIANCE][i] =
            sum.weight[0][i] > 0.0f ? sum.variance[i] / sum.weight[0][i] : at->light[LIGHT_VARIANCE][i];
}

extern const struct filter_kernel KERNEL(filter_kernel);
const struct filter_kernel KERNEL(filter_kernel) = { KERNEL_CPU, level, spread };
