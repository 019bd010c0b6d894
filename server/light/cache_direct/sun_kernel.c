/* The loops that trace the sun, and light packets by it (light/cache_direct/internal.h): compiled once per CPU level,
 * see CMakeLists.txt. */
#include "light/cache_direct/internal.h"
#include "scene/geometry/lane_rays.h"
#include "scene/surface/lobes.h"

#include <math.h>
#include <string.h>

static uint64_t trace(const struct rays *rays, const struct sun_look *looks, const struct shade_packet *p,
                      uint32_t directions, uint32_t lanes, uint16_t *bits, struct transport_view *view)
{
    _Alignas(64) int32_t valid[PACKET];
    struct ray16 ray;
    struct lane_pixels pixels;
    uint64_t traced = 0;

    lobes_rays(p, &ray);
    lanes_pixels(p, &pixels);
    for (uint32_t left = directions; left; left &= left - 1) {
        const int k = __builtin_ctz(left);
        struct lanes d[3], cosine;
        uint32_t asked = 0, lit = 0;
        bits[k] = (uint16_t)(bits[k] & ~lanes);
        memcpy(d, looks[k].ray, sizeof(d));
        if (!lobes_see(p, d, &cosine))
            continue;
        LANES(l)
        {
            valid[l] = cosine.v[l] > 0.0f && (lanes >> l & 1u) ? p->valid[l] : 0;
            asked |= (uint32_t)(valid[l] & 1) << l;
        }
        lanes_aim(d, &ray);
        lanes_start(p, &pixels, looks[k].place, &ray);
        if (rays && asked) {
            rays_occluded16(rays, RAYS_TOGETHER, valid, &ray);
            traced += (uint64_t)__builtin_popcount(asked);
        }
        LANES(l) lit |= (uint32_t)(ray.tfar[l] > 0.0f ? valid[l] & 1 : 0) << l;
        bits[k] = (uint16_t)(bits[k] | lit);
        view->lit |= lit;
        view->dark |= asked & ~lit;
    }
    return traced;
}

/* ---- Light ---- */

/* Writes a flux to the lanes that see a cone, which is above their horizons, 0 to the others. False if a horizon may
 * cut it. */
static inline bool see_cone(const float axis[3], float sine, const float of[3], const struct shade_packet *p,
                            uint32_t lanes, struct lanes flux[3])
{
    int32_t cut = 0;

    LANES(l)
    {
        const float shading = p->ns_x[l] * axis[0] + p->ns_y[l] * axis[1] + p->ns_z[l] * axis[2];
        const float geometric = p->ng_x[l] * axis[0] + p->ng_y[l] * axis[1] + p->ng_z[l] * axis[2];
        const float least = shading < geometric ? shading : geometric;
        const int32_t above = (least > 0.0f) & (int32_t)(lanes >> l & 1u);
        cut |= (least <= sine) & (least >= -sine);
        flux[0].v[l] = above ? of[0] : 0.0f;
        flux[1].v[l] = above ? of[1] : 0.0f;
        flux[2].v[l] = above ? of[2] : 0.0f;
    }
    return !cut;
}

/* The flux that each lane sees: the integral of luminance times direction. */
static void sum_flux(const struct sun_part *s, const struct sun_tile *t, const struct shade_packet *p, uint32_t lanes,
                     const uint16_t *bits, struct lanes flux[3])
{
    memset(flux, 0, 3 * sizeof(*flux));
    for (uint32_t left = s->asked; left; left &= left - 1) {
        const int k = __builtin_ctz(left);
        const float x = t->x[k], y = t->y[k], z = t->z[k], w = s->weight[k];
        const uint32_t on = bits ? bits[k] : lanes;
        LANES(l)
        {
            const int above = (p->ns_x[l] * x + p->ns_y[l] * y + p->ns_z[l] * z > 0.0f) &
                              (p->ng_x[l] * x + p->ng_y[l] * y + p->ng_z[l] * z > 0.0f);
            const float seen = (on >> l & 1u) & (uint32_t)above ? w : 0.0f;
            flux[0].v[l] += seen * x;
            flux[1].v[l] += seen * y;
            flux[2].v[l] += seen * z;
        }
    }
}

static void light_matte(const float colour[3], const struct shade_packet *p, const struct lanes flux[3], float *lo)
{
    for (int c = 0; c < 3; c++)
        LANES(l)
        {
            const float cosine = p->ns_x[l] * flux[0].v[l] + p->ns_y[l] * flux[1].v[l] + p->ns_z[l] * flux[2].v[l];
            lo[c * PACKET + l] += p->diffuse[c][l] * (float)(1.0 / PI) * colour[c] * (cosine > 0.0f ? cosine : 0.0f);
        }
}

/* Lobes as wide as a cell see a tile, or a small sun, as one direction, in the middle of what is visible. */
static void light_broad(const float colour[3], const struct shade_packet *p, const struct lanes flux[3], float *lo)
{
    struct lanes d[3], length, cosine, brdf[3], pdf;
    struct lobes lobes;

    LANES(l)
    {
        const float x = flux[0].v[l], y = flux[1].v[l], z = flux[2].v[l], square = x * x + y * y + z * z;
        const float scale = square > 0.0f ? 1.0f / sqrtf(square) : 0.0f;
        length.v[l] = square * scale;
        d[0].v[l] = x * scale;
        d[1].v[l] = y * scale;
        d[2].v[l] = z * scale;
    }
    if (!lobes_see(p, d, &cosine))
        return;
    lobes_set_up(p, &lobes);
    lobes_evaluate(&lobes, p, d, &cosine, brdf, &pdf);
    for (int c = 0; c < 3; c++)
        LANES(l) lo[c * PACKET + l] += brdf[c].v[l] * length.v[l] * colour[c];
}

/* Reduces the lobes' light along d to the balance heuristic's share of the sun, beside that of the gazes. glints: the
 * points without their matte part. */
static void balance(const struct shade_packet *glints, const struct lobes *lobes, float density,
                    const struct lanes d[3], const struct lanes *cosine, struct lanes brdf[3])
{
    struct lanes lobe[3], pdf;

    lobes_evaluate(lobes, glints, d, cosine, lobe, &pdf);
    for (int c = 0; c < 3; c++)
        LANES(l)
        {
            const float theirs = TRANSPORT_GAZES * pdf.v[l];
            brdf[c].v[l] -= lobe[c].v[l] * (theirs > 0.0f ? theirs / (density + theirs) : 0.0f);
        }
}

static void light_narrow(const struct sun_part *s, const struct sun_tile *t, const struct shade_packet *p,
                         uint32_t lanes, const uint16_t *bits, float *lo)
{
    struct shade_packet glints = *p;
    struct lobes lobes, alone;

    lobes_set_up(p, &lobes);
    alone = lobes;
    memset(glints.diffuse, 0, sizeof(glints.diffuse));
    LANES(l) alone.diffuse_part.v[l] = 0.0f;
    for (uint32_t left = s->asked; left; left &= left - 1) {
        const int k = __builtin_ctz(left);
        const uint32_t on = bits ? bits[k] : lanes;
        struct lanes d[3], cosine, brdf[3], pdf;
        LANES(l)
        {
            d[0].v[l] = t->x[k];
            d[1].v[l] = t->y[k];
            d[2].v[l] = t->z[k];
        }
        if (!on || !lobes_see(p, d, &cosine))
            continue;
        lobes_evaluate(&lobes, p, d, &cosine, brdf, &pdf);
        balance(&glints, &alone, s->density[k], d, &cosine, brdf);
        for (int c = 0; c < 3; c++)
            LANES(l) lo[c * PACKET + l] += on >> l & 1u ? brdf[c].v[l] * s->weight[k] * s->colour[c] : 0.0f;
    }
}

static void light_flux(const float colour[3], const struct shade_packet *p, const struct lanes flux[3], float *lo)
{
    if (p->kind == LOBE_LAMBERT)
        light_matte(colour, p, flux, lo);
    else
        light_broad(colour, p, flux, lo);
}

static bool whole(const struct transport_sun *s, const struct shade_packet *p, uint32_t lanes, float *lo)
{
    struct lanes flux[3];
    const bool clear = see_cone(s->axis, s->sine, s->flux, p, lanes, flux);

    if (clear)
        light_flux(s->colour, p, flux, lo);
    return clear;
}

static void light(const struct sun_part *s, const struct sun_tile *t, const struct shade_packet *p, bool narrow,
                  uint32_t lanes, const uint16_t *bits, float *lo)
{
    struct lanes flux[3];

    if (narrow) {
        light_narrow(s, t, p, lanes, bits, lo);
        return;
    }
    if (bits || !see_cone(t->axis, t->sine, s->flux, p, lanes, flux))
        sum_flux(s, t, p, lanes, bits, flux);
    light_flux(s->colour, p, flux, lo);
}

extern const struct sun_kernels KERNEL(sun_kernels);
const struct sun_kernels KERNEL(sun_kernels) = { trace, whole, light };
