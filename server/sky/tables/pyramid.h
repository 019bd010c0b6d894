/* A mip pyramid of the cube map [Williams 1983]: levels of half the resolution down to one texel per face, and the
 * mean, for lookups by wide pixels. Rebuilt for every frame in the same memory.
 *
 * The levels are computed from the cube map, not from the source image, so that they exist for every layout, without
 * seams, poles or masked texels. [Nori] first resizes its image to powers of two with a Lanczos filter. That is not
 * needed: a level may have any size if each of its texels takes from each finer texel the part that it covers. An odd
 * side n becomes (n + 1) / 2, and a middle texel contributes half to each of two. All weights are solid angles that add
 * up, so that a constant stays constant and energy is conserved; the Lanczos filter has negative lobes, which would
 * make the sky beside a sun of 10^6 negative.
 *
 * Thread: one frame at a time; between frames any number may look up. */
#pragma once

#include <stdint.h>

#define PYRAMID_LEVELS 12 /* 1024 texels along an edge need 11 */

struct pyramid_level {
    uint32_t n;          /* texels per edge of a face */
    const float *texels; /* [6][n][n][4], faces as in cube.h; the fourth float is unused */
    float *own;          /* the same, writable; NULL at level 0, which is the caller's cube map */
    float *solid_angle;  /* [n][n], sr, the same on each face */
    float *gain;         /* [n][n]: factors of bilinear weights that conserve energy; NULL: none */
};

struct pyramid {
    struct pyramid_level level[PYRAMID_LEVELS];
    uint32_t count;
    float mean[3]; /* over the sphere */
};

/* For cube maps of n x n texels, 1..1024; solid_angle[n][n]: sr, of a face's texels. NULL: out of memory. */
struct pyramid *pyramid_create(uint32_t n, const double *solid_angle);
/* Another pyramid of the same size, without a frame. NULL: out of memory. Thread: any. */
struct pyramid *pyramid_create_like(const struct pyramid *of);
void pyramid_destroy(struct pyramid *p); /* NULL is allowed */

/* Build all levels of a frame. Begin with its texels[6][n][n][4], which must stay valid for lookups. Then call
 * pyramid_band for each band of 8 rows, 8 b .. 8 b + 7 of a face, b < (n + 7) / 8, once they are filled and while they
 * are in the cache; thread: any, in any order, but not one band twice at once. Then end, which uses OpenMP. The result
 * does not depend on the number of threads. */
void pyramid_begin(struct pyramid *p, const float *texels);
/* Second step, per band. */
void pyramid_band(struct pyramid *p, uint32_t face, uint32_t b);
/* Last step. */
void pyramid_end(struct pyramid *p);

/* Bilinear lookup in a level at (u, v) on a face (cube.h), continuous everywhere, including across face edges. level:
 * p->count, too, for the mean over the sphere. */
void pyramid_lookup_at(const struct pyramid *p, uint32_t level, uint32_t face, float u, float v, float rgb[3]);
