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

struct mesh { /* triangles of one material */
    uint32_t vertex_count, triangle_count;
    float *positions;   /* [vertex_count][3], m; one float of padding behind the last, as Embree reads 16 bytes */
    float *normals;     /* [vertex_count][3], unit; NULL: flat, the geometric normal shades */
    float *uvs;         /* [vertex_count][2], v up from the picture's bottom as in OBJ; NULL: none */
    uint32_t *indices;  /* [triangle_count][3], each < vertex_count */
    uint32_t material;  /* index into the scene's materials */
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
    struct vec3 low, high;   /* bounding box, m */
};

/* Reads a .json scene or a .gltf/.glb file. On ERR_OK the caller owns *out; else *out is NULL and *why holds one line
 * that names file, place and fault: ERR_IO a missing file, ERR_FORMAT malformed JSON or model, no camera, an unknown
 * material, ERR_RANGE a value outside its limits, ERR_UNSUPPORTED a format that is not read here. Features that are
 * not modelled are named once each in a warning. progress may be NULL. */
MUST_CHECK enum err scene_load(const char *path, struct scene **out, struct reason *why);

/* The scene that comes with the program, made by code. NULL when out of memory. */
struct scene *scene_create_builtin(void);

void scene_destroy(struct scene *s); /* NULL is allowed */

/* The camera of that name, or the first when name is NULL; NULL when there is none such. */
const struct camera *scene_camera(const struct scene *s, const char *name);

/* Bilinear, wrapped lookup of a texture; u right, v up. */
struct vec3 texture_lookup(const struct texture *t, float u, float v);

#endif
