/* How a scene is put together: for the files of this room alone. The scene takes what is added to it. One thread. */
#ifndef SCENE_SCENE_BUILD_H
#define SCENE_SCENE_BUILD_H

#include "err.h"
#include "scene.h"

#define MATERIAL_NONE UINT32_MAX

/* NULL when out of memory. */
struct scene *scene_create(void);

/* Append a copy of *m and so on; the index of the new one goes to *index, which may be NULL. ERR_NOMEM: nothing was
 * added, the caller still owns a mesh's and a texture's arrays. */
MUST_CHECK enum err scene_add_material(struct scene *s, const struct material *m, uint32_t *index);
MUST_CHECK enum err scene_add_mesh(struct scene *s, const struct mesh *m);
MUST_CHECK enum err scene_add_texture(struct scene *s, const struct texture *t, uint32_t *index);
MUST_CHECK enum err scene_add_camera(struct scene *s, const struct camera *c);

/* Index of the material of that name among those added at or after `first`, or MATERIAL_NONE. */
uint32_t scene_find_material(const struct scene *s, const char *name, uint32_t first);

/* Notes that `file` has what is not modelled; warns when it is the first. */
void scene_note_unmodelled(struct scene *s, enum scene_feature feature, const char *file);

/* Adds triangles, counts and bounding box up. ERR_FORMAT: no triangles at all. */
MUST_CHECK enum err scene_finish(struct scene *s, const char *file, struct reason *why);

/* A camera from which the whole bounding box is seen, from above one corner. The box must be known. */
struct camera scene_framing_camera(const struct scene *s);

/* ERR_RANGE with a line that begins with `place` when the camera cannot see. */
MUST_CHECK enum err camera_check(const struct camera *c, const char *place, struct reason *why);

void mesh_finish(struct mesh *m); /* frees the arrays */

/* Sets m->normals from the triangles: at each position the mean of the triangles' normals weighted by their angles
 * there [Thuermer and Wuethrich 1998]; vertices at the same position share it. ERR_NOMEM. */
MUST_CHECK enum err mesh_make_normals(struct mesh *m);

/* Makes vertices that are the same to the bit one, and drops those that no triangle uses. ERR_NOMEM: nothing changed.
 */
MUST_CHECK enum err mesh_join_vertices(struct mesh *m);

/* Drops triangles that are no triangles: a vertex that is not finite or beyond 1e15 m, or no area to speak of.
 * Returns how many. */
uint32_t mesh_drop_degenerate(struct mesh *m);

enum model_normals {
    NORMALS_FLAT,   /* the geometric normal shades */
    NORMALS_FILE,   /* the file's where it has any, else flat */
    NORMALS_SMOOTH, /* the file's where it has any, else made */
};

struct model_desc {
    const char *path;
    const char *place;    /* how messages begin, as "plaza.json: models[0]" */
    uint32_t material;    /* for all of it; MATERIAL_NONE: as the file says */
    bool own_materials;   /* the file describes its materials (glTF); else their names are the scene's */
    bool camera;          /* take the file's cameras */
    double transform[16]; /* column-major, affine */
    enum model_normals normals;
};

/* Reads a model through Assimp and adds its meshes in world space, one per node that holds them. ERR_IO, ERR_FORMAT,
 * ERR_RANGE, ERR_NOMEM. */
MUST_CHECK enum err model_load(struct scene *s, const struct model_desc *d, struct reason *why);

/* Adds every material of a glTF file, in order: material i of the file is *first + i of the scene. */
struct aiScene;
MUST_CHECK enum err gltf_add_materials(struct scene *s, const struct aiScene *ai, const char *path, uint32_t *first,
                                       struct reason *why);

/* True for .gltf and .glb. */
bool path_is_gltf(const char *path);

/* Reads a JSON scene into an empty scene. */
MUST_CHECK enum err scene_load_json(struct scene *s, const char *path, struct progress *progress, struct reason *why);

enum texture_values {
    TEXTURE_SRGB,   /* colours: decoded to linear */
    TEXTURE_LINEAR, /* numbers: v / 255 */
};

/* A PNG or JPEG picture; `name` begins messages. On ERR_OK the caller owns out->rgb. ERR_FORMAT, ERR_RANGE beyond 16384
 * a side or 2^26 texels, ERR_UNSUPPORTED another format, ERR_NOMEM. */
MUST_CHECK enum err texture_decode(const void *bytes, size_t count, enum texture_values values, const char *name,
                                   struct texture *out, struct reason *why);
/* The same from a file; also ERR_IO. */
MUST_CHECK enum err texture_load(const char *path, enum texture_values values, struct texture *out, struct reason *why);

#endif
