/* A scene: meshes in world space, materials, textures and cameras, loaded from a file (import/reader/reader.h) or
 * built-in. The scene owns its arrays. Immutable after loading. Thread: any number may read. */
#pragma once

#include "base/vec.h"
#include "scene/surface/material.h"
#include "scene/surface/texture.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Features of files that are not supported: each is named once in a warning and recorded in `unmodelled` for the
 * statistics. */
enum scene_feature {
    FEATURE_BUMP_MAP,      /* heights; normal maps are supported */
    FEATURE_ALPHA,         /* masks and blending; treated as opaque */
    FEATURE_SPECULAR_MAP,  /* of KHR_materials_specular and of transmission; only their factors count */
    FEATURE_SHEEN,         /* on glass */
    FEATURE_COAT_NORMAL,   /* normal maps of clear coats other than the surface's; the coats are smooth */
    FEATURE_COATED_GLASS,  /* rendered without the coat */
    FEATURE_ROUGH_GLASS,   /* treated as smooth, or as diffuse transmission */
    FEATURE_TINTED_GLASS,  /* of formats other than glTF; treated as clear */
    FEATURE_PARTIAL_GLASS, /* transmission below 0.5 is treated as a hole, else as 1 */
    FEATURE_VERTEX_COLOUR, /* of .fbx and .dae, and beside a texture of .obj and .ply; ignored */
    FEATURE_TEXTURE_TRANSFORM,
    FEATURE_SPECULAR_GLOSSINESS, /* textures with other coordinates than the diffuse texture; their means count */
    FEATURE_LIGHTS,              /* of formats other than glTF; ignored */
    FEATURE_ANIMATION,           /* of formats other than glTF; shown at rest */
    FEATURE_COUNT
};

struct box {               /* axis-aligned */
    struct vec3 low, high; /* m */
};

/* The placement of a mesh whose arrays are in an object space. */
struct placement {
    float matrix[3][4];  /* rows: from object space to world space */
    float normals[3][3]; /* the transpose of the inverse, up to a positive factor */
    float side;          /* the sign of the determinant; -1: triangles are clockwise seen from outside */
};

/* Triangles with one material. mesh_read.h reads them in world space. */
struct mesh {
    char name[64]; /* of the object that it belongs to; "": none */
    uint32_t vertex_count, triangle_count;
    float *positions;  /* [vertex_count][3], m; padded by one float, since Embree reads 16 bytes */
    float *normals;    /* [vertex_count][3], unit, or (0,0,0) if undefined; NULL: flat shading by geometric normals */
    float *uvs;        /* [vertex_count][2], v upwards as in OBJ; NULL: none */
    float *more_uvs;   /* [vertex_count][2], those of the material's textures in `second`; NULL: none */
    float *tangents;   /* [vertex_count][4]: the direction of increasing u, unit or 0, and the sign w of increasing v:
                          the bitangent is w cross(normal, tangent). NULL: no normal map */
    float *colours;    /* [vertex_count][4], linear Rec.709 and alpha, 0..1: multiply the material's; NULL: white */
    uint32_t *indices; /* [triangle_count][3], each < vertex_count, counter-clockwise seen from outside */
    uint32_t material; /* index into the scene's materials */
    uint32_t source;   /* 0: the mesh owns its arrays; else it shares those of mesh source - 1, which precedes it */
    bool placed;       /* the arrays are in a space of their own, where `bounds` is their box; else in world space */
    struct box bounds;
    struct placement place;
};

enum camera_projection {
    PROJECTION_PERSPECTIVE,
    PROJECTION_EQUIDISTANT, /* fisheye: the distance from the centre is proportional to the angle (Radiance's -vta) */
    PROJECTION_EQUISOLID,   /* fisheye: equal areas show equal solid angles */
};

struct camera {
    char name[64];
    struct vec3 position, look_at, up; /* m */
    float fov_y;                       /* radians: the vertical field of view; of a fisheye, the angle of its circle */
    enum camera_projection projection;
};

enum light_kind {
    LIGHT_POINT,
    LIGHT_SPOT,
    LIGHT_DIRECTIONAL,
};

/* A punctual light, as in glTF's KHR_lights_punctual: it has no size, so the camera sees it only by the surfaces it
 * lights. */
struct punctual_light {
    enum light_kind kind;
    struct vec3 position;       /* m; unused by directional lights */
    struct vec3 direction;      /* unit, the direction in which light travels; unused by point lights */
    struct vec3 intensity;      /* radiance x m^2 (candela, if radiance is in cd/m^2), within a spot's inner cone;
                                   directional: irradiance of a surface that faces it (lux). 0..LIGHT_INTENSITY_MAX */
    float inner_cos, outer_cos; /* cosines of a spot's half angles: full intensity inside the inner angle, none outside
                                   the outer */
};

#define LIGHT_INTENSITY_MAX 1e12f /* products with areas and weights still fit a float */
#define ANIMATION_TIME_MAX 1e6    /* s: the latest displayable moment of an animation */

/* The ground below the model (ground.h). */
struct ground {
    struct vec3 foot;   /* m: the middle of its disc */
    struct vec3 centre; /* m: of the sphere around the model's box, */
    float radius;       /* m; 0: there is no ground */
};

struct scene {
    struct mesh *meshes;
    size_t mesh_count;
    struct material *materials;
    size_t material_count;
    struct texture *textures;
    size_t texture_count;
    uint64_t texture_bytes; /* limit for added textures (scene_add_texture); 0: none */
    struct camera *cameras; /* at least one */
    size_t camera_count;
    struct punctual_light *lights;
    size_t light_count;
    uint64_t triangle_count; /* of all meshes, instances too */
    struct vec3 low, high;   /* bounding box of the triangles, m */
    double origin[3];        /* where the file has this scene's (0, 0, 0): not 0 if the model lies far from its own */
    struct ground ground;
    bool wants_ground;   /* its file requests one */
    bool animated;       /* while it is read: a model of it moves */
    uint32_t unmodelled; /* bit 1 << feature for each enum scene_feature that occurred */
};

/* A short description, and what happens instead, such as "tinted glass; it is clear". */
const char *scene_feature_name(enum scene_feature feature);

void scene_destroy(struct scene *s); /* NULL is allowed */

/* The camera of that name, or the first if name is NULL; NULL if there is none. */
const struct camera *scene_camera(const struct scene *s, const char *name);

/* "main, side and top": the names of the cameras, cut to size. */
void scene_camera_names(const struct scene *s, char *out, size_t size);

/* Axis-aligned boxes around the meshes with a delta lobe (mirror, glass, a sharp highlight), which cast caustics.
 * Returns their number; writes at most `room`. */
size_t scene_casters(const struct scene *s, struct box *out, size_t room);

/* Whether the scene has lights or emissive materials. */
bool scene_has_lamps(const struct scene *s);

/* The radiance that a surface of this material emits at a place of its texture; black for most. uv, uv_step: of
 * MAP_EMISSION (map_uv, map_step). */
struct vec3 scene_emission(const struct scene *s, uint32_t material, const float uv[2], const float (*uv_step)[2]);
