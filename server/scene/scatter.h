/* server/scene/scatter.h */
/* What a surface does with a ray that meets it: its rough lobe D and its delta lobe S, textures applied. Shared by all
 * who follow rays: the G-buffer's chains, eye paths, the light tracer, the reference. Pure functions; any thread.
 *
 * Delta lobes reflect and refract about the shading normal, unless that would send a ray to the wrong side of the
 * triangle: then about the geometric one. Seen from the eye that is a rule about the direction to the eye; the light's
 * side (scatter_light) is its exact adjoint, so that both count the same paths [Veach 1997, section 5.3]. */
#ifndef SCENE_SCATTER_H
#define SCENE_SCATTER_H

#include "material.h"
#include "rays.h"
#include "scene.h"

#include <stdbool.h>
#include <stdint.h>

enum lobe_kind {
    LOBE_LAMBERT, /* diffuse only */
    LOBE_PHONG,   /* diffuse + specular lobe with exponent */
    LOBE_GGX,     /* diffuse = base colour * (1 - metallic), specular = F0, gloss = alpha; where that is 0, the
                   * specular lobe is the delta lobe's, and what is left is the diffuse part below such a surface */
};

/* Below this alpha a GGX lobe is a mirror. */
#define ALPHA_DELTA 1e-3f

enum delta_kind {
    DELTA_NONE,
    DELTA_MIRROR, /* reflectance at all angles */
    DELTA_GLOSS,  /* a GGX lobe that is so sharp: reflectance grows to 1 at grazing angles [Schlick 1994, Eq. 15] */
    DELTA_GLASS,  /* reflects and refracts by Fresnel */
};

struct scatter {
    struct surface surface; /* turned to the side that the ray came from */
    uint32_t mesh, material;
    bool rough; /* has a D lobe: the next four */
    enum lobe_kind kind;
    struct vec3 diffuse, specular;
    float gloss;
    enum delta_kind delta;
    struct vec3 reflectance; /* of DELTA_MIRROR and, at normal incidence, DELTA_GLOSS */
    float ior;               /* of DELTA_GLASS, which stands in air */
};

/* dir: where the ray was going, unit. */
void scatter_at(const struct scene *scene, const struct rays *rays, const struct hit *h, struct vec3 dir,
                struct scatter *out);

/* Whether a material has a D lobe, and whether it has an S lobe (ggx may have both). */
bool material_is_rough(const struct material *m);
bool material_is_delta(const struct material *m);

struct delta_ray {
    struct vec3 origin, dir; /* off the surface; unit */
    float weight[3];         /* share of what came that goes this way, in flux; light paths: with the shading-normal
                              * factor |wi.ns| |wo.ng| / (|wi.ng| |wo.ns|) [Veach 1997, Eq. 5.19] */
    bool crosses;            /* into or out of glass */
    float radiance_scale;    /* (n before / n behind)^2: eye paths multiply what they bring back by it, light paths
                              * do not */
};

/* Where a ray from the eye goes on; returns how many were written. */
uint32_t scatter_eye(const struct scatter *s, struct vec3 dir, struct delta_ray out[2]);

/* Where light that arrives along dir goes on: every direction from which an eye ray would be sent to where the light
 * came from. */
uint32_t scatter_light(const struct scatter *s, struct vec3 dir, struct delta_ray out[4]);

/* A point off the surface, on the side of its geometric normal for side = 1, behind it for -1. */
struct vec3 surface_start(const struct surface *s, float side);

/* Unpolarised Fresnel reflectance of a dielectric; eta is the index behind over the index before the surface, cos_i > 0
 * [Born and Wolf 1999, section 1.5.2]. *cos_t is 0 on total reflection. */
double fresnel_dielectric(double cos_i, double eta, double *cos_t);

#endif
