/* The sky that 16 directions see, and by which densities its samples may have gone there: environment_evaluate and
 * sky_table_evaluate for a packet at once, the same arithmetic and so the same bits. One by one these were a quarter of
 * a frame: each waits for a texel that is in no near cache, where sixteen can wait together. Kernels only. */
#ifndef SHADE_SKY_LANES_H
#define SHADE_SKY_LANES_H

#include "environment.h"
#include "lanes.h"
#include "sky_table.h"

struct sky_lanes {
    struct lanes rgb[3], pdf, pdf_sun; /* density within the stratum; of the sun */
    int32_t stratum[PACKET];
};

/* cube_texel: face and place on it, without a branch. */
static inline void locate_lanes(uint32_t n, const struct lanes d[3], int32_t at[PACKET], struct lanes *u,
                                struct lanes *v)
{
    const float half = 0.5f * (float)n;
    const int32_t edge = (int32_t)n;

    LANES(l)
    {
        const float w0 = d[0].v[l], w1 = d[1].v[l], w2 = d[2].v[l];
        const float x = fabsf(w0), y = fabsf(w1), z = fabsf(w2);
        const int on_x = x >= y && x >= z, on_y = !on_x && y >= z;
        const float along = on_x ? w0 : on_y ? w1 : w2, scale = 1.0f / fabsf(along);
        const float a = (on_x ? w1 : on_y ? w2 : w0) * scale, b = (on_x ? w2 : on_y ? w0 : w1) * scale;
        const int32_t face = (on_x ? 0 : on_y ? 2 : 4) + (along < 0.0f);
        const int32_t j = (int32_t)((a + 1.0f) * half), i = (int32_t)((b + 1.0f) * half);
        u->v[l] = a;
        v->v[l] = b;
        at[l] = (face * edge + (i < edge ? i : edge - 1)) * edge + (j < edge ? j : edge - 1);
    }
}

static inline void environment_lanes(const struct environment *e, const struct lanes d[3], struct sky_lanes *out)
{
    const struct texel *texels = e->texels;
    const int32_t face_texels = (int32_t)(e->n * e->n);
    struct lanes u, v;
    int32_t at[PACKET];
    float energy[CUBE_FACES];

    for (int f = 0; f < CUBE_FACES; f++)
        energy[f] = (float)e->energy[f];
    locate_lanes(e->n, d, at, &u, &v);
    LANES(l)
    {
        const struct texel *t = &texels[at[l]];
        const int32_t face = at[l] / face_texels;
        const float density = t->density * cube_jacobian(u.v[l], v.v[l]) / energy[face];
        out->rgb[0].v[l] = t->r;
        out->rgb[1].v[l] = t->g;
        out->rgb[2].v[l] = t->b;
        out->pdf.v[l] = energy[face] > 0.0f ? density : 0.0f;
        out->pdf_sun.v[l] = 0.0f;
        out->stratum[l] = face;
    }
}

static inline void sky_table_lanes(const struct sky_table *t, const struct lanes d[3], struct sky_lanes *out)
{
    const struct texel *texels = t->environment->texels;
    const int32_t n = (int32_t)t->n, cells = (int32_t)t->cells, m = n / cells;
    struct lanes u, v;
    int32_t at[PACKET];

    locate_lanes(t->n, d, at, &u, &v);
    LANES(l)
    {
        const struct texel *x = &texels[at[l]];
        const int32_t stratum = (at[l] / (n * n) * cells + at[l] / n % n / m) * cells + at[l] % n / m;
        const double jacobian = cube_jacobian(u.v[l], v.v[l]), energy = t->energy[stratum];
        out->rgb[0].v[l] = x->r;
        out->rgb[1].v[l] = x->g;
        out->rgb[2].v[l] = x->b;
        out->pdf.v[l] = energy > 0.0 ? (float)(t->density[at[l]] * jacobian / energy) : 0.0f;
        out->pdf_sun.v[l] = 0.0f;
        out->stratum[l] = stratum;
    }
    if (!t->has_sun)
        return;
    LANES(l)
    {
        if (importance_of(t->importance, out->rgb[0].v[l], out->rgb[1].v[l], out->rgb[2].v[l]) > t->level)
            out->pdf_sun.v[l] = sky_table_sun(t, (uint32_t)at[l], cube_jacobian(u.v[l], v.v[l]));
    }
}

#endif
