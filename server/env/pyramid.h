/* server/env/pyramid.h */
/* The cube map again and again, each level of half the texels along an edge, down to one per face, and the mean of all:
 * what is looked at with a wide eye [Williams 1983]. Rebuilt for every frame in the same memory.
 *
 * The levels are made of the cube map and not of the source picture, so that every layout has them, seams and poles
 * are no special case, and what is masked has been filled already. [Nori] first resizes its picture to powers of two
 * by Lanczos' filter. That is not needed: a level may have any size if a texel of it takes from each texel below the
 * part that it covers. A side of odd length n is halved to (n + 1) / 2, where a middle texel gives its halves to two;
 * all weights are then solid angles that add up, so that a constant stays constant and no energy is lost, while the
 * Lanczos filter has negative lobes: beside a sun of 10^6 the sky would become negative.
 *
 * Thread: one frame at a time; between frames any number may look. */
#ifndef ENV_PYRAMID_H
#define ENV_PYRAMID_H

#include <stdint.h>

#define PYRAMID_LEVELS 12 /* 1024 texels along an edge need 11 */

struct pyramid_level {
    uint32_t n;          /* texels along a face's edge */
    const float *texels; /* [6][n][n][4], faces as in cube.h; the fourth float is of no use here */
    float *own;          /* the same, writable; NULL at level 0, which is the caller's cube map */
    float *solid_angle;  /* [n][n], sr, the same on each face */
    float *gain;         /* [n][n]: by which bilinear weights are multiplied to keep energy; NULL: not */
};

struct pyramid {
    struct pyramid_level level[PYRAMID_LEVELS];
    uint32_t count;
    float mean[3]; /* over the sphere */
};

/* For cube maps of n x n texels, 1..1024; solid_angle[n][n] are those of a face's. NULL when out of memory. */
struct pyramid *pyramid_create(uint32_t n, const double *solid_angle);
void pyramid_destroy(struct pyramid *p); /* NULL is allowed */

/* All levels of a frame: begun with its texels[6][n][n][4], which must stay as long as anybody looks; then each band of
 * 8 rows, 8 b .. 8 b + 7 of a face, b < (n + 7) / 8, once they hold the frame, while the cache still does (any thread,
 * any order, no band twice at a time); then the end, which uses OpenMP threads. The same bits at any number of them. */
void pyramid_begin(struct pyramid *p, const float *texels);
void pyramid_band(struct pyramid *p, uint32_t face, uint32_t b);
void pyramid_end(struct pyramid *p);

/* A level along w (any length but zero), bilinear, across the edges of the faces too: continuous everywhere. */
void pyramid_look(const struct pyramid *p, uint32_t level, const float w[3], float rgb[3]);

#endif
