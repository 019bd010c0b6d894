#include "sky/tables/pyramid.h"

#include "base/mem.h"
#include "sky/tables/cube.h"

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <string.h>

#define FIT_MAX 32   /* in finer levels the correction is below 1 % */
#define FIT_STEPS 4  /* per texel, but at least this many on a face */
#define FIT_MIN 64   /* steps on a face */
#define FIT_ROUNDS 8 /* reach 0.4 %: see fit_gains */
#define FIT_PACE 1.7 /* exponent of a round's corrections: above 1 they need a third of the rounds */

/* Which of n fine texels coarse texel `to` of m covers: first .. last - 1, wholly or partly. In units of 1/m fine texel
 * all borders are integers. */
struct span {
    uint32_t first, last;
    float part[3];
};

static struct span cover(uint32_t n, uint32_t m, uint32_t to)
{
    const uint32_t low = to * n, high = low + n; /* at most 1024 * 1024 */

    if (n == 2 * m)
        return (struct span){ 2 * to, 2 * to + 2, { 1.0f, 1.0f, 0.0f } };
    struct span s = { low / m, (high + m - 1) / m, { 0.0f } };
    for (uint32_t k = s.first; k < s.last; k++) {
        const uint32_t a = k * m > low ? k * m : low, b = (k + 1) * m < high ? (k + 1) * m : high;
        s.part[k - s.first] = (float)(b - a) / (float)m;
    }
    return s;
}

/* Solid angles and their parts add up over a level. */
static void sum_solid_angles(const struct pyramid_level *fine, struct pyramid_level *coarse)
{
    for (uint32_t i = 0; i < coarse->n; i++)
        for (uint32_t j = 0; j < coarse->n; j++) {
            const struct span y = cover(fine->n, coarse->n, i), x = cover(fine->n, coarse->n, j);
            double sum = 0.0;
            for (uint32_t r = y.first; r < y.last; r++)
                for (uint32_t c = x.first; c < x.last; c++)
                    sum += (double)y.part[r - y.first] * (double)x.part[c - x.first] *
                           (double)fine->solid_angle[r * fine->n + c];
            coarse->solid_angle[i * coarse->n + j] = (float)sum;
        }
}

/* A texel of a bilinear lookup. */
struct tap {
    uint32_t face, row, column;
    float weight;
};

/* The texel beyond the border of a face. On the neighbour beyond u = +-1, which lies on the face's u axis, u runs along
 * the face's v, and v along the face's own axis; beyond v = +-1 it is the reverse. Both faces divide their common edge
 * in the same way. */
static struct tap beyond_u(uint32_t n, uint32_t face, uint32_t row, bool positive, float weight)
{
    return (struct tap){ 2 * ((face / 2 + 1) % 3) + !positive, face & 1 ? 0 : n - 1, row, weight };
}

static struct tap beyond_v(uint32_t n, uint32_t face, uint32_t column, bool positive, float weight)
{
    return (struct tap){ 2 * ((face / 2 + 2) % 3) + !positive, column, face & 1 ? 0 : n - 1, weight };
}

/* Texel (i, j) of a face, either of which may lie one step outside. If both do, at a corner of the cube, there is no
 * such texel: all three faces use the mean of their own three corner texels instead, and so agree. Returns the number
 * of taps. */
static int place_tap(uint32_t n, uint32_t face, int64_t i, int64_t j, float weight, struct tap *out)
{
    const bool out_i = i < 0 || i >= n, out_j = j < 0 || j >= n;
    const uint32_t row = (uint32_t)(i < 0    ? 0
                                    : i >= n ? n - 1
                                             : i),
                   column = (uint32_t)(j < 0    ? 0
                                       : j >= n ? n - 1
                                                : j);

    if (out_i && out_j) {
        out[0] = (struct tap){ face, row, column, weight / 3.0f };
        out[1] = beyond_u(n, face, row, j > 0, weight / 3.0f);
        out[2] = beyond_v(n, face, column, i > 0, weight / 3.0f);
        return 3;
    }
    out[0] = out_i   ? beyond_v(n, face, column, i > 0, weight)
             : out_j ? beyond_u(n, face, row, j > 0, weight)
                     : (struct tap){ face, row, column, weight };
    return 1;
}

/* Between which texels, `first` and the next, a coordinate of -1..1 lies, and how far: texel centres are at
 * half-integers. */
struct between {
    float first, part;
};

static struct between find_between(uint32_t n, float u)
{
    const float half = 0.5f * (float)n;
    const float x = (u + 1.0f) * half - 0.5f, first = floorf(x);

    return (struct between){ first, x - first };
}

static void bilinear_weights(const struct between *x, const struct between *y, float out[4])
{
    const float fx = x->part, fy = y->part;

    out[0] = (1 - fx) * (1 - fy);
    out[1] = fx * (1 - fy);
    out[2] = (1 - fx) * fy;
    out[3] = fx * fy;
}

/* The taps of a face, at most 6 (12 at n = 1), with weights that sum to 1. */
static int find_taps(uint32_t n, uint32_t face, const struct between *x, const struct between *y, struct tap out[12])
{
    float weight[4];
    int count = 0;

    bilinear_weights(x, y, weight);
    for (int k = 0; k < 4; k++)
        count += place_tap(n, face, (int64_t)y->first + (k >> 1), (int64_t)x->first + (k & 1), weight[k], out + count);
    return count;
}

/* The representative of all texels that are equivalent under rotations and reflections of the cube. */
static size_t alike(uint32_t n, uint32_t row, uint32_t column)
{
    const uint32_t i = row < n - 1 - row ? row : n - 1 - row, j = column < n - 1 - column ? column : n - 1 - column;
    return (size_t)(i < j ? i : j) * n + (i < j ? j : i);
}

/* Gains of a level while they are fitted, by steps x steps places of a face: a sixth of the sphere stands for all. */
struct fitting {
    uint32_t steps;
    double *solid_angle;     /* [steps][steps] */
    struct between *between; /* [steps] */
    double *spread, *want;   /* [n][n], of representatives: solid angles over which light spreads, and the right ones */
};

/* The solid angle, sr, over which equivalent texels spread their light. Away from borders, taps are four neighbours. */
static void sum_spread(const struct pyramid_level *l, const struct fitting *f)
{
    const uint32_t n = l->n;

    for (uint32_t at = 0; at < f->steps * f->steps; at++) {
        const struct between *x = &f->between[at % f->steps], *y = &f->between[at / f->steps];
        struct tap taps[12];
        double gained[12], whole = 0.0;
        int count = 4;
        if (x->first >= 0.0f && y->first >= 0.0f && x->first + 1.0f < (float)n && y->first + 1.0f < (float)n) {
            float weight[4];
            bilinear_weights(x, y, weight);
            for (uint32_t k = 0; k < 4; k++)
                taps[k] = (struct tap){ 0, (uint32_t)y->first + (k >> 1), (uint32_t)x->first + (k & 1), weight[k] };
        } else {
            count = find_taps(n, 0, x, y, taps);
        }
        for (int k = 0; k < count; k++) {
            gained[k] = (double)l->gain[taps[k].row * n + taps[k].column];
            whole += (double)taps[k].weight * gained[k];
        }
        for (int k = 0; k < count; k++)
            f->spread[alike(n, taps[k].row, taps[k].column)] +=
                f->solid_angle[at] * (double)taps[k].weight * gained[k] / whole;
    }
}

/* With plain bilinear weights, a texel at an edge of the cube would contribute more than its solid angle, since texels
 * grow towards the face centres on both sides: 4 % in rows of 9. Weights are therefore multiplied by gains and
 * renormalised; iterative proportional fitting [Deming and Stephan 1940], over-relaxed, finds gains for which each
 * texel contributes its energy to 0.4 %. */
static bool fit_gains(struct pyramid_level *l)
{
    const uint32_t n = l->n, steps = n > FIT_MIN / FIT_STEPS ? FIT_STEPS * n : FIT_MIN;
    const size_t texels = (size_t)n * n;
    const struct fitting f = {
        .steps = steps,
        .solid_angle = mem_alloc((size_t)steps * steps, sizeof(*f.solid_angle)),
        .between = mem_alloc(steps, sizeof(*f.between)),
        .spread = mem_alloc(texels, sizeof(*f.spread)),
        .want = mem_alloc(texels, sizeof(*f.want)),
    };

    l->gain = mem_alloc(texels, sizeof(*l->gain));
    const bool ok = f.solid_angle && f.between && f.spread && f.want && l->gain;
    if (!ok)
        goto done;
    cube_solid_angles(steps, f.solid_angle);
    for (uint32_t k = 0; k < steps; k++)
        f.between[k] = find_between(n, (float)(-1.0 + 2.0 / steps * k + 0.5 * (2.0 / steps)));
    for (size_t t = 0; t < texels; t++) {
        f.want[alike(n, (uint32_t)(t / n), (uint32_t)(t % n))] += (double)l->solid_angle[t];
        l->gain[t] = 1.0f;
    }
    for (int round = 0; round < FIT_ROUNDS; round++) {
        memset(f.spread, 0, texels * sizeof(*f.spread));
        sum_spread(l, &f);
        for (size_t t = 0; t < texels; t++) {
            const size_t as = alike(n, (uint32_t)(t / n), (uint32_t)(t % n));
            l->gain[t] *= (float)pow(f.want[as] / f.spread[as], FIT_PACE);
        }
    }
done:
    mem_free(f.solid_angle);
    mem_free(f.between);
    mem_free(f.spread);
    mem_free(f.want);
    return ok;
}

struct pyramid *pyramid_create(uint32_t n, const double *solid_angle)
{
    struct pyramid *p = mem_alloc(1, sizeof(*p));

    if (!p)
        return NULL;
    for (uint32_t size = n;; size = (size + 1) / 2) {
        struct pyramid_level *l = &p->level[p->count++];
        const size_t texels = (size_t)size * size;
        l->n = size;
        l->solid_angle = mem_alloc_raw(texels, sizeof(*l->solid_angle));
        if (size < n)
            l->texels = l->own = mem_alloc_raw(CUBE_FACES * texels, 4 * sizeof(*l->own));
        if (!l->solid_angle || (size < n && !l->own)) {
            pyramid_destroy(p);
            return NULL;
        }
        for (size_t t = 0; size == n && t < texels; t++)
            l->solid_angle[t] = (float)solid_angle[t];
        if (size < n)
            sum_solid_angles(l - 1, l);
        if (size <= FIT_MAX && !fit_gains(l)) {
            pyramid_destroy(p);
            return NULL;
        }
        if (size == 1)
            return p;
    }
}

/* NULL if there is nothing to copy, or no memory. */
static float *copy_of(const float *from, size_t count)
{
    float *to = from ? mem_alloc_raw(count, sizeof(*to)) : NULL;

    return to ? memcpy(to, from, count * sizeof(*to)) : NULL;
}

struct pyramid *pyramid_create_like(const struct pyramid *of)
{
    struct pyramid *p = mem_alloc(1, sizeof(*p));
    bool all = p != NULL;

    for (uint32_t k = 0; k < of->count && all; k++) {
        const struct pyramid_level *from = &of->level[k];
        struct pyramid_level *l = &p->level[p->count++];
        const size_t texels = (size_t)from->n * from->n;
        l->n = from->n;
        l->solid_angle = copy_of(from->solid_angle, texels);
        l->gain = copy_of(from->gain, texels);
        if (k > 0)
            l->texels = l->own = mem_alloc_raw(CUBE_FACES * texels, 4 * sizeof(*l->own));
        all = l->solid_angle && (l->gain || !from->gain) && (l->own || k == 0);
    }
    if (all)
        return p;
    pyramid_destroy(p);
    return NULL;
}

void pyramid_destroy(struct pyramid *p)
{
    if (!p)
        return;
    for (uint32_t k = 0; k < p->count; k++) {
        mem_free(p->level[k].own);
        mem_free(p->level[k].solid_angle);
        mem_free(p->level[k].gain);
    }
    mem_free(p);
}

/* A texel as one vector. */
#define FOUR_FLOATS __attribute__((vector_size(4 * sizeof(float)))) float

/* One row of a face at half the resolution: the same sums in the same order as shrink_row. */
static void halve_row(const struct pyramid_level *fine, const struct pyramid_level *coarse, uint32_t face, uint32_t i)
{
    const uint32_t n = fine->n, m = coarse->n;
    const float *texels = fine->texels + 4 * ((size_t)face * n + 2 * i) * n;
    const float *weight = fine->solid_angle + 2 * (size_t)i * n, *whole = coarse->solid_angle + (size_t)i * m;
    float *out = coarse->own + 4 * ((size_t)face * m + i) * m;

    for (uint32_t j = 0; j < m; j++) {
        FOUR_FLOATS t[4];
        memcpy(t, texels + 8 * (size_t)j, sizeof(t) / 2);
        memcpy(t + 2, texels + 4 * ((size_t)n + 2 * j), sizeof(t) / 2);
        const FOUR_FLOATS sum =
            weight[2 * j] * t[0] + weight[2 * j + 1] * t[1] + weight[n + 2 * j] * t[2] + weight[n + 2 * j + 1] * t[3];
        const FOUR_FLOATS mean = sum / whole[j];
        memcpy(out + 4 * (size_t)j, &mean, sizeof(mean));
    }
}

/* One row of a face of the next level; every texel is a mean of at most 3 x 3, weighted by solid angle. */
static void shrink_row(const struct pyramid_level *fine, const struct pyramid_level *coarse, uint32_t face, uint32_t i)
{
    const uint32_t n = fine->n, m = coarse->n;
    const float *texels = fine->texels + 4 * (size_t)face * n * n;
    const struct span y = cover(n, m, i);
    float *out = coarse->own + 4 * ((size_t)face * m + i) * m;

    for (uint32_t j = 0; j < m; j++, out += 4) {
        const struct span x = cover(n, m, j);
        float sum[4] = { 0.0f, 0.0f, 0.0f, 0.0f };
        for (uint32_t r = y.first; r < y.last; r++)
            for (uint32_t c = x.first; c < x.last; c++) {
                const float *t = texels + 4 * ((size_t)r * n + c);
                const float weight = y.part[r - y.first] * x.part[c - x.first] * fine->solid_angle[r * n + c];
                for (int k = 0; k < 4; k++)
                    sum[k] += weight * t[k];
            }
        for (int k = 0; k < 4; k++)
            out[k] = sum[k] / coarse->solid_angle[i * m + j];
    }
}

static void make_row(const struct pyramid *p, uint32_t level, uint32_t face, uint32_t i)
{
    const struct pyramid_level *fine = &p->level[level - 1], *coarse = &p->level[level];

    if (fine->n == 2 * coarse->n)
        halve_row(fine, coarse, face, i);
    else
        shrink_row(fine, coarse, face, i);
}

/* A band of 8 rows yields 4 rows of the next level, then 2 and 1, if all these sizes are even. */
#define BAND 8
#define BAND_LEVELS 3

static uint32_t levels_by_band(const struct pyramid *p)
{
    return p->level[0].n % BAND == 0 ? BAND_LEVELS : 0;
}

void pyramid_begin(struct pyramid *p, const float *texels)
{
    p->level[0].texels = texels;
}

void pyramid_band(struct pyramid *p, uint32_t face, uint32_t b)
{
    for (uint32_t k = 1; k <= levels_by_band(p); k++)
        for (uint32_t i = BAND * b >> k; i < BAND * (b + 1) >> k; i++)
            make_row(p, k, face, i);
}

void pyramid_end(struct pyramid *p)
{
    const uint32_t made = levels_by_band(p);

    /* Faces are independent, so each thread builds whole faces without waiting between levels. What the bands have left
     * over is too little work to start threads for. */
#pragma omp parallel for schedule(static) if (made == 0)
    for (uint32_t face = 0; face < CUBE_FACES; face++)
        for (uint32_t k = made + 1; k < p->count; k++)
            for (uint32_t i = 0; i < p->level[k].n; i++)
                make_row(p, k, face, i);
    const float *last = p->level[p->count - 1].texels;
    for (int c = 0; c < 3; c++) {
        p->mean[c] = 0.0f;
        for (int face = 0; face < CUBE_FACES; face++)
            p->mean[c] += last[4 * face + c] / CUBE_FACES;
    }
}

/* Away from the face's borders: the same taps in the same order as find_taps. */
static void lookup_inside(const struct pyramid_level *l, uint32_t face, const struct between *x,
                          const struct between *y, float rgb[3])
{
    const size_t first = (size_t)y->first * l->n + (size_t)x->first,
                 at[4] = { first, first + 1, first + l->n, first + l->n + 1 };
    const float *texels = l->texels + 4 * (size_t)face * l->n * l->n;
    FOUR_FLOATS sum = { 0.0f };
    float weight[4], whole = 0.0f;

    bilinear_weights(x, y, weight);
    for (int k = 0; k < 4; k++) {
        const float w = l->gain ? weight[k] * l->gain[at[k]] : weight[k];
        FOUR_FLOATS texel;
        memcpy(&texel, texels + 4 * at[k], sizeof(texel));
        whole += w;
        sum += w * texel;
    }
    for (int c = 0; c < 3; c++)
        rgb[c] = sum[c] / whole;
}

static void lookup_across(const struct pyramid_level *l, uint32_t face, const struct between *x,
                          const struct between *y, float rgb[3])
{
    float sum[3] = { 0.0f, 0.0f, 0.0f }, whole = 0.0f;
    struct tap taps[12];
    const int count = find_taps(l->n, face, x, y, taps);

    for (int k = 0; k < count; k++) {
        const struct tap *t = &taps[k];
        const size_t in_face = (size_t)t->row * l->n + t->column;
        const float *texel = l->texels + 4 * ((size_t)t->face * l->n * l->n + in_face);
        const float weight = l->gain ? t->weight * l->gain[in_face] : t->weight;
        whole += weight;
        for (int c = 0; c < 3; c++)
            sum[c] += weight * texel[c];
    }
    for (int c = 0; c < 3; c++)
        rgb[c] = sum[c] / whole;
}

void pyramid_lookup_at(const struct pyramid *p, uint32_t level, uint32_t face, float u, float v, float rgb[3])
{
    if (level == p->count) {
        memcpy(rgb, p->mean, sizeof(p->mean));
        return;
    }
    const struct pyramid_level *l = &p->level[level];
    const struct between x = find_between(l->n, u), y = find_between(l->n, v);
    const float last = (float)l->n - 1.0f;
    if (x.first >= 0.0f && y.first >= 0.0f && x.first < last && y.first < last)
        lookup_inside(l, face, &x, &y, rgb);
    else
        lookup_across(l, face, &x, &y, rgb);
}
