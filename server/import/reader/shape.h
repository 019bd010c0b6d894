/* Procedural solids for the built-in scene. Private to this room. Each call appends to a mesh with normals, in a local
 * frame that is rotated about Y and then translated. Metres, Y up, radians from +Z towards +X. Allocation failures are
 * recorded and reported by shape_finish. Thread: one per shape. */
#pragma once

#include "scene/geometry/scene_build.h"

struct shape {
    struct mesh mesh;
    uint32_t vertex_room, triangle_room;
    struct vec3 origin; /* of the local frame */
    float turn;         /* about Y, from +Z towards +X */
    bool failed;
};

/* Sets the local frame of the following solids. */
void shape_place(struct shape *s, float x, float y, float z, float turn);

/* Appends a box between two corners. */
void shape_box(struct shape *s, struct vec3 low, struct vec3 high);

struct sector {
    float inner, outer, from, to, low, high;
    uint32_t parts;
};

/* Appends a block of a ring between two radii, two angles and two heights, with `parts` straight segments along the
 * arc. A radius of 0 gives a slice of a disc, an arc of 2 pi a closed ring. Curved sides are shaded smoothly. */
void shape_sector(struct shape *s, const struct sector *k);

struct surface_map {
    struct vec3 (*at)(float u, float v, const void *data);
    const void *data;
    bool wrap_u;
};

/* Appends a surface over (u, v) in the unit square: at(u, v, data) is its point; u x v is counter-clockwise seen from
 * outside. Normals by finite differences. wrap_u: the surface closes where u = 1 meets 0. */
void shape_grid(struct shape *s, uint32_t columns, uint32_t rows, const struct surface_map *map);

/* Appends a convex plate with an outline of n <= 8 corners (z, y) in the plane x = 0 and a thickness along x. */
void shape_plate(struct shape *s, const float (*outline)[2], uint32_t n, float thickness);

/* Moves the mesh into the scene and empties s. ERR_NOMEM: an allocation failed, now or earlier. */
MUST_CHECK enum err shape_finish(struct shape *s, struct scene *scene, uint32_t material);
