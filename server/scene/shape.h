/* Solids made by code, for the built-in scene: for the files of this room alone. Each call appends to a mesh that
 * carries normals; the local frame of the solid is turned about Y and then moved. Metres, Y up, radians counted from +Z
 * towards +X. A failed allocation is remembered, and shape_finish reports it. */
#ifndef SCENE_SHAPE_H
#define SCENE_SHAPE_H

#include "scene_build.h"

struct shape {
    struct mesh mesh;
    uint32_t vertex_room, triangle_room;
    struct vec3 origin; /* of the local frame */
    float turn;         /* about Y, from +Z towards +X */
    bool failed;
};

/* The local frame of what comes next. */
void shape_place(struct shape *s, float x, float y, float z, float turn);

/* A box between two corners. */
void shape_box(struct shape *s, struct vec3 low, struct vec3 high);

/* A block of a ring: between two radii, two angles and two heights; `parts` straight pieces along the arc. A radius of
 * 0 gives a slice of a disc, an arc of 2 pi a closed ring. Its curved sides are shaded smoothly. */
struct sector {
    float inner, outer, from, to, low, high;
    uint32_t parts;
};
void shape_sector(struct shape *s, const struct sector *k);

/* A surface over (u, v) in the unit square: at(u, v, data) is its point; u x v counter-clockwise from outside. Normals
 * from differences; wrap_u: the surface closes where u = 1 meets 0. */
struct surface_map {
    struct vec3 (*at)(float u, float v, const void *data);
    const void *data;
    bool wrap_u;
};
void shape_grid(struct shape *s, uint32_t columns, uint32_t rows, const struct surface_map *map);

/* A convex outline of n <= 8 corners in the plane x = 0, (z, y) each, given a thickness along x. */
void shape_plate(struct shape *s, const float (*outline)[2], uint32_t n, float thickness);

/* Hands the mesh over to the scene and empties s; ERR_NOMEM when anything failed on the way. */
MUST_CHECK enum err shape_finish(struct shape *s, struct scene *scene, uint32_t material);

#endif
