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
    struct lanes all[3], seen[3]; /* seen: of what nothing does occlude */
    struct lanes taken[3];        /* that the current sample adds to `all` */
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
    }
    for (int k = 0; k < 3; k++)
        LANES(l)
        {
            o->taken[k].v[l] = part.v[l] * rgb[k].v[l];
            o->all[k].v[l] += o->taken[k].v[l];
        }
}

/* Adds the current sample to what is seen, in the lanes whose ray nothing met. */
static inline void open_sky_see(struct open_sky *o, const int32_t valid[PACKET], const float tfar[PACKET])
{
    for (int k = 0; k < 3; k++)
        LANES(l)
        {
            const int lit = (valid[l] != 0) & (tfar[l] > 0.0f);
            o->seen[k].v[l] += lit ? o->taken[k].v[l] : 0.0f;
        }
}

/* The share of an open sky's light that a lane sees. */
static inline float open_sky_share(const struct open_sky *o, int l)
{
    const float all = rgb_luminance(o->all[0].v[l], o->all[1].v[l], o->all[2].v[l]);

    return all > 0.0f ? rgb_luminance(o->seen[0].v[l], o->seen[1].v[l], o->seen[2].v[l]) / all : 0.0f;
}

/* Corrects lo[3][PACKET], the light by so many samples: by the square of the visible share, which is less than the
 * share since few scouts do not tell it well; but it takes no more than what the samples saw of the sky, so that its
 * light stays positive. */
static inline void open_sky_correct(const struct irradiance *known, const struct shade_packet *p,
                                    const struct lobes *lobes, const struct open_sky *open, uint32_t samples,
                                    const struct open_sky *scouts, float *lo)
{
    const bool ggx = p->kind == LOBE_GGX;

    for (int l = 0; l < PACKET; l++) {
        const float normal[3] = { p->ns_x[l], p->ns_y[l], p->ns_z[l] };
        const float leave = ggx ? 1.0f - schlick_weight(lobes->cosine_out.v[l]) : 1.0f;
        const float share = open_sky_share(scouts, l), scale = 1.0f / (float)samples;
        float rgb[3];
        if (!p->valid[l])
            continue;
        irradiance_at(known, ggx ? IRRADIANCE_ENTERING : IRRADIANCE_COSINE, normal, rgb);
        for (int c = 0; c < 3; c++) {
            const float off = share * share * (rgb[c] * (float)(1.0 / PI) - scale * open->all[c].v[l]);
            lo[c * PACKET + l] += leave * p->diffuse[c][l] * fmaxf(off, -scale * open->seen[c].v[l]);
        }
    }
}
