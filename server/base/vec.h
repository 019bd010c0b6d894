/* Three-component float vectors: a point (m), a direction, or linear Rec.709. Thread: any. */
#pragma once

#include <math.h>

#define PI 3.14159265358979323846

struct vec3 {
    float x, y, z;
};

static inline struct vec3 vec3_make(float x, float y, float z)
{
    return (struct vec3){ x, y, z };
}

static inline struct vec3 vec3_add(struct vec3 a, struct vec3 b)
{
    return vec3_make(a.x + b.x, a.y + b.y, a.z + b.z);
}

static inline struct vec3 vec3_sub(struct vec3 a, struct vec3 b)
{
    return vec3_make(a.x - b.x, a.y - b.y, a.z - b.z);
}

static inline struct vec3 vec3_scale(struct vec3 a, float s)
{
    return vec3_make(a.x * s, a.y * s, a.z * s);
}

static inline struct vec3 vec3_mul(struct vec3 a, struct vec3 b)
{
    return vec3_make(a.x * b.x, a.y * b.y, a.z * b.z);
}

static inline float vec3_dot(struct vec3 a, struct vec3 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

/* The same with products and sums in double. */
static inline double vec3_dot_double(struct vec3 a, struct vec3 b)
{
    return (double)a.x * b.x + (double)a.y * b.y + (double)a.z * b.z;
}

static inline double dot3(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline struct vec3 vec3_cross(struct vec3 a, struct vec3 b)
{
    return vec3_make(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

static inline float vec3_length(struct vec3 a)
{
    return sqrtf(vec3_dot(a, a));
}

/* The zero vector stays zero. */
static inline struct vec3 vec3_normalize(struct vec3 a)
{
    const float l = vec3_length(a);
    return l > 0.0f ? vec3_scale(a, 1.0f / l) : a;
}

/* The share (1 - cosine)^5 by which reflectance grows to 1 at grazing angles [Schlick 1994]; cosine is clamped to
 * 0..1. */
static inline double schlick(double cosine)
{
    const double c = fmin(1.0, fmax(0.0, 1.0 - cosine));
    return c * c * c * c * c;
}

/* Luminance of linear Rec.709 [ITU-R BT.709-6]. */
static inline float rgb_luminance(float r, float g, float b)
{
    return 0.2126f * r + 0.7152f * g + 0.0722f * b;
}

/* ---- In double ---- */

/* Vectors between positions, in double: for normals and tangents of meshes. Private to this room. Thread: any. */

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
