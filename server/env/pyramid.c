#include "pyramid.h"

#include "cube.h"
#include "mem.h"

#include <math.h>
#include <stdbool.h>
#include <stddef.h>

/* What texel `to` of m covers of n texels below: first .. last - 1, each wholly or in part. Counted in m-ths of a texel
 * below all borders are whole numbers. */
struct span {
    uint32_t first, last;
    float part[3];
};

static struct span cover(uint32_t n, uint32_t m, uint32_t to)
{
    const uint32_t low = to * n, high = low + n; /* at most 1024 * 1024 */
    struct span s = { low / m, (high + m - 1) / m, { 0.0f } };

    for (uint32_t k = s.first; k < s.last; k++) {
        const uint32_t a = k * m > low ? k * m : low, b = (k + 1) * m < high ? (k + 1) * m : high;
        s.part[k - s.first] = (float)(b - a) / (float)m;
    }
    return s;
}

/* The parts add up over the texels of a level, and so do the solid angles. */
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

struct pyramid *pyramid_create(uint32_t n, const double *solid_angle)
{
    struct pyramid *p = mem_alloc(1, sizeof(*p));

    if (!p)
        return NULL;
    for (uint32_t size = n;; size = (size + 1) / 2) {
        struct pyramid_level *l = &p->level[p->count++];
        const size_t texels = (size_t)size * size;
        l->n = size;
        l->solid_angle = mem_alloc(texels, sizeof(*l->solid_angle));
        if (size < n)
            l->texels = l->own = mem_alloc(CUBE_FACES * texels, 4 * sizeof(*l->own));
        if (!l->solid_angle || (size < n && !l->own)) {
            pyramid_destroy(p);
            return NULL;
        }
        for (size_t t = 0; size == n && t < texels; t++)
            l->solid_angle[t] = (float)solid_angle[t];
        if (size < n)
            sum_solid_angles(l - 1, l);
        if (size == 1)
            return p;
    }
}

void pyramid_destroy(struct pyramid *p)
{
    if (!p)
        return;
    for (uint32_t k = 0; k < p->count; k++) {
        mem_free(p->level[k].own);
        mem_free(p->level[k].solid_angle);
    }
    mem_free(p);
}

/* One row of a face of the next level; every texel is a mean of at most 3 x 3, by solid angle. */
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

void pyramid_build(struct pyramid *p, const float *texels)
{
    p->level[0].texels = texels;
    /* No face needs another's texels: each thread makes whole ones, and none waits between levels. */
#pragma omp parallel for schedule(static)
    for (uint32_t face = 0; face < CUBE_FACES; face++)
        for (uint32_t k = 1; k < p->count; k++)
            for (uint32_t i = 0; i < p->level[k].n; i++)
                shrink_row(&p->level[k - 1], &p->level[k], face, i);
    const float *last = p->level[p->count - 1].texels;
    for (int c = 0; c < 3; c++) {
        p->mean[c] = 0.0f;
        for (int face = 0; face < CUBE_FACES; face++)
            p->mean[c] += last[4 * face + c] / CUBE_FACES;
    }
}

static const float *texel_at(const struct pyramid_level *l, uint32_t face, uint32_t i, uint32_t j)
{
    return l->texels + 4 * (((size_t)face * l->n + i) * l->n + j);
}

/* The texel beyond the border of a face. On the neighbour that lies beyond u = +-1, whose axis is the face's u axis,
 * the face's v runs along u, and the face's own axis along v; beyond v = +-1 it is the other way round. Both faces
 * divide their common edge in the same way. */
static const float *texel_beyond_u(const struct pyramid_level *l, uint32_t face, uint32_t i, bool positive)
{
    const uint32_t axis = (face / 2 + 1) % 3;
    return texel_at(l, 2 * axis + !positive, face & 1 ? 0 : l->n - 1, i);
}

static const float *texel_beyond_v(const struct pyramid_level *l, uint32_t face, uint32_t j, bool positive)
{
    const uint32_t axis = (face / 2 + 2) % 3;
    return texel_at(l, 2 * axis + !positive, j, face & 1 ? 0 : l->n - 1);
}

/* Texel (i, j) of a face, either of which may lie one step outside. Where both do, at a corner of the cube, there is no
 * texel: all three faces that meet there see the mean of their own three instead, and so agree. */
static void fetch(const struct pyramid_level *l, uint32_t face, int64_t i, int64_t j, float rgb[3])
{
    const int64_t n = l->n;
    const bool out_i = i < 0 || i >= n, out_j = j < 0 || j >= n;
    const uint32_t row = (uint32_t)(i < 0    ? 0
                                    : i >= n ? n - 1
                                             : i),
                   column = (uint32_t)(j < 0    ? 0
                                       : j >= n ? n - 1
                                                : j);
    const float *t = texel_at(l, face, row, column);

    if (out_i && out_j) {
        const float *a = texel_beyond_u(l, face, row, j > 0), *b = texel_beyond_v(l, face, column, i > 0);
        for (int c = 0; c < 3; c++)
            rgb[c] = (t[c] + a[c] + b[c]) / 3.0f;
        return;
    }
    if (out_i)
        t = texel_beyond_v(l, face, column, i > 0);
    else if (out_j)
        t = texel_beyond_u(l, face, row, j > 0);
    for (int c = 0; c < 3; c++)
        rgb[c] = t[c];
}

void pyramid_look(const struct pyramid *p, uint32_t level, const float w[3], float rgb[3])
{
    const struct pyramid_level *l = &p->level[level];
    float u, v, sum[3] = { 0.0f, 0.0f, 0.0f };
    const uint32_t face = cube_locate(w, &u, &v);
    const float half = 0.5f * (float)l->n;
    /* Texel centres stand at half-integers. */
    const float x = (u + 1.0f) * half - 0.5f, y = (v + 1.0f) * half - 0.5f;
    const float x0 = floorf(x), y0 = floorf(y), fx = x - x0, fy = y - y0;
    const float weight[4] = { (1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy };

    for (int k = 0; k < 4; k++) {
        float t[3];
        fetch(l, face, (int64_t)y0 + (k >> 1), (int64_t)x0 + (k & 1), t);
        for (int c = 0; c < 3; c++)
            sum[c] += weight[k] * t[c];
    }
    for (int c = 0; c < 3; c++)
        rgb[c] = sum[c];
}
