/* Vectors between positions, in double: for normals and tangents of meshes. Private to this room. Thread: any. */
#pragma once

struct vec3d {
    double x, y, z;
};

/* Both float[3]. */
static inline struct vec3d vec3d_between(const float *from, const float *to)
{
    return (struct vec3d){ (double)to[0] - from[0], (double)to[1] - from[1], (double)to[2] - from[2] };
}

static inline double vec3d_dot(struct vec3d a, struct vec3d b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
