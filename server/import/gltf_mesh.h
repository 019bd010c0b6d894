/* server/import/gltf_mesh.h */
/* Parts of a mesh of glTF. Private to this room. Thread: one at a time. */
#ifndef IMPORT_GLTF_MESH_H
#define IMPORT_GLTF_MESH_H

#include "import/gltf.h"

struct skin {               /* at rest */
    size_t count;           /* joints; 0: no skin */
    double (*matrices)[16]; /* from the mesh to the world, for each joint */
};

struct primitive {
    const struct gltf_at *at, *mesh, *node;
    const struct skin *skin;
    struct gltf_at attributes, indices;
    struct gltf_accessor positions;
    size_t first, count; /* the vertices that are used */
};

struct places { /* where copies of a mesh stand */
    const double (*matrices)[16];
    size_t count;
};

/* As gltf_accessor_vector, where the primitive's data may be compressed. */
MUST_CHECK enum err primitive_accessor(struct gltf *g, const struct primitive *p, const struct gltf_at *at,
                                       size_t least, size_t most, struct gltf_accessor *out);
/* The same; it must have an element for each vertex. */
MUST_CHECK enum err primitive_attribute(struct gltf *g, const struct primitive *p, const struct gltf_at *at,
                                        size_t least, size_t most, struct gltf_accessor *out);

/* ---- gltf_deform.c: morph targets and skins, as the file leaves them (no animation) ---- */

/* The node's skin; none: count 0. Needs g->worlds. ERR_FORMAT, ERR_NOMEM. */
MUST_CHECK enum err skin_load(struct gltf *g, const struct gltf_at *node, struct skin *out);
void skin_finish(struct skin *s); /* zeroed memory is allowed */
/* Moves the vertices. ERR_FORMAT, ERR_NOMEM. */
MUST_CHECK enum err primitive_deform(struct gltf *g, const struct primitive *p, struct mesh *m);

/* Transform a point by a matrix, a normal by its cofactors; side: the determinant's sign. A normal becomes unit, or
 * (0, 0, 0). */
void gltf_transform_point(const double m[16], float p[3]);
void gltf_transform_normal(const double c[9], double side, float n[3]);
/* Reverses the winding. */
void mesh_turn_over(struct mesh *m);

#endif
