/* Construction of scenes. Private to this room, import and reader. The scene owns everything added to it. Thread: one
 * at a time.
 */
#pragma once

#include "base/err.h"
#include "scene/geometry/scene.h"

#define MATERIAL_NONE UINT32_MAX

#define MESH_COORDINATE_MAX 1e15f          /* m; Embree drops triangles beyond it, and its square still fits a double */
#define TEXTURE_SIDE_KEPT 256              /* texels; smaller textures are never reduced */
#define MESH_ELEMENTS_MAX (UINT32_MAX / 3) /* vertices or triangles of a mesh */

/* Creates an empty scene. NULL: out of memory. */
struct scene *scene_create(void);

/* Append a copy of *m etc. and set *index, which may be NULL. ERR_NOMEM: nothing was added; the caller still owns the
 * arrays of a mesh or a texture. */
MUST_CHECK enum err scene_add_material(struct scene *s, const struct material *m, uint32_t *index);
/* See scene_add_material. */
MUST_CHECK enum err scene_add_mesh(struct scene *s, const struct mesh *m);
/* Adds an instance: mesh `of`, which must be placed, again with another placement `matrix`. It shares the arrays.
 * ERR_NOMEM. ERR_RANGE: the matrix is unusable, see mesh_place. */
MUST_CHECK enum err scene_add_instance(struct scene *s, uint32_t of, const char *name, const float matrix[3][4]);
/* See scene_add_material. If all textures then take more than s->texture_bytes, the largest lose their finest levels
 * until the limit holds, down to TEXTURE_SIDE_KEPT texels per side. */
MUST_CHECK enum err scene_add_texture(struct scene *s, const struct texture *t, uint32_t *index);
/* See scene_add_material. */
MUST_CHECK enum err scene_add_camera(struct scene *s, const struct camera *c);

/* See scene_add_material. */
MUST_CHECK enum err scene_add_light(struct scene *s, const struct punctual_light *l);

/* Sets a spot's half angles, radians. */
void light_set_cone(struct punctual_light *l, double inner, double outer);

/* Checks a light. ERR_RANGE: invalid; the message begins with `place`. */
MUST_CHECK enum err light_check(const struct punctual_light *l, const char *place, struct reason *why);

/* Index of a material by name, among those added at or after `first`, or MATERIAL_NONE. */
uint32_t scene_find_material(const struct scene *s, const char *name, uint32_t first);

/* Records an unsupported feature of `file`; warns the first time. */
void scene_note_unmodelled(struct scene *s, enum scene_feature feature, const char *file);

/* Removes the meshes from `first` on that are outlines: of an opaque, single-sided material, turned inside out around
 * others that fill half of their volume and reach within a tenth of their diagonal, without a camera inside. A list
 * with instances stays as it is. single_sided and dropped, to which their triangles are added: of each material.
 * ERR_NOMEM. */
MUST_CHECK enum err scene_drop_outlines(struct scene *s, size_t first, const bool *single_sided, uint64_t *dropped);

/* Computes triangle count and bounding box. ERR_FORMAT: no triangles. */
MUST_CHECK enum err scene_finish(struct scene *s, const char *file, struct reason *why);

/* A camera that sees the whole bounding box from above one corner. The box must be known. */
struct camera scene_framing_camera(const struct scene *s);

/* Checks a camera. ERR_RANGE: invalid; the message begins with `place`. */
MUST_CHECK enum err camera_check(const struct camera *c, const char *place, struct reason *why);

void mesh_finish(struct mesh *m); /* frees the arrays if the mesh owns them */

/* Places a mesh whose arrays are in object space. ERR_RANGE, with no change: the matrix is singular, or stretches one
 * direction 1000 times as much as another, or scales beyond 1e-6 to 1e6, or moves the mesh beyond
 * MESH_COORDINATE_MAX. */
MUST_CHECK enum err mesh_place(struct mesh *m, const float matrix[3][4]);

/* Computes m->normals: at each position the mean of the adjacent triangles' normals, weighted by angle [Thuermer and
 * Wuethrich 1998]. ERR_NOMEM. */
MUST_CHECK enum err mesh_make_normals(struct mesh *m);

/* Computes m->tangents from texture coordinates and normals, similar to MikkTSpace: at each vertex the mean of the
 * directions of increasing u on its triangles, each projected to the vertex's tangent plane and weighted by its angle.
 * A vertex whose triangles have both orientations in texture space is split in two. Unlike in MikkTSpace, triangles
 * need not share an edge to be averaged. second: use more_uvs. Does nothing without texture coordinates. ERR_NOMEM is
 * the only error. */
MUST_CHECK enum err mesh_make_tangents(struct mesh *m, bool second);

/* Merges identical vertices and drops unused ones. ERR_NOMEM: nothing changed. */
MUST_CHECK enum err mesh_join_vertices(struct mesh *m);

/* Drops degenerate triangles: those with a vertex that is not finite or beyond 1e15 m, or with practically no area.
 * Returns their number. */
uint32_t mesh_drop_degenerate(struct mesh *m);
