/* Reads a mesh's vertices in world space, whether the mesh is an instance or not. Thread: any. */
#pragma once

#include "scene/geometry/scene.h"

/* 1, or -1 if (p1 - p0) x (p2 - p0) points inwards. */
static inline double mesh_side(const struct mesh *m)
{
    return m->placed ? (double)m->place.side : 1.0;
}

/* Transforms a point from the arrays' space to world space. */
static inline void placement_point(const struct placement *p, const float v[3], double out[3])
{
    for (int i = 0; i < 3; i++) {
        const float *row = p->matrix[i];
        out[i] = (double)row[0] * v[0] + (double)row[1] * v[1] + (double)row[2] * v[2] + row[3];
    }
}

/* m; exact, or rounded to double. */
static inline void mesh_position(const struct mesh *m, uint32_t vertex, double out[3])
{
    const float *v = m->positions + 3 * (size_t)vertex;

    if (m->placed) {
        placement_point(&m->place, v, out);
        return;
    }
    for (int i = 0; i < 3; i++)
        out[i] = v[i];
}

/* The corners of a triangle. */
static inline void mesh_corners(const struct mesh *m, uint32_t triangle, double out[3][3])
{
    const uint32_t *t = m->indices + 3 * (size_t)triangle;

    for (int k = 0; k < 3 && m->placed; k++)
        placement_point(&m->place, m->positions + 3 * (size_t)t[k], out[k]);
    for (int k = 0; k < 3 && !m->placed; k++)
        for (size_t i = 0; i < 3; i++)
            out[k][i] = m->positions[3 * (size_t)t[k] + i];
}

/* The same as floats. */
static inline void mesh_corners_rounded(const struct mesh *m, uint32_t triangle, struct vec3 out[3])
{
    const uint32_t *t = m->indices + 3 * (size_t)triangle;
    double p[3];

    for (int k = 0; k < 3; k++) {
        const float *v = m->positions + 3 * (size_t)t[k];
        if (!m->placed) {
            out[k] = vec3_make(v[0], v[1], v[2]);
            continue;
        }
        placement_point(&m->place, v, p);
        out[k] = vec3_make((float)p[0], (float)p[1], (float)p[2]);
    }
}

/* Transforms a normal from the arrays' space to world space. */
struct vec3 placement_normal(const struct placement *p, const float n[3]);

/* As in struct mesh, whose normals must not be NULL. */
static inline struct vec3 mesh_normal(const struct mesh *m, uint32_t vertex)
{
    const float *n = m->normals + 3 * (size_t)vertex;
    return m->placed ? placement_normal(&m->place, n) : vec3_make(n[0], n[1], n[2]);
}

/* As in struct mesh, whose tangents must not be NULL. */
void mesh_tangent(const struct mesh *m, uint32_t vertex, float out[4]);

/* Volume in world space over volume in the arrays' space. */
double mesh_volume_scale(const struct mesh *m);

/* Enlarges a box to contain the mesh's triangles. */
void mesh_grow_box(const struct mesh *m, struct box *b);
