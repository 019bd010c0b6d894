/* Sky lookups for 16 directions at once: radiance and densities, bit-identical to environment_evaluate and
 * sky_table_evaluate. Scalar lookups took a quarter of a frame, since each waits for a texel outside the near caches;
 * sixteen lookups overlap their waits. Included by kernels only. */
#pragma once

#include "scene/surface/lanes.h"
#include "sky/tables/environment.h"
#include "sky/tables/sky_table.h"

struct sky_lanes {
    struct lanes rgb[3], pdf, pdf_sun; /* density within the stratum, and of the sun */
    int32_t stratum[PACKET];
};

/* Positions of 16 directions on the cube map. */
struct sky_places {
    struct lanes u, v; /* on the face */
    int32_t face[PACKET], row[PACKET], column[PACKET];
    int32_t at[PACKET]; /* texel index, as cube_texel */
};

/* As cube_texel, branch-free: face and position on it. Prefetches the texels for sky_lookup, since the sky exceeds the
 * near caches; do other work in between. t may be NULL. */
static inline void sky_locate(const struct environment *e, const struct sky_table *t, const struct lanes d[3],
                              struct sky_places *out)
{
    const float half = 0.5f * (float)e->n;
    const int32_t edge = (int32_t)e->n;

    LANES(l)
    {
        const float w0 = d[0].v[l], w1 = d[1].v[l], w2 = d[2].v[l];
        const float x = fabsf(w0), y = fabsf(w1), z = fabsf(w2);
        const int on_x = x >= y && x >= z, on_y = !on_x && y >= z;
        const float along = on_x ? w0 : on_y ? w1 : w2, scale = 1.0f / fabsf(along);
        const float a = (on_x ? w1 : on_y ? w2 : w0) * scale, b = (on_x ? w2 : on_y ? w0 : w1) * scale;
        const int32_t face = (on_x ? 0 : on_y ? 2 : 4) + (along < 0.0f);
        const int32_t j = (int32_t)((a + 1.0f) * half), i = (int32_t)((b + 1.0f) * half);
        out->u.v[l] = a;
        out->v.v[l] = b;
        out->face[l] = face;
        out->row[l] = i < edge ? i : edge - 1;
        out->column[l] = j < edge ? j : edge - 1;
        out->at[l] = (face * edge + out->row[l]) * edge + out->column[l];
    }
    for (int l = 0; l < PACKET; l++)
        __builtin_prefetch(&e->texels[out->at[l]]);
    for (int l = 0; t && l < PACKET; l++)
        __builtin_prefetch(&t->density[out->at[l]]);
}

/* Loads whole texels one by one, which is faster than any compiler's gather. */
static inline void gather_texels(const struct texel *texels, const struct sky_places *p, struct texel out[PACKET])
{
    LANES(l) out[l] = texels[p->at[l]];
}

/* Lookup in the environment's own faces. */
static inline void environment_lanes(const struct environment *e, const struct sky_places *p, struct sky_lanes *out)
{
    _Alignas(64) struct texel x[PACKET];
    float energy[CUBE_FACES];
    struct lanes whole;

    gather_texels(e->texels, p, x);
    for (int f = 0; f < CUBE_FACES; f++)
        energy[f] = (float)e->energy[f];
    LANES(l) whole.v[l] = energy[p->face[l]];
    LANES(l)
    {
        const float density = x[l].density * cube_jacobian(p->u.v[l], p->v.v[l]) / whole.v[l];
        out->rgb[0].v[l] = x[l].r;
        out->rgb[1].v[l] = x[l].g;
        out->rgb[2].v[l] = x[l].b;
        out->pdf.v[l] = whole.v[l] > 0.0f ? density : 0.0f;
        out->pdf_sun.v[l] = 0.0f;
        out->stratum[l] = p->face[l];
    }
}

static inline void sky_table_lanes(const struct sky_table *t, const struct sky_places *p, struct sky_lanes *out)
{
    const int32_t cells = (int32_t)t->cells;
    const float m = (float)(t->n / t->cells); /* rows of texels per cell: below 2^12, so that quotients are exact */
    _Alignas(64) struct texel x[PACKET];

    gather_texels(t->environment->texels, p, x);
    LANES(l)
    {
        const int32_t i = (int32_t)((float)p->row[l] / m), j = (int32_t)((float)p->column[l] / m);
        const int32_t stratum = (p->face[l] * cells + i) * cells + j;
        const double jacobian = cube_jacobian(p->u.v[l], p->v.v[l]), energy = t->energy[stratum];
        out->rgb[0].v[l] = x[l].r;
        out->rgb[1].v[l] = x[l].g;
        out->rgb[2].v[l] = x[l].b;
        out->pdf.v[l] = energy > 0.0 ? (float)(t->density[p->at[l]] * jacobian / energy) : 0.0f;
        out->pdf_sun.v[l] = 0.0f;
        out->stratum[l] = stratum;
    }
    if (!t->has_sun)
        return;
    LANES(l)
    {
        if (rgb_luminance(x[l].r, x[l].g, x[l].b) > t->level)
            out->pdf_sun.v[l] = sky_table_sun(t, (uint32_t)p->at[l], cube_jacobian(p->u.v[l], p->v.v[l]));
    }
}

/* t: table of the strata; NULL: the environment's own faces. */
static inline void sky_lookup(const struct environment *e, const struct sky_table *t, const struct sky_places *p,
                              struct sky_lanes *out)
{
    if (t)
        sky_table_lanes(t, p, out);
    else
        environment_lanes(e, p, out);
}
