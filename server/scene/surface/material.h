/* Materials: how a surface scatters light. Colours are linear Rec.709 in 0..1. Thread: any. */
#pragma once

#include "base/vec.h"

#include <stdbool.h>
#include <stdint.h>

enum material_kind {
    MATERIAL_LAMBERT, /* diffuse / pi */
    MATERIAL_PHONG,   /* diffuse/pi + specular (n+2)/(2 pi) max(0, r.o)^n, diffuse + specular <= 1 per channel */
    MATERIAL_GGX,     /* the metallic-roughness model of glTF */
    MATERIAL_MIRROR,  /* delta reflection */
    MATERIAL_GLASS,   /* smooth dielectric: solid, or a thin sheet */
};

/* Holes in a surface. alpha is the material's, times that of its alpha texture. */
enum alpha_mode {
    ALPHA_OPAQUE, /* none */
    ALPHA_MASK,   /* surface where alpha >= alpha_cutoff */
    ALPHA_BLEND,  /* alpha is the fraction of an area that is surface */
};

/* Textures of a material other than its colour's. Those of numbers are bits of `maps`, those of colours of `second`
 * only. */
enum material_map {
    MAP_ROUGHNESS = 1, /* ggx: green multiplies roughness, blue metallic [glTF 2.0, section 3.9.2] */
    MAP_NORMAL = 2,    /* every kind: 2 rgb - 1 is the normal in the frame of tangent, bitangent and normal [ibid.,
                          section 3.9.3] */
    MAP_EMISSION = 4,
    MAP_THROUGH = 8,
    MAP_COAT = 16,             /* red multiplies coat [KHR_materials_clearcoat] */
    MAP_COAT_ROUGHNESS = 32,   /* green multiplies coat_roughness [ibid.] */
    MAP_SHEEN = 64,            /* multiplies `sheen` */
    MAP_SHEEN_ROUGHNESS = 128, /* red multiplies sheen_roughness */
};
#define MAPS_ALL (MAP_ROUGHNESS | MAP_NORMAL | MAP_COAT | MAP_COAT_ROUGHNESS | MAP_SHEEN_ROUGHNESS)
#define MAPS_COLOURS (MAP_EMISSION | MAP_THROUGH | MAP_SHEEN)
#define MAPS_MOVED (MAP_ROUGHNESS | MAP_NORMAL) /* which may be in `moved` */
#define NORMAL_SCALE_MAX 1e3f                   /* bound arithmetic in float: a file may say anything */
#define MOVED_MAX 1e6f
#define ATTENUATION_MAX 1e6f /* m^-1: opaque within a tenth of a millimetre */

#define MATERIAL_NO_TEXTURE UINT32_MAX
#define EMISSION_MAX 1e9f /* the sun's disc has 1.6e9 cd/m^2; products with areas and weights still fit a float */

struct material {
    char name[64];
    enum material_kind kind;
    struct vec3 diffuse;        /* lambert: albedo; phong: diffuse; ggx: base colour; mirror: reflectance; glass: tint
                                   of the light that passes the surface */
    struct vec3 specular;       /* phong: specular; ggx: what to add to 0.04 for F0 of the dielectric part, from -0.04
                                   to 0.96 */
    float exponent;             /* phong */
    float metallic, roughness;  /* ggx */
    uint32_t maps;              /* enum material_map */
    uint32_t second;            /* enum material_map: textures at the mesh's second texture coordinates */
    uint32_t moved;             /* the bits of `maps` whose texture coordinates are affine in the mesh's instead of
                                   equal to them: */
    float moved_by[2][6];       /* of MAP_ROUGHNESS and MAP_NORMAL: u' = m0 u + m1 v + m2, v' = m3 u + m4 v + m5;
                                   at most MOVED_MAX either way. MAP_NORMAL: m1 = m3 = 0 < m0, m4 */
    uint32_t roughness_texture; /* of MAP_ROUGHNESS; an index like `texture` */
    uint32_t normal_texture;    /* of MAP_NORMAL, likewise */
    uint32_t coat_texture, coat_roughness_texture; /* of MAP_COAT and MAP_COAT_ROUGHNESS, likewise */
    float normal_scale;               /* of MAP_NORMAL: multiplies its x and y; at most NORMAL_SCALE_MAX either way */
    float coat;                       /* lambert, ggx: the share of the surface with a clear coat, 0..1, */
    float coat_roughness;             /* with a ggx lobe of this roughness, */
    uint32_t coat_bent;               /* about the normal of MAP_NORMAL: 1; or the mesh's: 0 */
    struct vec3 sheen;                /* lambert, ggx: the colour of a sheen on top, below the coat; 0: none, */
    float sheen_roughness;            /* of this roughness */
    uint32_t sheen_texture;           /* multiplies it, if it is not 0; an index like `texture` */
    uint32_t sheen_roughness_texture; /* of MAP_SHEEN_ROUGHNESS, likewise */
    float transmits;          /* lambert, ggx: the share of the matte part that is scattered to the other side, 0..1, */
    struct vec3 through;      /* in this colour */
    uint32_t through_texture; /* multiplies it, if transmits is not 0; an index like `texture` */
    float ior;                /* glass */
    uint32_t thin;            /* glass: 1: an infinitely thin sheet, which light crosses without a change of direction;
                                 else 0 */
    struct vec3 attenuation;  /* glass that is not thin: light that travels x metres inside is multiplied by
                                 exp(-attenuation x);    0..ATTENUATION_MAX, m^-1 */
    uint32_t texture;         /* multiplies diffuse; an index into the scene's textures, or MATERIAL_NO_TEXTURE */
    enum alpha_mode alpha_mode; /* unless ALPHA_OPAQUE, the next three apply */
    float alpha, alpha_cutoff;  /* 0..1; of ALPHA_MASK, at least 0 */
    uint32_t alpha_texture;     /* its alpha multiplies `alpha`; an index like `texture` */
    struct vec3 emission;       /* radiance that both sides emit in every direction, 0..EMISSION_MAX */
    uint32_t emission_texture;  /* multiplies emission, likewise; unused where emission is 0 */
    uint32_t ground;            /* 1: the ground's (ground.h), else 0 */
};

/* F at normal incidence of glTF's metallic-roughness model: 0.04 + more for a dielectric, the base colour for a metal
 * [glTF 2.0, appendix B]. */
struct vec3 ggx_f0(struct vec3 base, float metallic, struct vec3 more);

/* The matte albedo below a GGX lobe, for the BRDF S(n.w) S(n.o) matte / pi with S(c) = 1 - (1 - c)^5, which reflects
 * 20/21 S(n.o) matte. It has two parts, per channel with f = F0:
 *
 * (1 - metallic) base (1 - f) 21/20: light enters the surface and scatters below it; light that is reflected back
 * inside scatters again until it has left. A white dielectric then reflects everything.
 *
 * f^2 (1 - l) / (1 - f l) m, f and l being means over the hemisphere: the light that a lobe of this roughness loses
 * because it models single scattering only. l is the loss of a perfect reflector, the quotient is the light that
 * multiple scattering returns in this colour [Kulla and Conty 2017], and m is the largest matte part with which a
 * perfect reflector conserves energy for every direction. */
struct vec3 ggx_matte(struct vec3 base, float metallic, float roughness, struct vec3 more);

/* The part of ggx_matte without multiple scattering: the light that a dielectric of this colour scatters below its
 * surface. */
struct vec3 ggx_below(struct vec3 colour, struct vec3 base, float metallic, struct vec3 more);

/* The attenuation that gives white light this colour after `distance` metres, as glTF defines it
 * [KHR_materials_volume]. distance > 0. */
struct vec3 attenuation_from(struct vec3 colour, double distance);

/* Whether metallic and roughness count, and so MAP_ROUGHNESS. */
static inline bool material_has_finish(const struct material *m)
{
    return m->kind == MATERIAL_GGX;
}

/* Whether there may be a coat, a sheen and a matte part that transmits. */
static inline bool material_has_layers(const struct material *m)
{
    return m->kind == MATERIAL_LAMBERT || m->kind == MATERIAL_GGX;
}

/* "lambert", "phong", ...; never NULL. */
const char *material_kind_name(enum material_kind kind);

/* ---- Points on surfaces ---- */

/* Where a ray has met a surface: what rays.h fills and scattering needs. Thread: any. */

struct hit { /* the first hit of a ray */
    float t;
    uint32_t mesh, triangle;
    float u, v; /* barycentric: p = (1-u-v) p0 + u p1 + v p2 */
};

/* The surface at a hit, computed from the mesh in double precision, so that secondary rays start on it. */
struct surface {
    struct vec3 position;    /* m */
    struct vec3 geometric;   /* unit normal of the triangle, on the side of `towards` */
    struct vec3 shading;     /* unit, interpolated if the mesh has normals; on the same side as geometric */
    bool outside;            /* the ray came from the side where the vertices are counter-clockwise */
    float uv[2], more_uv[2]; /* by the mesh's uvs and more_uvs */
    struct vec3 colour;      /* of the mesh, interpolated; white without colours */
    float offset;            /* m: offset along the geometric normal that keeps a ray from hitting its own triangle */
};
