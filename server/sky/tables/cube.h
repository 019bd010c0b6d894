/* Cube maps: six faces of n x n texels. Face 2a + s lies on coordinate axis a (0 = x, 1 = y, 2 = z), on its positive
 * side for s = 0 and its negative side for s = 1. On a face, u runs along axis (a + 1) mod 3 and v along axis (a + 2)
 * mod 3, both in -1..1; column j starts at u = -1 + 2 j / n, row i at v = -1 + 2 i / n. Thread: any. */
#pragma once

#include <math.h>
#include <stdint.h>

#define CUBE_FACES 6

/* The direction through (u, v) of a face, not normalised: its largest component is 1. */
static inline void cube_direction(uint32_t face, double u, double v, double out[3])
{
    const uint32_t a = face >> 1;
    out[a] = face & 1 ? -1.0 : 1.0;
    out[(a + 1) % 3] = u;
    out[(a + 2) % 3] = v;
}

/* Face and (u, v) of a nonzero direction. */
static inline uint32_t cube_locate(const float w[3], float *u, float *v)
{
    const float x = fabsf(w[0]), y = fabsf(w[1]), z = fabsf(w[2]);
    const uint32_t a = x >= y && x >= z ? 0 : y >= z ? 1 : 2;
    const float scale = 1.0f / fabsf(w[a]);
    *u = w[(a + 1) % 3] * scale;
    *v = w[(a + 2) % 3] * scale;
    return 2 * a + (w[a] < 0.0f);
}

/* Index [face][row][column] of the texel that contains a nonzero direction, and its (u, v). All code uses this
 * function, so that sampling and evaluation agree. */
static inline uint32_t cube_texel(uint32_t n, const float w[3], float *u, float *v)
{
    const uint32_t face = cube_locate(w, u, v);
    const float half = 0.5f * (float)n;
    const uint32_t j = (uint32_t)((*u + 1.0f) * half), i = (uint32_t)((*v + 1.0f) * half);

    return (face * n + (i < n ? i : n - 1)) * n + (j < n ? j : n - 1);
}

/* Of a face divided into edge x edge cells, row *i and column *j may be one step beyond one border, but not beyond two:
 * returns the face that the cell is on and sets its row and column there. */
uint32_t cube_step_over(uint32_t face, int edge, int *i, int *j);

/* Solid angle of (u0, v0)..(u1, v1) on a face, sr: differences of the corner integral atan(uv / sqrt(u^2 + v^2 + 1)).
 */
double cube_solid_angle(double u0, double v0, double u1, double v1);

/* Of what two squares of a face share: (row i, column j) of n x n and (row y, column x) of m x m. They must overlap. */
double cube_shared_solid_angle(uint32_t n, uint32_t i, uint32_t j, uint32_t m, uint32_t y, uint32_t x);

/* Those of all texels of a face, out[n][n]. */
void cube_solid_angles(uint32_t n, double *out);

/* Area on the face plane per solid angle at (u, v): (1 + u^2 + v^2)^(3/2), sr^-1. */
static inline float cube_jacobian(float u, float v)
{
    const float r2 = 1.0f + u * u + v * v;
    return r2 * sqrtf(r2);
}

/* The four corners of a face as unit vectors, for [LPG13, Eq. 3]. */
void cube_corners(uint32_t face, float out[4][3]);
