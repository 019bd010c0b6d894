/* server/shade/caustic_store.h */
/* A store of light paths that begin at the casters, lit anew by each sky: caustics, and their interreflection, that
 * follow the sky without a ray being traced.
 *
 * With camera, geometry and materials fixed, what a particle brings to a pixel is linear in the radiance of the
 * direction it came from. So a splat is kept as that direction w, its pixel, and the throughput
 * T = f(o, w_i) ... / (p_w p_y) by which it would multiply a radiance of 1, and a frame is
 *     Lo(pixel) = 1/N  sum over the pixel's splats of  L(w) T.
 * Directions are drawn evenly over the sphere, p_w = 1 / (4 pi), lines as start.h has them: no sky is ever looked at
 * when paths are drawn. So the store is independent of whatever sky it lights, and each picture is unbiased: its mean
 * over stores (seeds) is what light_tracer.h converges to. Only splats are kept; of the paths that nobody sees, their
 * number alone.
 *
 * A small bright sun is hit by few of them: what is brighter than transport_sky.h's level is left to particles of its
 * own (light_tracer_desc.bright), and the store takes transport_lower's share of L. The two add up to L.
 *
 * The paths are those of an endless low-discrepancy sequence that is cut into parts of equal size; the store holds
 * `parts` of them that follow each other. At turn t these are number t .. t + parts - 1: going on by one replaces the
 * oldest part by a new one and leaves all others as they are. The pictures of two turns share the paths that are in
 * both, so that noise changes slowly where it changes; over many turns it averages out. What the store holds depends on
 * seed and turn alone, not on the turns before.
 *
 * One struct caustic_store per thread of control; functions run on all OpenMP threads and do not depend on their
 * number. */
#ifndef SHADE_CAUSTIC_STORE_H
#define SHADE_CAUSTIC_STORE_H

#include "environment.h"
#include "err.h"
#include "rays.h"
#include "scene.h"
#include "start.h"
#include "view.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#define CAUSTIC_PARTS 512 /* what 0 stands for in parts */
#define CAUSTIC_PARTS_MAX 4096

struct caustic_store;
struct progress;

struct caustic_store_desc {
    uint32_t classes; /* PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC, or one of them */
    uint64_t paths;   /* N, at least 1; what comes of it is a multiple of parts and of starts a direction */
    uint32_t parts;   /* 1..CAUSTIC_PARTS_MAX; 0: the default */
    enum start_kind start;
    uint64_t seed;
    uint64_t max_bytes; /* of all that stays, about; 0: 256 MiB. Fewer paths are kept where it does not suffice. */
};

struct caustic_store_stats {
    uint64_t paths, wished; /* that the store is made of, and would be if memory sufficed */
    uint64_t splats;        /* that are kept */
    uint64_t bytes;         /* that it holds */
    uint64_t rays;          /* traced at the last turn */
    uint32_t parts;
    uint32_t renewed; /* parts that were drawn at the last turn */
};

/* Scene and rays must outlive it; the view is copied. Nothing is in it before its first turn. Some paths are traced
 * for how many splats there will be, and forgotten. ERR_RANGE: max_bytes suffices for no paths at all; *why says what
 * would. ERR_NOMEM. On an error *out is NULL. */
MUST_CHECK enum err caustic_store_create(const struct scene *scene, const struct rays *rays, const struct view *view,
                                         const struct caustic_store_desc *desc, struct caustic_store **out,
                                         struct reason *why);
void caustic_store_destroy(struct caustic_store *s); /* NULL is allowed */

/* Draws the parts of this turn that it does not hold. progress (may be NULL) is stepped once for each. Cancelled:
 * ERR_OK, and what is missing is drawn another time. ERR_NOMEM: likewise. */
MUST_CHECK enum err caustic_store_turn(struct caustic_store *s, uint64_t turn, struct progress *progress,
                                       const atomic_bool *cancel);

/* Whether all parts of one turn are there, which a turn that was cancelled leaves open. */
bool caustic_store_is_whole(const struct caustic_store *s);

/* rgb: float[height][width][3], radiance; adds what transport_lower's share of e's radiance brings. level: that of
 * transport_sky.h, 0 (nothing) to INFINITY (all). The store must be whole. ERR_NOMEM: nothing was added. */
MUST_CHECK enum err caustic_store_light(struct caustic_store *s, const struct environment *e, float level, float *rgb);

const struct caustic_store_stats *caustic_store_stats(const struct caustic_store *s);

#endif
