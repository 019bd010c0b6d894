#include "sky/tables/samples.h"

#include "base/mem.h"
#include "base/rng.h"
#include "sky/tables/invert.h"

#include <assert.h>
#include <math.h>
#include <string.h>

static void direct(uint32_t n, uint32_t face, double row, double column, float w[3])
{
    double d[3];

    cube_direction(face, -1.0 + 2.0 * column / n, -1.0 + 2.0 * row / n, d);
    const double scale = 1.0 / sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    for (int c = 0; c < 3; c++)
        w[c] = (float)(d[c] * scale);
}

void invert_direction(uint32_t n, uint32_t face, double row, double column, float w[3])
{
    float u, v;

    direct(n, face, row, column, w);
    const uint32_t wanted = (face * n + (uint32_t)row) * n + (uint32_t)column;
    if (cube_texel(n, w, &u, &v) != wanted)
        direct(n, face, invert_hold(row), invert_hold(column), w);
}

void samples_invert_face(const struct environment *e, uint32_t face, const double x[2], float w[3])
{
    const uint32_t n = e->n;

    assert(environment_is_complete(e));
    const double row = invert(e->face_cdf + (size_t)face * n, n, x[0]);
    const uint32_t i = (uint32_t)row;
    const double column = invert(e->row_cdf + ((size_t)face * n + i) * n, n, x[1]);

    invert_direction(n, face, row, column, w);
}

static void sphere_direction(const double x[2], float w[3])
{
    const double y = 1.0 - 2.0 * x[0], phi = 2.0 * PI * x[1], r = sqrt(fmax(0.0, 1.0 - y * y));
    w[0] = (float)(r * sin(phi));
    w[1] = (float)y;
    w[2] = (float)(r * cos(phi));
}

/* Selects a face in proportion to energy; rescales *x within that face's share. */
static uint32_t pick_face(const struct environment *e, double *x)
{
    double cdf[CUBE_FACES], sum = 0.0;

    for (uint32_t f = 0; f < CUBE_FACES; f++)
        cdf[f] = sum += e->energy[f];
    const double at = invert(cdf, CUBE_FACES, *x);
    *x = at - (uint32_t)at;
    return (uint32_t)at;
}

float environment_sample_density(const struct environment *e, const float w[3], float rgb[3])
{
    float pdf;
    const uint32_t face = environment_evaluate(e, w, rgb, &pdf);

    return e->total_energy > 0.0 ? pdf * (float)(e->energy[face] / e->total_energy) : 0.0f;
}

bool environment_sample(const struct environment *e, const double x[2], float w[3], float rgb[3], float *pdf)
{
    double rest[2] = { x[0], x[1] };

    if (!(e->total_energy > 0.0))
        return false;
    const uint32_t face = pick_face(e, &rest[0]);
    samples_invert_face(e, face, rest, w);
    *pdf = environment_sample_density(e, w, rgb);
    if (!(*pdf > 0.0f)) { /* rounding moved it out of its texel: it contributes nothing */
        *pdf = 1.0f;
        rgb[0] = rgb[1] = rgb[2] = 0.0f;
    }
    return true;
}

#define ARRAYS 9 /* eight of floats, and stratum */

/* All arrays are in one block, which begins with x. */
static enum err reserve(struct light_samples *s, uint32_t count)
{
    float **const arrays[ARRAYS - 1] = { &s->x, &s->y, &s->z, &s->r, &s->g, &s->b, &s->pdf, &s->sun_pdf };

    if (count <= s->capacity)
        return ERR_OK;
    s->capacity = 0;
    mem_free(s->x);
    s->x = mem_alloc((size_t)count * ARRAYS, sizeof(float));
    if (!s->x)
        return ERR_NOMEM;
    for (size_t k = 1; k < ARRAYS - 1; k++)
        *arrays[k] = s->x + k * count;
    s->stratum = (uint32_t *)(void *)(s->x + (ARRAYS - 1) * (size_t)count);
    s->capacity = count;
    return ERR_OK;
}

/* Stores sample k: direction, radiance and the densities of all strata that could have produced it. Rounding may move a
 * direction onto a texel that no stratum reaches; the sample then contributes nothing. */
static void put_sample(struct light_samples *s, uint32_t k, const float w[3], const float rgb[3], uint32_t stratum,
                       float pdf, float sun_pdf)
{
    const bool brings = pdf > 0.0f || sun_pdf > 0.0f;

    s->x[k] = w[0];
    s->y[k] = w[1];
    s->z[k] = w[2];
    s->r[k] = brings ? rgb[0] : 0.0f;
    s->g[k] = brings ? rgb[1] : 0.0f;
    s->b[k] = brings ? rgb[2] : 0.0f;
    s->pdf[k] = brings ? pdf : 1.0f;
    s->sun_pdf[k] = sun_pdf;
    s->stratum[k] = stratum;
}

/* Draws sample i of a stratum. Its density is evaluated by the same lookup that BRDF samples use, so that sampling and
 * evaluation agree. */
static void draw_one(const struct environment *e, enum strata_kind kind, uint32_t stratum, const double at[2],
                     struct light_samples *s, uint32_t k)
{
    double x[2] = { at[0], at[1] };
    float w[3], rgb[3], pdf;

    if (kind == STRATA_SPHERE)
        sphere_direction(x, w);
    else
        samples_invert_face(e, kind == STRATA_ALL ? pick_face(e, &x[0]) : stratum, x, w);
    const uint32_t face = environment_evaluate(e, w, rgb, &pdf);
    if (kind == STRATA_SPHERE)
        pdf = (float)(0.25 / PI);
    else if (kind == STRATA_ALL)
        pdf *= (float)(e->energy[face] / e->total_energy);
    put_sample(s, k, w, rgb, stratum, pdf, 0.0f);
}

enum err samples_draw(const struct environment *e, enum strata_kind kind, uint32_t count, uint64_t seed,
                      struct light_samples *out)
{
    assert(e->ready);
    out->kind = kind;
    out->cells = 0;
    out->strata = kind == STRATA_FACES ? CUBE_FACES : 1;
    out->has_sun = false;
    if (count > UINT32_MAX / CUBE_FACES || reserve(out, count * out->strata))
        return ERR_NOMEM;
    out->first[0] = 0;
    for (uint32_t f = 0; f < out->strata; f++) {
        out->energy[f] = kind == STRATA_FACES ? e->energy[f] : e->total_energy;
        if (kind == STRATA_FACES)
            cube_corners(f, out->corner[f]);
        const uint32_t drawn = out->energy[f] > 0.0 ? count : 0;
        for (uint32_t i = 0; i < drawn; i++) {
            double x[2];
            rng_sobol2(rng_mix(seed, f), i, x);
            draw_one(e, kind, f, x, out, out->first[f] + i);
        }
        out->first[f + 1] = out->first[f] + drawn;
    }
    return ERR_OK;
}

void samples_shape(const struct sky_table *t, struct light_samples *out)
{
    out->kind = STRATA_TABLE;
    out->cells = t->cells;
    out->strata = t->strata + t->has_sun;
    out->has_sun = t->has_sun;
    memset(out->first, 0, sizeof(out->first));
    memcpy(out->energy, t->energy, t->strata * sizeof(*t->energy));
    memcpy(out->corner, t->corner, t->strata * sizeof(*t->corner));
    if (t->has_sun)
        out->energy[t->strata] = t->sun_energy;
    memcpy(out->sun_axis, t->sun_axis, sizeof(out->sun_axis));
    const float spread = t->sun_spread + 1e-4f; /* a margin larger than rounding */
    out->sun_cos = cosf(spread);
    out->sun_sin = sinf(spread);
}

enum err samples_draw_table(const struct sky_table *t, const uint32_t *count, uint64_t seed, struct light_samples *s)
{
    uint64_t total = 0;

    assert(s->kind == STRATA_TABLE && s->strata == t->strata + t->has_sun);
    for (uint32_t f = 0; f < s->strata; f++)
        total += s->energy[f] > 0.0 ? count[f] : 0;
    if (total > UINT32_MAX || reserve(s, (uint32_t)total))
        return ERR_NOMEM;
    s->first[0] = 0;
    for (uint32_t f = 0; f < s->strata; f++) {
        const uint32_t drawn = s->energy[f] > 0.0 ? count[f] : 0;
        for (uint32_t i = 0; i < drawn; i++) {
            double x[2];
            float w[3], rgb[3], pdf, sun_pdf;
            rng_sobol2(rng_mix(seed, f), i, x);
            sky_table_invert(t, f, x, w);
            const uint32_t stratum = sky_table_evaluate(t, w, rgb, &pdf, &sun_pdf);
            put_sample(s, s->first[f] + i, w, rgb, stratum, pdf, sun_pdf);
        }
        s->first[f + 1] = s->first[f] + drawn;
    }
    return ERR_OK;
}

enum err samples_draw_latlong(const struct latlong *t, enum strata_kind kind, uint32_t count, uint64_t seed,
                              struct light_samples *out)
{
    out->kind = kind;
    out->cells = 0;
    out->strata = 1;
    out->has_sun = false;
    out->energy[0] = t->total;
    out->first[0] = 0;
    out->first[1] = t->total > 0.0 ? count : 0;
    if (reserve(out, count))
        return ERR_NOMEM;
    for (uint32_t i = 0; i < out->first[1]; i++) {
        double x[2];
        float w[3], rgb[3], pdf;
        rng_sobol2(rng_mix(seed, 0), i, x);
        if (kind == STRATA_ROWS)
            latlong_sample_rows(t, x, w, rgb, &pdf);
        else
            latlong_sample(t, x, w, rgb, &pdf);
        put_sample(out, i, w, rgb, 0, pdf, 0.0f);
    }
    return ERR_OK;
}

void samples_finish(struct light_samples *s)
{
    if (!s)
        return;
    mem_free(s->x);
    *s = (struct light_samples){ 0 };
}
