#include "scene/surface/scatter.h"

#include "base/rng.h"

#include <math.h>
#include <string.h>

#define GGX_SPARED 0.0137f /* the largest difference of the two shares, at any angle, by quadrature */
#define VEIL_GAIN 1.027f   /* of the lobe of roughness 0.3 at a cosine of 0.6, over F(n.o) */

static float brightness(struct vec3 v)
{
    return (v.x + v.y + v.z) / 3.0f;
}

static struct vec3 base_colour(const struct material *m, const struct texture *textures, const float uv[2],
                               const float (*step)[2])
{
    if (m->texture == MATERIAL_NO_TEXTURE)
        return m->diffuse;
    return vec3_mul(m->diffuse, texture_read(&textures[m->texture], uv, step));
}

/* A roughness map never creates a mirror: the type of a path vertex, S or D, must not depend on texture filtering. */
static bool is_sharp(const struct material *m)
{
    return m->kind == MATERIAL_GGX && !(m->maps & MAP_ROUGHNESS) && m->roughness * m->roughness < ALPHA_DELTA;
}

static bool is_sharp_coat(const struct material *m)
{
    return !(m->maps & MAP_COAT_ROUGHNESS) && m->coat_roughness * m->coat_roughness < ALPHA_DELTA;
}

bool material_is_delta(const struct material *m)
{
    return m->kind == MATERIAL_MIRROR || m->kind == MATERIAL_GLASS || is_sharp(m) ||
           (m->coat > 0.0f && is_sharp_coat(m));
}

bool material_is_rough(const struct material *m)
{
    return m->kind == MATERIAL_LAMBERT || m->kind == MATERIAL_PHONG || brightness(m->sheen) > 0.0f ||
           (m->kind == MATERIAL_GGX && (!is_sharp(m) || m->metallic < 1.0f));
}

static void move(const float by[6], const float from[2], float share, float to[2])
{
    to[0] = by[0] * from[0] + by[1] * from[1] + share * by[2];
    to[1] = by[3] * from[0] + by[4] * from[1] + share * by[5];
}

struct vec3 map_read(const struct texture *textures, const struct material *m, enum material_map map,
                     const struct surface *at, const float (*uv_step)[2])
{
    const bool normal = map == MAP_NORMAL;
    const float *uv = map_uv(m, map, at);
    const float(*own)[2] = map_step(m, map, uv_step);
    const uint32_t index = map == MAP_COAT              ? m->coat_texture
                           : map == MAP_COAT_ROUGHNESS  ? m->coat_roughness_texture
                           : map == MAP_SHEEN_ROUGHNESS ? m->sheen_roughness_texture
                           : normal                     ? m->normal_texture
                                                        : m->roughness_texture;
    const struct texture *t = &textures[index];
    float place[2], step[2][2] = { { 0.0f } };

    if (!(m->moved & (uint32_t)map))
        return texture_read(t, uv, own);
    move(m->moved_by[normal], uv, 1.0f, place);
    for (int k = 0; k < 2 && own; k++)
        move(m->moved_by[normal], own[k], 0.0f, step[k]);
    return texture_read(t, place, own ? (const float(*)[2])step : NULL);
}

struct finish {
    float metallic, roughness;
};

/* Of ggx, at a place. */
static struct finish finish_at(const struct material *m, const struct texture *textures, const struct surface *at,
                               const float (*step)[2])
{
    if (!(m->maps & MAP_ROUGHNESS))
        return (struct finish){ m->metallic, m->roughness };
    const struct vec3 v = map_read(textures, m, MAP_ROUGHNESS, at, step);
    return (struct finish){ m->metallic * v.z, m->roughness * v.y };
}

static void fill_rough(const struct material *m, struct vec3 base, struct finish finish, struct scatter *out)
{
    out->kind = LOBE_LAMBERT;
    out->diffuse = base;
    out->specular = vec3_make(0.0f, 0.0f, 0.0f);
    out->gloss = 0.0f;
    if (m->kind == MATERIAL_PHONG && m->specular.x + m->specular.y + m->specular.z > 0.0f) {
        out->kind = LOBE_PHONG;
        out->specular = m->specular;
        out->gloss = m->exponent;
    } else if (m->kind == MATERIAL_GGX) {
        out->kind = LOBE_GGX;
        out->diffuse = ggx_matte(base, finish.metallic, finish.roughness, m->specular);
        out->specular = ggx_f0(base, finish.metallic, m->specular);
        out->gloss = is_sharp(m) ? 0.0f : fmaxf(finish.roughness * finish.roughness, ALPHA_DELTA);
    }
}

/* Moves a share of the matte part to the other side, in a colour of its own. */
static void split_matte(const struct material *m, const struct texture *textures, struct vec3 base,
                        struct finish finish, const float (*step)[2], struct scatter *out)
{
    const struct vec3 own =
        m->through_texture == MATERIAL_NO_TEXTURE
            ? m->through
            : vec3_mul(m->through, texture_read(&textures[m->through_texture], map_uv(m, MAP_THROUGH, &out->surface),
                                                map_step(m, MAP_THROUGH, step)));
    const bool ggx = m->kind == MATERIAL_GGX;
    const struct vec3 left = ggx ? ggx_below(base, base, finish.metallic, m->specular) : base;
    const struct vec3 beyond = ggx ? ggx_below(own, base, finish.metallic, m->specular) : own;

    out->diffuse = vec3_sub(out->diffuse, vec3_scale(left, m->transmits));
    out->beyond = vec3_scale(beyond, m->transmits);
}

/* What a ray of unit direction that meets glass from inside has left [Bouguer, Lambert and Beer]. */
static struct vec3 arriving(const struct material *m, float distance, const struct surface *s)
{
    const struct vec3 a = m->attenuation;

    if (m->kind != MATERIAL_GLASS || m->thin || s->outside || !(a.x + a.y + a.z > 0.0f))
        return vec3_make(1.0f, 1.0f, 1.0f);
    return vec3_make(expf(-a.x * distance), expf(-a.y * distance), expf(-a.z * distance));
}

/* A random number in [0, 1) of a ray, the same on every CPU but where rounding decides about 2^-12 of the triangle. */
static float hash_hit(const struct hit *h, struct vec3 dir)
{
    const float u = floorf(4096.0f * h->u), v = floorf(4096.0f * h->v);
    uint32_t d[3];

    memcpy(d, &dir, sizeof(d));
    const uint64_t ray = rng_mix((uint64_t)d[0] << 32 | d[1], (uint64_t)d[2] << 32 | ((uint32_t)u << 16 | (uint32_t)v));
    return (float)(rng_mix(ray, (uint64_t)h->mesh << 32 | h->triangle) >> 40) * 0x1p-24f;
}

/* Turns s by its share of what the surface scatters. x in [0, 1): a random number, of which the rest remains. */
static void choose_side(struct scatter *s, float *x)
{
    const float beyond = brightness(s->beyond), here = brightness(s->diffuse) + brightness(s->specular);

    if (!(beyond > 0.0f))
        return;
    const float share = here > 0.0f ? fminf(fmaxf(beyond / (beyond + here), 0.1f), 0.9f) : 1.0f;
    if (*x < share) {
        scatter_turn(s);
        s->weight = 1.0f / share;
    } else {
        *x = (*x - share) / (1.0f - share);
        s->weight = 1.0f / (1.0f - share);
    }
}

/* What a coat lets pass from below, and what white sheen reflects, towards wo. */
static float coat_passes(const struct veil *v, struct vec3 wo)
{
    const float c = 1.0f - fminf(fmaxf(vec3_dot(v->normal, wo), 0.0f), 1.0f), c2 = c * c;

    return fmaxf(0.0f, 1.0f - v->coat * VEIL_GAIN * (COAT_F0 + (1.0f - COAT_F0) * c2 * c2 * c));
}

static float sheen_shine(const struct veil *v, struct vec3 wo)
{
    return sheen_albedo(vec3_dot(v->sheen_normal, wo), v->sheen_roughness);
}

float veil_passes(const struct veil *v, struct vec3 wo)
{
    float passes = 1.0f;

    if (v->coat > 0.0f)
        passes = coat_passes(v, wo);
    if (v->sheen > 0.0f)
        passes *= v->of_sheen ? sheen_shine(v, wo) : 1.0f - v->sheen * sheen_shine(v, wo);
    return passes;
}

/* Whether a layer that reflects `own` is chosen before the `rest` below it. x: as of choose_side. */
static bool choose_this(struct scatter *s, float own, float rest, float *x)
{
    const float share = fminf(fmaxf(own / (own + rest), 0.1f), 0.9f); /* 0.1 for NaN */

    if (*x < share) {
        s->weight /= share;
        return true;
    }
    *x = (*x - share) / (1.0f - share);
    s->weight /= 1.0f - share;
    return false;
}

/* A layer of which light from dir meets much is chosen more often. */
static void choose_layer(struct scatter *s, struct vec3 dir, float x)
{
    const struct vec3 wo = vec3_scale(dir, -1.0f);
    const float below = brightness(s->diffuse) + brightness(s->specular);
    const float sheen = s->veil.sheen > 0.0f ? brightness(s->veil.sheen_colour) * sheen_shine(&s->veil, wo) : 0.0f;

    if (s->veil.coat > 0.0f && choose_this(s, 1.0f - coat_passes(&s->veil, wo), below + sheen, &x))
        scatter_coat(s);
    else if (s->veil.sheen > 0.0f && choose_this(s, sheen, below, &x))
        scatter_sheen(s);
}

void scatter_choose(struct scatter *s, const struct hit *h, struct vec3 dir)
{
    const bool veiled = veil_is(&s->veil);

    if (!(brightness(s->beyond) > 0.0f) && !veiled)
        return;
    float x = hash_hit(h, dir);
    choose_side(s, &x);
    if (veiled && !s->through)
        choose_layer(s, dir, x);
}

void scatter_turn_over(struct scatter *s)
{
    s->surface.geometric = vec3_scale(s->surface.geometric, -1.0f);
    s->surface.shading = vec3_scale(s->surface.shading, -1.0f);
    s->surface.outside = !s->surface.outside;
    s->veil.normal = vec3_scale(s->veil.normal, -1.0f);
    s->veil.sheen_normal = vec3_scale(s->veil.sheen_normal, -1.0f);
}

/* The coat at a place. smooth: the shading normal without the map. */
static void put_coat(const struct material *m, const struct texture *textures, struct vec3 smooth,
                     const float (*step)[2], struct scatter *out)
{
    const struct surface *at = &out->surface;
    float share = m->coat, roughness = m->coat_roughness;

    if (m->maps & MAP_COAT)
        share *= map_read(textures, m, MAP_COAT, at, step).x;
    if (m->maps & MAP_COAT_ROUGHNESS)
        roughness *= map_read(textures, m, MAP_COAT_ROUGHNESS, at, step).y;
    const float alpha = is_sharp_coat(m) ? 0.0f : fmaxf(roughness * roughness, ALPHA_DELTA);
    out->veil.coat = share;
    out->veil.alpha = alpha;
    out->veil.normal = m->coat_bent ? at->shading : smooth;
}

static void put_sheen(const struct material *m, const struct texture *textures, const float (*step)[2],
                      struct scatter *out)
{
    struct vec3 c = m->sheen;
    float roughness = m->sheen_roughness;

    if (m->maps & MAP_SHEEN_ROUGHNESS)
        roughness *= map_read(textures, m, MAP_SHEEN_ROUGHNESS, &out->surface, step).x;
    if (m->sheen_texture != MATERIAL_NO_TEXTURE)
        c = vec3_mul(c, texture_read(&textures[m->sheen_texture], map_uv(m, MAP_SHEEN, &out->surface),
                                     map_step(m, MAP_SHEEN, step)));
    out->veil.sheen = fmaxf(c.x, fmaxf(c.y, c.z));
    out->veil.sheen_roughness = roughness;
    out->veil.sheen_colour = c;
    out->veil.sheen_normal = out->surface.shading;
}

void scatter_sheen(struct scatter *s)
{
    s->layer = LAYER_SHEEN;
    s->veil.of_sheen = true;
    s->kind = LOBE_LAMBERT;
    s->diffuse = s->veil.sheen_colour;
    s->beyond = s->specular = vec3_make(0.0f, 0.0f, 0.0f);
    s->gloss = 0.0f;
    s->rough = true;
    s->delta = DELTA_NONE;
}

void scatter_coat(struct scatter *s)
{
    const float alpha = s->veil.alpha;

    s->layer = LAYER_COAT;
    s->weight *= s->veil.coat;
    s->surface.shading = s->veil.normal;
    s->veil.coat = s->veil.sheen = 0.0f;
    s->kind = LOBE_GGX;
    s->diffuse = s->beyond = vec3_make(0.0f, 0.0f, 0.0f);
    s->specular = s->reflectance = vec3_make(COAT_F0, COAT_F0, COAT_F0);
    s->gloss = alpha;
    s->rough = alpha > 0.0f;
    s->delta = s->rough ? DELTA_NONE : DELTA_GLOSS;
}

void scatter_turn(struct scatter *s)
{
    scatter_turn_over(s);
    s->diffuse = s->beyond;
    s->specular = vec3_make(0.0f, 0.0f, 0.0f);
    s->gloss = 0.0f;
    s->delta = DELTA_NONE;
    s->through = true;
}

struct vec3 scatter_side(const struct scatter *s, struct vec3 w)
{
    return s->through ? vec3_sub(w, vec3_scale(s->surface.shading, 2.0f * vec3_dot(w, s->surface.shading))) : w;
}

/* The factor of the matte part under a normal map. Of the light that the matte part would reflect by the cosine with
 * its shading normal, the triangle hides the part from below: x = (1 - cos) / 2 of a uniform sky, by the angle between
 * the two normals. The factor 1 / (1 - x) restores it, so that a white surface under a uniform sky stays white. The
 * matte part of ggx loses less, since little of that light enters it: at least x - 0.0137. The loss of a specular lobe
 * is not restored. */
static float matte_gain(enum lobe_kind kind, const struct surface *at)
{
    const float hidden = 0.5f * (1.0f - fminf(1.0f, vec3_dot(at->shading, at->geometric)));
    return 1.0f / (1.0f - (kind == LOBE_GGX ? fmaxf(0.0f, hidden - GGX_SPARED) : hidden));
}

void scatter_of(const struct material *m, const struct texture *textures, struct vec3 smooth, float distance,
                const float (*uv_step)[2], struct scatter *out)
{
    const struct vec3 base = vec3_mul(base_colour(m, textures, out->surface.uv, uv_step), out->surface.colour);
    const struct finish finish = finish_at(m, textures, &out->surface, uv_step);
    out->rough = material_is_rough(m);
    fill_rough(m, base, finish, out);
    out->beyond = vec3_make(0.0f, 0.0f, 0.0f);
    out->through = false;
    out->weight = 1.0f;
    out->layer = LAYER_BASE;
    out->veil = (struct veil){ .coat = 0.0f };
    if (m->coat > 0.0f)
        put_coat(m, textures, smooth, uv_step, out);
    if (brightness(m->sheen) > 0.0f)
        put_sheen(m, textures, uv_step, out);
    if (m->transmits > 0.0f)
        split_matte(m, textures, base, finish, uv_step, out);
    if (m->maps & MAP_NORMAL) {
        const float gain = matte_gain(out->kind, &out->surface);
        out->diffuse = vec3_scale(out->diffuse, gain);
        out->beyond = vec3_scale(out->beyond, gain);
    }
    out->delta = m->kind == MATERIAL_MIRROR  ? DELTA_MIRROR
                 : m->kind == MATERIAL_GLASS ? (m->thin ? DELTA_THIN_GLASS : DELTA_GLASS)
                 : is_sharp(m)               ? DELTA_GLOSS
                                             : DELTA_NONE;
    out->reflectance = out->delta == DELTA_GLOSS ? ggx_f0(base, finish.metallic, m->specular) : base;
    out->ior = m->kind == MATERIAL_GLASS ? m->ior : 1.0f;
    out->arrives = arriving(m, distance, &out->surface);
}

double fresnel_dielectric(double cos_i, double eta, double *cos_t)
{
    const double sin2_t = (1.0 - cos_i * cos_i) / (eta * eta);

    *cos_t = 0.0;
    if (sin2_t >= 1.0)
        return 1.0;
    *cos_t = sqrt(1.0 - sin2_t);
    const double parallel = (eta * cos_i - *cos_t) / (eta * cos_i + *cos_t);
    const double across = (cos_i - eta * *cos_t) / (cos_i + eta * *cos_t);
    return 0.5 * (parallel * parallel + across * across);
}

struct thin_glass thin_glass_at(float ior, struct vec3 tint, float cosine)
{
    const double tints[3] = { tint.x, tint.y, tint.z };
    float reflected[3], passed[3];
    double cos_t;

    const double f = fresnel_dielectric(fmin(fabs((double)cosine), 1.0), (double)ior, &cos_t), through = 1.0 - f;
    for (int k = 0; k < 3; k++) {
        const double rest = 1.0 - f * f * tints[k] * tints[k]; /* 0 only where f is 1 */
        passed[k] = rest > 0.0 ? (float)(through * through * tints[k] / rest) : 0.0f;
        reflected[k] = (float)(f + f * tints[k] * (double)passed[k]);
    }
    return (struct thin_glass){ { reflected[0], reflected[1], reflected[2] },
                                { passed[0], passed[1], passed[2] },
                                1.0f - (passed[0] + passed[1] + passed[2]) / 3.0f };
}

struct vec3 surface_start(const struct surface *s, float side)
{
    return vec3_add(s->position, vec3_scale(s->geometric, side * s->offset));
}

static struct vec3 reflect(struct vec3 dir, struct vec3 n)
{
    return vec3_normalize(vec3_sub(dir, vec3_scale(n, 2.0f * vec3_dot(dir, n))));
}

/* Refraction about n (on the side that dir comes from). Returns the Fresnel reflectance, 1 on total reflection. */
static double refract(struct vec3 dir, struct vec3 n, double eta, struct vec3 *out)
{
    const double cos_i = fmin(1.0, -(double)vec3_dot(dir, n));
    double cos_t;

    const double f = fresnel_dielectric(cos_i, eta, &cos_t);
    *out = vec3_normalize(vec3_add(vec3_scale(dir, (float)(1.0 / eta)), vec3_scale(n, (float)(cos_i / eta - cos_t))));
    return f;
}

/* Index behind the surface over index before it; glass is assumed to be in air. */
static double index_ratio(const struct scatter *s)
{
    return s->surface.outside ? (double)s->ior : 1.0 / (double)s->ior;
}

/* Whether an eye ray along dir uses the shading normal: unless that would send it, reflected or refracted, to the wrong
 * side of the triangle. geometric and shading face the side that dir comes from. */
static bool by_shading_normal(struct vec3 geometric, struct vec3 shading, struct vec3 dir, enum delta_kind delta,
                              double eta)
{
    struct vec3 through;

    if (vec3_dot(dir, shading) >= 0.0f || vec3_dot(reflect(dir, shading), geometric) <= 0.0f)
        return false;
    if (delta != DELTA_GLASS || refract(dir, shading, eta, &through) >= 1.0)
        return true;
    return vec3_dot(through, geometric) < 0.0f;
}

static struct vec3 reflectance_at(const struct scatter *s, float cosine)
{
    const float c = 1.0f - fminf(1.0f, fmaxf(0.0f, cosine)), x = c * c * c * c * c;
    const struct vec3 r = s->reflectance;

    if (s->delta == DELTA_MIRROR)
        return r;
    return vec3_make(r.x + (1.0f - r.x) * x, r.y + (1.0f - r.y) * x, r.z + (1.0f - r.z) * x);
}

/* What a sheet reflects of a ray that has met it. in, out: cosines of the ray and of the eye with the geometric normal,
 * which differ for light that is reflected about another. */
static struct vec3 reflectance_of_thin_glass(const struct scatter *s, float in, float out)
{
    const float covers = thin_glass_at(s->ior, s->reflectance, in).covers;

    return vec3_scale(thin_glass_at(s->ior, s->reflectance, out).reflected, covers > 0.0f ? 1.0f / covers : 0.0f);
}

static void set_ray(struct delta_ray *ray, const struct scatter *s, float side, struct vec3 dir, struct vec3 weight)
{
    ray->origin = surface_start(&s->surface, side);
    ray->dir = dir;
    ray->weight[0] = weight.x * s->arrives.x;
    ray->weight[1] = weight.y * s->arrives.y;
    ray->weight[2] = weight.z * s->arrives.z;
    ray->crosses = side < 0.0f;
    ray->radiance_scale = 1.0f;
    if (ray->crosses) {
        const float eta = (float)index_ratio(s);
        ray->radiance_scale = 1.0f / (eta * eta);
    }
}

static struct vec3 grey(double x)
{
    return vec3_make((float)x, (float)x, (float)x);
}

uint32_t scatter_eye(const struct scatter *s, struct vec3 dir, struct delta_ray out[2])
{
    const double eta = index_ratio(s);
    struct vec3 through;

    if (s->delta == DELTA_NONE)
        return 0;
    const bool shading = by_shading_normal(s->surface.geometric, s->surface.shading, dir, s->delta, eta);
    const struct vec3 n = shading ? s->surface.shading : s->surface.geometric;
    const struct vec3 back = reflect(dir, n);
    if (s->delta == DELTA_THIN_GLASS) {
        const float in = vec3_dot(dir, s->surface.geometric);
        set_ray(&out[0], s, 1.0f, back, reflectance_of_thin_glass(s, in, in));
        return 1;
    }
    if (s->delta != DELTA_GLASS) {
        const float passes = veil_passes(&s->veil, vec3_scale(dir, -1.0f));
        set_ray(&out[0], s, 1.0f, back, vec3_scale(reflectance_at(s, -vec3_dot(dir, n)), passes));
        return 1;
    }
    const double f = refract(dir, n, eta, &through);
    set_ray(&out[0], s, 1.0f, back, grey(f));
    if (f >= 1.0)
        return 1;
    set_ray(&out[1], s, -1.0f, through, vec3_scale(s->reflectance, (float)(1.0 - f)));
    return 2;
}

/* Light along dir, scattered about the normal n, which may be the shading normal. */
static uint32_t light_by(const struct scatter *s, struct vec3 dir, struct vec3 n, bool shading, struct delta_ray *out)
{
    const struct surface *at = &s->surface;
    const float in_g = -vec3_dot(dir, at->geometric), in_n = -vec3_dot(dir, n);
    const double eta = index_ratio(s);
    uint32_t count = 0;
    struct vec3 through;

    if (!(in_n > 0.0f && in_g > 0.0f))
        return 0;
    const struct vec3 back = reflect(dir, n);
    const float out_g = vec3_dot(back, at->geometric);
    const double f = s->delta == DELTA_GLASS ? refract(dir, n, eta, &through) : 1.0;
    if (out_g > 0.0f &&
        by_shading_normal(at->geometric, at->shading, vec3_scale(back, -1.0f), s->delta, eta) == shading) {
        const struct vec3 r = s->delta == DELTA_GLASS        ? grey(f)
                              : s->delta == DELTA_THIN_GLASS ? reflectance_of_thin_glass(s, in_g, out_g)
                                                             : reflectance_at(s, in_n);
        set_ray(&out[count++], s, 1.0f, back, vec3_scale(r, veil_passes(&s->veil, back) * out_g / in_g));
    }
    if (f >= 1.0)
        return count;
    const float through_g = -vec3_dot(through, at->geometric), through_n = -vec3_dot(through, n);
    if (through_g > 0.0f && through_n > 0.0f &&
        by_shading_normal(vec3_scale(at->geometric, -1.0f), vec3_scale(at->shading, -1.0f), vec3_scale(through, -1.0f),
                          s->delta, 1.0 / eta) == shading)
        set_ray(&out[count++], s, -1.0f, through,
                vec3_scale(s->reflectance, (float)((1.0 - f) * in_n * through_g / (in_g * through_n))));
    return count;
}

uint32_t scatter_light(const struct scatter *s, struct vec3 dir, struct delta_ray out[4])
{
    const struct surface *at = &s->surface;

    if (s->delta == DELTA_NONE)
        return 0;
    const uint32_t count = light_by(s, dir, at->shading, true, out);
    return count + light_by(s, dir, at->geometric, false, out + count);
}
