/* server/scene/scene.h */
/* What stands in front of the camera: meshes in world space, materials, textures and cameras, as described by a JSON
 * scene file or a glTF file, or made by code. Never changes after loading: any number of threads may read one. */
#ifndef SCENE_SCENE_H
#define SCENE_SCENE_H

#include "err.h"
#include "material.h"
#include "vec.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct progress;

/* What files describe and this program does not model: each is named once in a warning and kept in the scene's
 * `unmodelled`, for the statistics. */
enum scene_feature {
    FEATURE_NORMAL_MAP,
    FEATURE_ALPHA,         /* masks and blending: the surface is taken as opaque */
    FEATURE_VOLUME,        /* attenuation inside glass */
    FEATURE_EMISSION,      /* taken as black */
    FEATURE_ROUGHNESS_MAP, /* metallic and roughness textures: their means count */
    FEATURE_CLEARCOAT,     /* clearcoat and sheen */
    FEATURE_ROUGH_GLASS,   /* taken as smooth */
    FEATURE_TINTED_GLASS,  /* taken as clear */
    FEATURE_PARTIAL_GLASS, /* a transmission of less than half is taken as none, else as all */
    FEATURE_VERTEX_COLOUR,
    FEATURE_TEXTURE_TRANSFORM,
    FEATURE_TEXTURE_CLAMP, /* all textures repeat */
    FEATURE_SPECULAR_GLOSSINESS,
    FEATURE_LIGHTS,    /* the environment is the only light */
    FEATURE_ANIMATION, /* geometry stands still */
    FEATURE_COUNT
};

struct mesh { /* triangles of one material */
    uint32_t vertex_count, triangle_count;
    float *positions; /* [vertex_count][3], m; one float of padding behind the last, as Embree reads 16 bytes */
    float
        *normals; /* [vertex_count][3], unit, or (0,0,0) where there is none; NULL: flat, the geometric normal shades */
    float *uvs;   /* [vertex_count][2], v up from the picture's bottom as in OBJ; NULL: none */
    uint32_t *indices; /* [triangle_count][3], each < vertex_count, counter-clockwise from outside */
    uint32_t material; /* index into the scene's materials */
};

struct texture { /* base colour, decoded to linear Rec.709, float[height][width][3], top row first */
    uint32_t width, height;
    float *rgb;
};

struct camera {
    char name[64];
    struct vec3 position, look_at, up; /* m */
    float fov_y;                       /* radians, spans the picture's height */
};

struct scene {
    struct mesh *meshes;
    size_t mesh_count;
    struct material *materials;
    size_t material_count;
    struct texture *textures;
    size_t texture_count;
    struct camera *cameras; /* at least one */
    size_t camera_count;
    uint64_t triangle_count; /* of all meshes */
    struct vec3 low, high;   /* bounding box of the triangles, m */
    uint32_t unmodelled;     /* bit 1 << feature for each enum scene_feature that was met */
};

/* A few English words, as "normal maps". */
const char *scene_feature_name(enum scene_feature feature);

/* Reads a .json scene or a .gltf/.glb file. On ERR_OK the caller owns *out; else *out is NULL and *why holds one line
 * that names file, place and fault: ERR_IO a missing file, ERR_FORMAT malformed JSON or model, no camera, an unknown
 * material, ERR_RANGE a value outside its limits, ERR_UNSUPPORTED a format that is not read here. Features that are
 * not modelled are named once each in a warning. progress may be NULL; stepped once per model. */
MUST_CHECK enum err scene_load(const char *path, struct scene **out, struct progress *progress, struct reason *why);

/* The scene that comes with the program, made by code. NULL when out of memory. */
struct scene *scene_create_builtin(void);

void scene_destroy(struct scene *s); /* NULL is allowed */

/* The camera of that name, or the first when name is NULL; NULL when there is none such. */
const struct camera *scene_camera(const struct scene *s, const char *name);

/* Axis-aligned boxes around what scatters by a delta lobe (mirror, glass, sharp ggx), one per mesh. Returns how many
 * there are; writes at most `room` of them. */
struct box {
    struct vec3 low, high; /* m */
};
size_t scene_casters(const struct scene *s, struct box *out, size_t room);

/* Bilinear, wrapped lookup of a texture; u right, v up. */
struct vec3 texture_lookup(const struct texture *t, float u, float v);

#endif
