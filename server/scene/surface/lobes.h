/* BRDFs of the 16 points of a packet: BRDF times cosine, the probability density of sampling, and sampling itself.
 * Included only by the kernels, which are compiled once per CPU level.
 *
 * lambert: diffuse / pi, sampled in proportion to the cosine.
 *
 * phong: diffuse/pi + specular (n+2)/(2 pi) max(0, r.w)^n; the lobe is sampled by cos^n about the mirror direction r.
 *
 * ggx: S(n.w) S(n.o) diffuse/pi + F(h.w) D V, the microfacet model of glTF 2.0 (appendix B.3): D of [Walter et al.
 * 2007, Eq. 33], V the height-correlated masking of [Heitz 2014, Eq. 99] over 4 cos cos, F of [Schlick 1994]. S(c) = 1
 * - (1 - c)^5 is the share of light, but for a constant in `diffuse` (material.h), that passes the surface on its way
 * in and out; glTF's own 1 - F(h.w) reflects up to 1.29 of the incident light at grazing angles, this at most 1. The
 * lobe is sampled by visible normals [Dupuy and Benyoub 2023]. gloss is alpha, specular is F at normal incidence. */
#pragma once

#include "base/vec.h"
#include "scene/surface/lanes.h"
#include "scene/surface/scatter.h"

#include <stdbool.h>

/* Terms that do not depend on the light direction. */
struct lobes {
    struct lanes reflected[3];        /* phong: mirror direction of wo about the shading normal */
    struct lanes brdf_norm, pdf_norm; /* phong: (n + 2) / (2 pi) and (n + 1) / (2 pi) */
    struct lanes out[3], cosine_out;  /* ggx: wo, bent until n.wo > 0 if necessary, and the resulting n.wo */
    struct lanes diffuse_part;        /* probability of the diffuse lobe */
};

#define MIN_COSINE 1e-3f /* minimum cosine of wo with a shading normal that faces away from it */

/* Schlick's fifth power, by which reflectance rises to 1 at grazing angles [Schlick 1994]. */
static inline float schlick_weight(float cosine)
{
    const float c = cosine < 1.0f ? 1.0f - cosine : 0.0f, c2 = c * c;
    return c2 * c2 * c;
}

static void lobes_set_up(const struct shade_packet *p, struct lobes *s)
{
    if (p->kind == LOBE_LAMBERT) { /* uses none of the other fields */
        LANES(l) s->diffuse_part.v[l] = 1.0f;
        return;
    }
    LANES(l)
    {
        const float out = p->ns_x[l] * p->wo_x[l] + p->ns_y[l] * p->wo_y[l] + p->ns_z[l] * p->wo_z[l];
        s->reflected[0].v[l] = 2.0f * out * p->ns_x[l] - p->wo_x[l];
        s->reflected[1].v[l] = 2.0f * out * p->ns_y[l] - p->wo_y[l];
        s->reflected[2].v[l] = 2.0f * out * p->ns_z[l] - p->wo_z[l];
        s->brdf_norm.v[l] = (p->gloss[l] + 2.0f) * (float)(0.5 / PI);
        s->pdf_norm.v[l] = (p->gloss[l] + 1.0f) * (float)(0.5 / PI);
        const float lift = out < MIN_COSINE ? MIN_COSINE - out : 0.0f;
        const float x = p->wo_x[l] + lift * p->ns_x[l], y = p->wo_y[l] + lift * p->ns_y[l],
                    z = p->wo_z[l] + lift * p->ns_z[l];
        const float scale = 1.0f / sqrtf(x * x + y * y + z * z);
        s->out[0].v[l] = x * scale;
        s->out[1].v[l] = y * scale;
        s->out[2].v[l] = z * scale;
        s->cosine_out.v[l] = (out + lift) * scale;
    }
    LANES(l)
    {
        const float d = rgb_luminance(p->diffuse[0][l], p->diffuse[1][l], p->diffuse[2][l]);
        const float f0 = rgb_luminance(p->specular[0][l], p->specular[1][l], p->specular[2][l]);
        const float grown = f0 + (1.0f - f0) * schlick_weight(s->cosine_out.v[l]);
        const float g = p->kind == LOBE_GGX ? grown : f0;
        const float matte = p->kind == LOBE_GGX ? (1.0f - grown) * d : d;
        const int alone = p->kind == LOBE_LAMBERT || (p->kind == LOBE_GGX && p->gloss[l] <= 0.0f);
        s->diffuse_part.v[l] = alone || matte + g <= 0.0f ? 1.0f : matte / (matte + g);
    }
}

static inline void evaluate_lambert(const struct shade_packet *p, const struct lanes *cosine, struct lanes brdf[3],
                                    struct lanes *pdf)
{
    LANES(l)
    {
        const float c = cosine->v[l] * (float)(1.0 / PI);
        pdf->v[l] = c;
        brdf[0].v[l] = c * p->diffuse[0][l];
        brdf[1].v[l] = c * p->diffuse[1][l];
        brdf[2].v[l] = c * p->diffuse[2][l];
    }
}

static inline void evaluate_phong(const struct lobes *s, const struct shade_packet *p, const struct lanes d[3],
                                  const struct lanes *cosine, struct lanes brdf[3], struct lanes *pdf)
{
    struct lanes lobe;

    LANES(l)
    {
        const float c =
            s->reflected[0].v[l] * d[0].v[l] + s->reflected[1].v[l] * d[1].v[l] + s->reflected[2].v[l] * d[2].v[l];
        lobe.v[l] = cosine->v[l] > 0.0f ? lane_power(c < 1.0f ? c : 1.0f, p->gloss[l]) : 0.0f;
    }
    LANES(l)
    {
        const float c = cosine->v[l] * (float)(1.0 / PI), part = s->diffuse_part.v[l];
        const float shine = cosine->v[l] * s->brdf_norm.v[l] * lobe.v[l];
        pdf->v[l] = part * c + (1.0f - part) * s->pdf_norm.v[l] * lobe.v[l];
        brdf[0].v[l] = c * p->diffuse[0][l] + shine * p->specular[0][l];
        brdf[1].v[l] = c * p->diffuse[1][l] + shine * p->specular[1][l];
        brdf[2].v[l] = c * p->diffuse[2][l] + shine * p->specular[2][l];
    }
}

static inline void evaluate_ggx(const struct lobes *s, const struct shade_packet *p, const struct lanes d[3],
                                const struct lanes *cosine, struct lanes brdf[3], struct lanes *pdf)
{
    struct lanes shine, fresnel, enter, leave;

    LANES(l)
    {
        /* The half vector. Its sine with the normal comes from a cross product, which is accurate where it is small. */
        float hx = s->out[0].v[l] + d[0].v[l], hy = s->out[1].v[l] + d[1].v[l], hz = s->out[2].v[l] + d[2].v[l];
        const float length2 = hx * hx + hy * hy + hz * hz, scale = length2 > 1e-12f ? 1.0f / sqrtf(length2) : 0.0f;
        hx *= scale;
        hy *= scale;
        hz *= scale;
        const float nh = p->ns_x[l] * hx + p->ns_y[l] * hy + p->ns_z[l] * hz;
        const float oh = s->out[0].v[l] * hx + s->out[1].v[l] * hy + s->out[2].v[l] * hz;
        const float cx = p->ns_y[l] * hz - p->ns_z[l] * hy, cy = p->ns_z[l] * hx - p->ns_x[l] * hz,
                    cz = p->ns_x[l] * hy - p->ns_y[l] * hx;
        const float a2 = p->gloss[l] * p->gloss[l], sine2 = cx * cx + cy * cy + cz * cz;
        const float q = a2 * nh * nh + sine2;
        const float lit = cosine->v[l] > 0.0f && nh > 0.0f && q > 0.0f ? 1.0f : 0.0f;
        const float distribution = lit * a2 * (float)(1.0 / PI) / (q * q > 1e-30f ? q * q : 1e-30f);
        const float in = cosine->v[l], out = s->cosine_out.v[l];
        const float mask_out = sqrtf(a2 + (1.0f - a2) * out * out), mask_in = sqrtf(a2 + (1.0f - a2) * in * in);
        /* 2 cos cos G / (4 cos cos) = 1 / (2 (in mask_out + out mask_in)), times the cosine */
        shine.v[l] = distribution * in * 0.5f / (in * mask_out + out * mask_in + 1e-20f);
        fresnel.v[l] = schlick_weight(oh > 0.0f ? oh : 0.0f);
        enter.v[l] = 1.0f - schlick_weight(in);
        leave.v[l] = 1.0f - schlick_weight(out);
        /* Visible normals: G1 D / (4 cos_out), G1 = 2 cos_out / (cos_out + mask_out) */
        const float c = in * (float)(1.0 / PI), part = s->diffuse_part.v[l];
        pdf->v[l] = part * c + (1.0f - part) * distribution * 0.5f / (out + mask_out);
    }
    for (int k = 0; k < 3; k++) /* a separate loop: gcc does not vectorise a loop that contains another */
        LANES(l)
        {
            const float f0 = p->specular[k][l], f = f0 + (1.0f - f0) * fresnel.v[l];
            const float c = cosine->v[l] * (float)(1.0 / PI);
            brdf[k].v[l] = enter.v[l] * leave.v[l] * c * p->diffuse[k][l] + f * shine.v[l];
        }
}

/* Each lane's cosine with its direction d; 0 if d is below the shading or the geometric surface. False if that holds
 * for all lanes. */
static inline bool lobes_see(const struct shade_packet *p, const struct lanes d[3], struct lanes *cosine)
{
    int32_t some = 0;

    LANES(l)
    {
        const float shading = p->ns_x[l] * d[0].v[l] + p->ns_y[l] * d[1].v[l] + p->ns_z[l] * d[2].v[l];
        const float geometric = p->ng_x[l] * d[0].v[l] + p->ng_y[l] * d[1].v[l] + p->ng_z[l] * d[2].v[l];
        const int above = (shading > 0.0f) & (geometric > 0.0f);
        cosine->v[l] = above ? shading : 0.0f;
        some |= above;
    }
    return some != 0;
}

/* The same apart: the cosine with the shading normal alone, and whether d is above the geometric surface, 1 or 0. */
static inline bool lobes_face(const struct shade_packet *p, const struct lanes d[3], struct lanes *cosine,
                              struct lanes *above)
{
    int32_t some = 0;

    LANES(l)
    {
        const float shading = p->ns_x[l] * d[0].v[l] + p->ns_y[l] * d[1].v[l] + p->ns_z[l] * d[2].v[l];
        const float geometric = p->ng_x[l] * d[0].v[l] + p->ng_y[l] * d[1].v[l] + p->ng_z[l] * d[2].v[l];
        cosine->v[l] = shading > 0.0f ? shading : 0.0f;
        above->v[l] = geometric > 0.0f ? 1.0f : 0.0f;
        some |= shading > 0.0f;
    }
    return some != 0;
}

/* For each lane's direction d and its cosine: BRDF times cosine to brdf, sampling density to pdf. If the cosine is 0
 * the BRDF is 0, but the density may not be. */
static inline void lobes_evaluate(const struct lobes *s, const struct shade_packet *p, const struct lanes d[3],
                                  const struct lanes *cosine, struct lanes brdf[3], struct lanes *pdf)
{
    if (p->kind == LOBE_PHONG)
        evaluate_phong(s, p, d, cosine, brdf, pdf);
    else if (p->kind == LOBE_GGX)
        evaluate_ggx(s, p, d, cosine, brdf, pdf);
    else
        evaluate_lambert(p, cosine, brdf, pdf);
}

/* Transforms (x, y, z) from the frame with z axis `axis` to world space [Duff et al. 2017]. */
static inline void to_world(const struct lanes axis[3], const struct lanes local[3], struct lanes out[3])
{
    LANES(l)
    {
        const float x = axis[0].v[l], y = axis[1].v[l], z = axis[2].v[l];
        const float sign = copysignf(1.0f, z), a = -1.0f / (sign + z), b = x * y * a;
        const float lx = local[0].v[l], ly = local[1].v[l], lz = local[2].v[l];
        out[0].v[l] = lx * (1.0f + sign * x * x * a) + ly * b + lz * x;
        out[1].v[l] = lx * sign * b + ly * (sign + y * y * a) + lz * y;
        out[2].v[l] = -lx * sign * x - ly * y + lz * z;
    }
}

/* For the lanes whose random number selects the specular lobe of ggx: replaces d by the mirror direction about a
 * visible normal. After stretching the surface to roughness 1, uniformly samples the spherical cap that a unit
 * hemisphere shows towards wo [Dupuy and Benyoub 2023, Listing 3]. */
static inline void sample_visible_normals(const struct lobes *s, const struct shade_packet *p,
                                          const struct lanes square[2], struct lanes d[3])
{
    LANES(l)
    {
        const float part = s->diffuse_part.v[l], nx = p->ns_x[l], ny = p->ns_y[l], nz = p->ns_z[l];
        const float sign = copysignf(1.0f, nz), a = -1.0f / (sign + nz), b = nx * ny * a;
        const float t[3] = { 1.0f + sign * nx * nx * a, sign * b, -sign * nx };
        const float u[3] = { b, sign + ny * ny * a, -ny };
        const float alpha = p->gloss[l], ox = s->out[0].v[l], oy = s->out[1].v[l], oz = s->out[2].v[l];
        float wx = alpha * (ox * t[0] + oy * t[1] + oz * t[2]), wy = alpha * (ox * u[0] + oy * u[1] + oz * u[2]);
        float wz = s->cosine_out.v[l];
        const float stretch = 1.0f / sqrtf(wx * wx + wy * wy + wz * wz);
        wx *= stretch;
        wy *= stretch;
        wz *= stretch;
        const float v = (square[0].v[l] - part) / (1.0f - part < 1e-6f ? 1e-6f : 1.0f - part);
        const float z = (1.0f - v) * (1.0f + wz) - wz, r2 = 1.0f - z * z, r = sqrtf(r2 > 0.0f ? r2 : 0.0f);
        float sine, cosine;
        lane_sincos(square[1].v[l], &sine, &cosine);
        const float mx = alpha * (r * cosine + wx), my = alpha * (r * sine + wy), mz = z + wz > 0.0f ? z + wz : 0.0f;
        const float m2 = mx * mx + my * my + mz * mz, scale = 1.0f / sqrtf(m2 > 1e-30f ? m2 : 1e-30f);
        const float hx = scale * (mx * t[0] + my * u[0] + mz * nx), hy = scale * (mx * t[1] + my * u[1] + mz * ny),
                    hz = scale * (mx * t[2] + my * u[2] + mz * nz);
        const float twice = 2.0f * (ox * hx + oy * hy + oz * hz);
        const int shiny = square[0].v[l] >= part;
        d[0].v[l] = shiny ? twice * hx - ox : d[0].v[l];
        d[1].v[l] = shiny ? twice * hy - oy : d[1].v[l];
        d[2].v[l] = shiny ? twice * hz - oz : d[2].v[l];
    }
}

/* Samples a direction from each lane's lobes, from its point of the unit square. The first number selects the lobe; its
 * remainder is reused. */
static inline void lobes_sample(const struct lobes *s, const struct shade_packet *p, const struct lanes square[2],
                                struct lanes d[3])
{
    struct lanes axis[3], local[3];

    LANES(l)
    {
        const float part = s->diffuse_part.v[l], u0 = square[0].v[l];
        const int diffuse = u0 < part || p->kind != LOBE_PHONG;
        const float rest = u0 < part ? u0 / part : (u0 - part) / (1.0f - part);
        const float u = rest < 1.0f ? rest : 1.0f;
        float sine, cosine, z = sqrtf(1.0f - u);
        if (!diffuse)
            z = lane_exp2(lane_log2(u > 1e-30f ? u : 1e-30f) / (p->gloss[l] + 1.0f));
        z = z < 1.0f ? z : 1.0f;
        const float r = sqrtf((1.0f - z) * (1.0f + z));
        lane_sincos(square[1].v[l], &sine, &cosine);
        local[0].v[l] = r * cosine;
        local[1].v[l] = r * sine;
        local[2].v[l] = z;
        axis[0].v[l] = diffuse ? p->ns_x[l] : s->reflected[0].v[l];
        axis[1].v[l] = diffuse ? p->ns_y[l] : s->reflected[1].v[l];
        axis[2].v[l] = diffuse ? p->ns_z[l] : s->reflected[2].v[l];
    }
    to_world(axis, local, d);
    if (p->kind == LOBE_GGX)
        sample_visible_normals(s, p, square, d);
}
