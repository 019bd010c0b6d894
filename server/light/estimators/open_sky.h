/* A control variate for direct light. What samples would bring to a matte surface if nothing occluded them has a mean
 * that is known (sky/tables/irradiance.h). As much as they are off that, they are off in what is visible. A few more
 * samples, scouts, tell how much is visible: they share no numbers with the others, so that the mean stays right
 * whatever they tell. Included by kernels only. */
#pragma once

#include "scene/surface/lanes.h"
#include "scene/surface/lobes.h"
#include "sky/tables/irradiance.h"

/* What samples would bring to a white matte surface if nothing occluded it, but for the sun's texels. */
struct open_sky {
    struct lanes rgb[3];
    struct lanes all, seen; /* luminance; seen: of what nothing does occlude */
    struct lanes taken;     /* that the current sample adds to `all` */
};

/* Adds a sample's light under an open sky. */
static inline void open_sky_add(struct open_sky *o, const struct shade_packet *p, const struct lanes *weight,
                                const struct lanes *cosine, const struct lanes rgb[3], const struct lanes *pdf_sun)
{
    struct lanes part;

    LANES(l)
    {
        const float c = cosine->v[l], enter = p->kind == LOBE_GGX ? 1.0f - schlick_weight(c) : 1.0f;
        part.v[l] = pdf_sun->v[l] > 0.0f ? 0.0f : weight->v[l] * c * enter * (float)(1.0 / PI);
        o->taken.v[l] = part.v[l] * rgb_luminance(rgb[0].v[l], rgb[1].v[l], rgb[2].v[l]);
        o->all.v[l] += o->taken.v[l];
    }
    for (int k = 0; k < 3; k++)
        LANES(l) o->rgb[k].v[l] += part.v[l] * rgb[k].v[l];
}

static inline void open_sky_divide(struct open_sky *o, float samples)
{
    for (int c = 0; c < 3; c++)
        LANES(l) o->rgb[c].v[l] /= samples;
}

/* Corrects lo[3][PACKET], the light by the samples: by the square of the visible share, which is less than the share
 * since few scouts do not tell it well. A sum that this makes negative is 0. */
static inline void open_sky_correct(const struct irradiance *known, const struct shade_packet *p,
                                    const struct lobes *lobes, const struct open_sky *samples,
                                    const struct open_sky *scouts, float *lo)
{
    const bool ggx = p->kind == LOBE_GGX;

    for (int l = 0; l < PACKET; l++) {
        const float normal[3] = { p->ns_x[l], p->ns_y[l], p->ns_z[l] };
        const float leave = ggx ? 1.0f - schlick_weight(lobes->cosine_out.v[l]) : 1.0f;
        const float seen = scouts->all.v[l] > 0.0f ? scouts->seen.v[l] / scouts->all.v[l] : 0.0f;
        float rgb[3];
        if (!p->valid[l])
            continue;
        irradiance_at(known, ggx ? IRRADIANCE_ENTERING : IRRADIANCE_COSINE, normal, rgb);
        for (int c = 0; c < 3; c++) {
            const float off = rgb[c] * (float)(1.0 / PI) - samples->rgb[c].v[l];
            lo[c * PACKET + l] = fmaxf(0.0f, lo[c * PACKET + l] + seen * seen * leave * p->diffuse[c][l] * off);
        }
    }
}
