/* Scattering at a surface: its rough (D) lobe and its delta (S) lobe, with textures applied. Shared by everything that
 * traces paths: the G-buffer, eye paths, the light tracer and the reference. Thread: any.
 *
 * Delta lobes reflect and refract about the shading normal, or about the geometric one if the shading normal would send
 * the ray to the wrong side of the triangle. For camera paths the rule depends on the direction to the camera;
 * scatter_light is its exact adjoint, so that both cover the same paths [Veach 1997, section 5.3]. */
#pragma once

#include "scene/surface/material.h"
#include "scene/surface/packet.h"
#include "scene/surface/texture.h"

#include <stdbool.h>
#include <stdint.h>

/* A GGX lobe with a smaller alpha becomes a mirror. */
#define ALPHA_DELTA 1e-3f

enum delta_kind {
    DELTA_NONE,
    DELTA_MIRROR,     /* the same reflectance at all angles */
    DELTA_GLOSS,      /* a sharp GGX lobe: reflectance rises to 1 at grazing angles [Schlick 1994, Eq. 15] */
    DELTA_GLASS,      /* reflection and refraction by Fresnel */
    DELTA_THIN_GLASS, /* reflection of a thin sheet of glass; rays that it transmits do not hit it
                    (coverage.h) */
};

/* A coated surface has two layers with lobes of their own. The camera sees both; other paths choose one at random. */
enum scatter_layer {
    LAYER_BASE,
    LAYER_COAT,  /* a clear coat */
    LAYER_SHEEN, /* below it: the sheen of cloth */
};

#define COAT_F0 0.04f /* of an index of refraction of 1.5 */

/* The clear coat and the sheen on a surface, which attenuate the light from the layer below. */
struct veil {
    float coat;         /* the share of the surface that has a coat; 0: none */
    float alpha;        /* of its ggx lobe; 0: a mirror */
    struct vec3 normal; /* on the side of the surface's */
    float sheen;        /* the largest channel of the sheen's colour; 0: none */
    float sheen_roughness;
    struct vec3 sheen_colour, sheen_normal;
    bool of_sheen; /* the layer below the coat is the sheen itself */
};

static inline bool veil_is(const struct veil *v)
{
    return v->coat > 0.0f || v->sheen > 0.0f;
}

/* Transmittance of the coat and sheen for light from below towards wo. For the coat it is 1 - coat F(n.o), with F by
 * [Schlick 1994] as in glTF. Light is not attenuated on its way in, because the coat's internal reflection compensates
 * for that loss. F is that of a smooth coat, enlarged by 2.7 %, so that no lobe of any roughness reflects more. For
 * sheen it is glTF's 1 - max(colour) E(o), with E from scatter.h; the sheen itself is matte with albedo E(o) towards
 * wo. wo: as for the lobe below (scatter_side). */
float veil_passes(const struct veil *v, struct vec3 wo);

struct scatter {
    struct surface
        surface; /* on the side that the ray came from; with `through`, on that of the light (scatter_turn) */
    uint32_t mesh, material;
    bool rough; /* has a D lobe, described by the next four */
    enum lobe_kind kind;
    struct vec3 diffuse, specular;
    float gloss;
    struct vec3 beyond; /* replaces `diffuse` in the D lobe for light from the surface's other side; black
                           for most */
    bool through;       /* this is the lobe for light from the other side */
    enum scatter_layer layer;
    struct veil veil; /* on this layer; attenuates its rough and delta lobes */
    float weight;     /* of paths that continue from here: 1 / the probability of the chosen side and layer;
                         the coat's includes its share; 1 for most */
    enum delta_kind delta;
    struct vec3
        reflectance; /* of DELTA_MIRROR; of DELTA_GLOSS at normal incidence; of both glasses, the tint of what passes */
    float ior;       /* of both glasses, which are assumed to be in air */
    struct vec3 arrives; /* of DELTA_GLASS: the transmittance of the glass along the ray, which its rays
                            already include */
};

/* Evaluates a material at out->surface, which a ray has met after `distance` metres: everything of *out but surface,
 * mesh and material. smooth: the shading normal without a normal map. textures: the scene's. uv_step[4]: the two edges
 * of the area over which textures are averaged, in the mesh's first texture coordinates, then in its second; NULL: no
 * averaging. */
void scatter_of(const struct material *m, const struct texture *textures, struct vec3 smooth, float distance,
                const float (*uv_step)[2], struct scatter *out);

/* Where light from both sides counts, or there is a coat: chooses one side or layer of the result of scatter_of, with a
 * hash of the ray as the random number. */
void scatter_choose(struct scatter *s, const struct hit *h, struct vec3 dir);

/* Puts a surface on the other side of its triangle. */
void scatter_turn_over(struct scatter *s);

/* Replaces the result of scatter_of by the lobe for light from the other side. That lobe belongs to a surface seen from
 * the light's side, so lobe.h needs a mirrored direction to the camera (scatter_side). */
void scatter_turn(struct scatter *s);

/* Replaces the result of scatter_of by the clear coat that its veil describes. */
void scatter_coat(struct scatter *s);

/* As scatter_coat, for the sheen. */
void scatter_sheen(struct scatter *s);

/* Mirrors a direction to the camera's side of the surface if the light comes from the other side, as the D lobe
 * requires. */
struct vec3 scatter_side(const struct scatter *s, struct vec3 w);

/* The texture coordinates of one of the material's textures, and its part of an uv_step as above. */
static inline const float *map_uv(const struct material *m, enum material_map map, const struct surface *at)
{
    return m->second & (uint32_t)map ? at->more_uv : at->uv;
}

static inline const float (*map_step(const struct material *m, enum material_map map, const float (*uv_step)[2]))[2]
{
    return uv_step && (m->second & (uint32_t)map) ? uv_step + 2 : uv_step;
}

/* The mean of one of the material's `maps` at a place; uv_step as above. */
struct vec3 map_read(const struct texture *textures, const struct material *m, enum material_map map,
                     const struct surface *at, const float (*uv_step)[2]);

bool material_is_rough(const struct material *m); /* has a D lobe */
bool material_is_delta(const struct material *m); /* has an S lobe; ggx may have both */

struct delta_ray {
    struct vec3 origin, dir; /* offset from the surface; unit */
    float weight[3]; /* share of the incident flux; for light paths including the shading-normal factor |wi.ns| |wo.ng|
                        / (|wi.ng| |wo.ns|) [Veach 1997, Eq. 5.19] */
    bool crosses;    /* enters or leaves glass */
    float radiance_scale; /* (n before / n behind)^2: a factor of the radiance that camera paths carry back; unused by
                             light paths */
};

/* The continuations of a ray from the camera along dir (unit). Returns their number. */
uint32_t scatter_eye(const struct scatter *s, struct vec3 dir, struct delta_ray out[2]);

/* The continuations of light that arrives along dir (unit): every direction from which a camera ray would be sent to
 * where the light came from. Returns their number. */
uint32_t scatter_light(const struct scatter *s, struct vec3 dir, struct delta_ray out[4]);

/* A ray origin off the surface, on the side of its geometric normal for side = 1, behind it for -1. */
struct vec3 surface_start(const struct surface *s, float side);

/* Unpolarised Fresnel reflectance of a dielectric [Born and Wolf 1999, section 1.5.2]; eta: index behind over index
 * before the surface, cos_i > 0. *cos_t is 0 on total reflection. */
double fresnel_dielectric(double cos_i, double eta, double *cos_t);

/* A thin sheet of glass, all reflections between its faces together; a ray meets it, or passes as through a hole, at
 * random. */
struct thin_glass {
    struct vec3 reflected, passed; /* shares of the incident light */
    float covers;                  /* the probability of meeting it: 1 less the mean of `passed` */
};

/* cosine: of a ray with the normal, of either sign; tint: of light that passes once. */
struct thin_glass thin_glass_at(float ior, struct vec3 tint, float cosine);

/* ---- Sheen ---- */

/* The albedo of sheen [KHR_materials_sheen], as of cloth, under a uniform sky. Thread: any. */

/* The directional albedo of white sheen with this roughness (0..1; below 0.1 as 0.1) for a direction with this cosine
 * to the normal: the integral of D V cos over the hemisphere, with D and V of [Estevez and Kulla 2017] for alpha =
 * roughness^2; 0..1. */
float sheen_albedo(float cosine, float roughness);
