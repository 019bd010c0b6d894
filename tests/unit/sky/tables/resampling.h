/* A resampler of its own for a test, the cube map that it makes, and a look into its table. */
#pragma once

#include "base/mem.h"
#include "sky/tables/cube.h"
#include "sky/tables/resample.h"

#include <string.h>

#include "support/unit.h"

static inline struct resampler *resampling_make(enum layout layout, uint32_t width, uint32_t height, uint32_t n,
                                                double rotation)
{
    const struct resample_key key = { layout, width, height, n, rotation };
    struct resampler *r;
    assert_int_equal(resampler_create(NULL, &key, &r), ERR_OK);
    return r;
}

/* Texels[6][n][n][4] of a frame; the caller's. */
static inline float *resampling_cube(struct resampler *r, const float *rgb, float gain)
{
    const uint32_t n = r->table->key.n, pitch = RESAMPLE_PITCH(n);
    float *cube = mem_alloc((size_t)6 * n * n, 4 * sizeof(float)), *band = mem_alloc(8 * pitch, 4 * sizeof(float));
    resampler_load(r, rgb);
    for (uint32_t face = 0; face < 6; face++)
        for (uint32_t i = 0; i < n; i++) {
            if (i % 8 == 0)
                resampler_band(r, gain, face, i / 8, band);
            memcpy(cube + 4 * ((size_t)face * n + i) * n, band + 4 * (size_t)(i % 8) * pitch, 4 * n * sizeof(float));
        }
    mem_free(band);
    return cube;
}

/* One term of the table, and where it stands. */
struct resampling_term {
    uint32_t face, row, column; /* of the cube map */
    size_t block;
    float weight;
};

/* Calls `each` for every term that weighs something. */
static inline void resampling_walk(const struct resample_table *t,
                                   void (*each)(void *context, const struct resampling_term *term), void *context)
{
    const uint32_t tiles = t->across * t->across;
    for (uint32_t at = 0; at < 6 * tiles * OCTETS * 8; at++) {
        const struct octet *e = &t->octets[at / 8];
        const uint32_t tile = at / 8 / OCTETS, texel = e->texel[at % 8];
        struct resampling_term term = { .face = tile / tiles,
                                        .row = tile / t->across % t->across * TILE + texel / TILE,
                                        .column = tile % t->across * TILE + texel % TILE };
        for (uint32_t k = e->first; k < e[1].first; k++) {
            const size_t place = 8 * (size_t)k + at % 8;
            term.block = e->base + (size_t)(t->near ? t->near[place] : t->far[place]);
            term.weight = t->weight[place];
            assert_true(term.block < (size_t)t->columns * t->rows);
            assert_true(term.weight == 0.0f || (term.row < t->key.n && term.column < t->key.n));
            if (term.weight > 0.0f)
                each(context, &term);
        }
    }
}

struct resampling_sum {
    uint32_t n;
    const float *rgb;
    double *sum;
};

static inline void resampling_add_solid_angle(void *context, const struct resampling_term *term)
{
    const struct resampling_sum *s = context;
    const double step = 2.0 / s->n, u = -1.0 + step * term->column, v = -1.0 + step * term->row;
    s->sum[term->block] += (double)term->weight * cube_solid_angle(u, v, u + step, v + step);
}

static inline void resampling_add_light(void *context, const struct resampling_term *term)
{
    const struct resampling_sum *s = context;
    for (size_t c = 0; c < 3; c++)
        s->sum[3 * (((size_t)term->face * s->n + term->row) * s->n + term->column) + c] +=
            (double)term->weight * (double)s->rgb[3 * term->block + c];
}

/* Solid angle that arrives from each block of the source, as its table says; the caller's. */
static inline double *resampling_arrived(const struct resampler *r)
{
    const struct resample_table *t = r->table;
    double *sum = mem_alloc((size_t)t->columns * t->rows, sizeof(double));
    resampling_walk(t, resampling_add_solid_angle, &(struct resampling_sum){ t->key.n, NULL, sum });
    return sum;
}

/* The cube map [6][n][n][3] of a frame whose layout shows everything, term by term in double; the caller's. */
static inline double *resampling_sums(const struct resampler *r, const float *rgb)
{
    const struct resample_table *t = r->table;
    double *sum = mem_alloc((size_t)6 * t->key.n * t->key.n, 3 * sizeof(double));
    resampling_walk(t, resampling_add_light, &(struct resampling_sum){ t->key.n, rgb, sum });
    return sum;
}
