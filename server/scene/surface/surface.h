/* Where a ray has met a surface: what rays.h fills and scattering needs. Thread: any. */
#pragma once

#include "base/vec.h"

#include <stdbool.h>
#include <stdint.h>

struct hit { /* the first hit of a ray */
    float t;
    uint32_t mesh, triangle;
    float u, v; /* barycentric: p = (1-u-v) p0 + u p1 + v p2 */
};

/* The surface at a hit, computed from the mesh in double precision, so that secondary rays start on it. */
struct surface {
    struct vec3 position;    /* m */
    struct vec3 geometric;   /* unit normal of the triangle, on the side of `towards` */
    struct vec3 shading;     /* unit, interpolated if the mesh has normals; on the same side as geometric */
    bool outside;            /* the ray came from the side where the vertices are counter-clockwise */
    float uv[2], more_uv[2]; /* by the mesh's uvs and more_uvs */
    struct vec3 colour;      /* of the mesh, interpolated; white without colours */
    float offset;            /* m: offset along the geometric normal that keeps a ray from hitting its own triangle */
};
