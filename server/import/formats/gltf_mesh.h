/* Parts of a mesh of glTF. Private to this room. Thread: one at a time. */
#pragma once

#include "import/formats/gltf.h"

struct skin {
    size_t count;           /* joints; 0: no skin */
    double (*matrices)[16]; /* from the mesh to the world, for each joint */
};

struct gltf_draco;

#define GLTF_DRACO_ARRAYS 16 /* arrays of a primitive that can be compressed: more than are read of one */

struct primitive {
    const struct gltf_at *at, *mesh, *node;
    const struct skin *skin;
    struct gltf_at attributes, indices;
    struct gltf_accessor positions;
    size_t first, count;      /* the vertices that are used */
    struct gltf_draco *draco; /* NULL: not compressed */
};

struct places { /* where copies of a mesh stand */
    double (*matrices)[16];
    size_t count;
};

/* The slot for the scene's mesh that others share, see struct gltf_use; uses below 2: none do. */
struct sharing {
    double uses;
    uint32_t *slot;
};

/* As gltf_accessor_vector, where the primitive's data may be compressed. */
MUST_CHECK enum err primitive_accessor(struct gltf *g, const struct primitive *p, const struct gltf_at *at,
                                       size_t least, size_t most, struct gltf_accessor *out);
/* The same; it must have an element for each vertex. */
MUST_CHECK enum err primitive_attribute(struct gltf *g, const struct primitive *p, const struct gltf_at *at,
                                        size_t least, size_t most, struct gltf_accessor *out);

/* ---- gltf_draco.c: KHR_draco_mesh_compression ---- */

/* Decompresses the primitive's data if they are compressed. ERR_FORMAT, ERR_RANGE, ERR_NOMEM. */
MUST_CHECK enum err primitive_draco_begin(struct gltf *g, struct primitive *p);
void primitive_draco_end(struct primitive *p);
/* The accessor of an attribute, or of the indices, if it is compressed; else *found is false. Valid until the end. */
MUST_CHECK enum err primitive_draco_accessor(struct gltf *g, const struct primitive *p, const struct gltf_at *at,
                                             struct gltf_accessor *out, bool *found);

/* ---- gltf_instances.c: EXT_mesh_gpu_instancing ---- */

/* The world matrices of the copies; `out` has one, the node's own, without instances. Free with places_finish.
 * ERR_FORMAT, ERR_NOMEM. */
MUST_CHECK enum err places_load(struct gltf *g, const struct gltf_at *node, const double world[16], struct places *out);
void places_finish(struct places *p); /* zeroed memory is allowed */

/* What a node's mesh shares with other nodes. ERR_NOMEM. */
MUST_CHECK enum err sharing_find(struct gltf *g, size_t mesh, const struct gltf_at *node, size_t primitive,
                                 struct sharing *out);

/* ---- gltf_place.c ---- */

/* Adds a mesh, in its own space, at each place: as instances where it has many triangles and uses, else as copies.
 * Takes over the arrays of *m, also on error. ERR_NOMEM. */
MUST_CHECK enum err place_all(struct gltf *g, struct mesh *m, const struct places *places, const struct sharing *with);
/* The same for a mesh that the scene has. */
MUST_CHECK enum err place_again(struct gltf *g, uint32_t mesh, const char *name, const struct places *places);

/* ---- gltf_deform.c: morph targets and skins, as the nodes stand ---- */

/* The node's skin, whose matrices the caller frees; none: count 0. Needs g->worlds. ERR_FORMAT, ERR_NOMEM. */
MUST_CHECK enum err skin_load(struct gltf *g, const struct gltf_at *node, struct skin *out);
/* Moves the vertices. ERR_FORMAT, ERR_NOMEM. */
MUST_CHECK enum err primitive_deform(struct gltf *g, const struct primitive *p, struct mesh *m);

/* Transform a point by a matrix, a normal by its cofactors; side: the determinant's sign. A normal becomes unit, or
 * (0, 0, 0). */
void gltf_transform_point(const double m[16], float p[3]);
void gltf_transform_normal(const double c[9], double side, float n[3]);
/* Reverses the winding. */
void mesh_turn_over(struct mesh *m);
