/* Interreflection by a cache of light transport: with camera, geometry and materials fixed, the light that reaches a
 * shade point by way of other surfaces is linear in the sky. The class is PATH_INDIRECT_LIT of paths.h, E D (S* D)+ L,
 * sun and all; nothing is traced as a frame is made.
 *
 * Records lie on the surfaces, a voxel and a range of normals each, and keep what of the sky falls on them, by cells
 * and by traced rays at eight places, and what falls on them by way of other records. Shade points gather from the
 * records. All of it lives in one basis of the cells, the eigenvectors of what some thousand points gather: records
 * and points keep coefficients, 3 x (K <= 128), those of points compressed: 16 neighbouring blocks of 64 have the rows
 * in common that theirs are made of.
 *
 * Cells overlap here: each is a tent over its neighbours' centres, so that a sun that moves goes from one to the other
 * gradually. Biased: a cell's mean, the basis, records that are even over their voxel, noise of the gather, smoothed
 * over a group of blocks, that stands still. docs/transport-cache.md has figures.
 *
 * One struct bounce per thread of control; the functions run on all OpenMP threads and do not depend on their number.
 */
#ifndef SHADE_BOUNCE_H
#define SHADE_BOUNCE_H

#include "environment.h"
#include "err.h"
#include "gbuffer.h"
#include "kernels.h"
#include "rays.h"
#include "scene.h"
#include "transport.h"
#include "vec.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

struct bounce;
struct progress;

struct bounce_desc {
    const struct scene *scene;
    const struct rays *rays;
    const struct gbuffer *gbuffer;
    const struct transport *direct; /* its blocks are taken, but for those with too narrow lobes; read while
                                     * building */
    struct vec3 eye;                /* the camera's place: records are larger where it is far */
    uint32_t gather;                /* rays of a shade point's matte part; 0: 64. Glossy points have as many besides */
    uint32_t records;               /* at most; 0: half as many as there are points, 4000 to 24000 */
    float tolerance;    /* of compression: what a rank must bring of a point's light under a sky of one cell; 0:
                         * 0.027 */
    bool no_smoothing;  /* noise of the gather stays */
    uint64_t max_bytes; /* of all that stays; 0: 1 GiB. While it is made, some 100 MB come to it. */
    uint64_t seed;
    struct progress *progress; /* may be NULL; stepped by bounce_steps in all */
    const atomic_bool *cancel; /* once true, building ends; may be NULL */
};

struct bounce_stats {
    uint64_t bytes; /* that it holds */
    uint64_t rays;  /* traced for it */
    uint32_t records;
    uint32_t basis;    /* K */
    double basis_rest; /* of what the basis was made from, the share that it leaves out, by Frobenius norms */
    uint32_t bounces;  /* iterated */
    uint32_t pieces;   /* rows of all blocks */
    double rank;       /* their mean rank */
    double shared;     /* mean rank of what they share it in */
};

uint64_t bounce_steps(const struct gbuffer *g);

/* gbuffer and kernels must outlive it. ERR_RANGE: max_bytes does not suffice. ERR_NOMEM. On an error, or when cancelled
 * (which is none), *out is NULL. */
MUST_CHECK enum err bounce_create(const struct bounce_desc *desc, const struct kernels *kernels, struct bounce **out,
                                  struct reason *why);
void bounce_destroy(struct bounce *b); /* NULL is allowed */

/* For the transport_frame of the transport that it was made with, which takes the sky for it; lives as long as b. */
const struct transport_guest *bounce_guest(const struct bounce *b);

/* The same by itself: takes the sky, and adds to lo: float[packet_count][3][16], at the packets that are taken. */
void bounce_shade(struct bounce *b, const struct environment *e, const atomic_bool *cancel, float *lo);

const struct bounce_stats *bounce_stats(const struct bounce *b);

/* Packets that it has not, in ascending order: their lobes are so narrow that they would mirror the records. */
const struct packet_list *bounce_left(const struct bounce *b);

#endif
