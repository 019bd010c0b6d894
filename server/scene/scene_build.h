/* server/scene/scene_build.h */
/* Construction of scenes. Private to this room. The scene owns what is added to it. Thread: one at a time. */
#ifndef SCENE_SCENE_BUILD_H
#define SCENE_SCENE_BUILD_H

#include "base/err.h"
#include "scene/scene.h"

#define MATERIAL_NONE UINT32_MAX

/* Creates an empty scene. NULL: out of memory. */
struct scene *scene_create(void);

/* Append a copy of *m etc. and set *index, which may be NULL. ERR_NOMEM: nothing was added; the caller still owns the
 * arrays of a mesh or a texture. */
MUST_CHECK enum err scene_add_material(struct scene *s, const struct material *m, uint32_t *index);
/* See scene_add_material. */
MUST_CHECK enum err scene_add_mesh(struct scene *s, const struct mesh *m);
/* See scene_add_material. */
MUST_CHECK enum err scene_add_texture(struct scene *s, const struct texture *t, uint32_t *index);
/* See scene_add_material. */
MUST_CHECK enum err scene_add_camera(struct scene *s, const struct camera *c);

/* Index of a material by name, among those added at or after `first`, or MATERIAL_NONE. */
uint32_t scene_find_material(const struct scene *s, const char *name, uint32_t first);

/* Records an unsupported feature of `file`; warns the first time. */
void scene_note_unmodelled(struct scene *s, enum scene_feature feature, const char *file);

/* Computes triangle count and bounding box. ERR_FORMAT: no triangles. */
MUST_CHECK enum err scene_finish(struct scene *s, const char *file, struct reason *why);

/* A camera that sees the whole bounding box from above one corner. The box must be known. */
struct camera scene_framing_camera(const struct scene *s);

/* Checks a camera. ERR_RANGE: invalid; the message begins with `place`. */
MUST_CHECK enum err camera_check(const struct camera *c, const char *place, struct reason *why);

void mesh_finish(struct mesh *m); /* frees the arrays */

/* Computes m->normals: at each position the mean of the adjacent triangles' normals, weighted by angle [Thuermer and
 * Wuethrich 1998]. ERR_NOMEM. */
MUST_CHECK enum err mesh_make_normals(struct mesh *m);

/* Merges identical vertices and drops unused ones. ERR_NOMEM: nothing changed. */
MUST_CHECK enum err mesh_join_vertices(struct mesh *m);

/* Drops degenerate triangles: those with a vertex that is not finite or beyond 1e15 m, or with practically no area.
 * Returns their number. */
uint32_t mesh_drop_degenerate(struct mesh *m);

enum model_normals {
    NORMALS_FLAT,   /* geometric normals */
    NORMALS_FILE,   /* the file's, else flat */
    NORMALS_SMOOTH, /* the file's, else computed */
};

struct model_desc {
    const char *path;
    const char *place;    /* beginning of messages, such as "plaza.json: models[0]" */
    uint32_t material;    /* for the whole model; MATERIAL_NONE: the file's */
    bool own_materials;   /* the file defines its materials (glTF); else their names refer to the scene's */
    bool camera;          /* import the file's cameras */
    double transform[16]; /* column-major, affine */
    enum model_normals normals;
};

/* Reads a model through Assimp and adds its meshes in world space, one per node. ERR_IO, ERR_FORMAT, ERR_RANGE,
 * ERR_UNSUPPORTED, ERR_NOMEM. */
MUST_CHECK enum err model_load(struct scene *s, const struct model_desc *d, struct reason *why);

struct aiScene;

/* Adds every material of a glTF file in order: material i of the file becomes *first + i in the scene. ERR_FORMAT,
 * ERR_NOMEM. */
MUST_CHECK enum err gltf_add_materials(struct scene *s, const struct aiScene *ai, const char *path, uint32_t *first,
                                       struct reason *why);

/* Whether the extension is .gltf or .glb. */
bool path_is_gltf(const char *path);

/* Reads a JSON scene into an empty scene. Errors of scene_load. */
MUST_CHECK enum err scene_load_json(struct scene *s, const char *path, struct progress *progress, struct reason *why);

enum texture_values {
    TEXTURE_SRGB,   /* colours, decoded to linear */
    TEXTURE_LINEAR, /* numbers: v / 255 */
};

/* Decodes a PNG or JPEG image; `name` begins messages. On ERR_OK the caller owns out->rgb. ERR_FORMAT. ERR_RANGE: more
 * than 16384 per side or 2^26 texels. ERR_UNSUPPORTED: another format. ERR_NOMEM. */
MUST_CHECK enum err texture_decode(const void *bytes, size_t count, enum texture_values values, const char *name,
                                   struct texture *out, struct reason *why);
/* The same from a file. Also ERR_IO. */
MUST_CHECK enum err texture_load(const char *path, enum texture_values values, struct texture *out, struct reason *why);

#endif
