/* server/shade/direct.h */
/* Direct light at the shade points of a G-buffer: the paths E S* D L. Per point p with normal n, seen from o,
 *     Lo = integral of f(o, w) max(0, n.w) V(p, w) L(w) dw,
 * estimated by balanced multiple importance sampling over the strata of the sky and the lobes of the material
 * [LPG13, Eq. 4 and 6]. Visibility V is traced, which the paper leaves out. A direction counts only where its cosines
 * with the geometric and the shading normal are both positive. One struct direct per thread of control; direct_shade
 * itself runs on all OpenMP threads, and its result does not depend on their number. */
#ifndef SHADE_DIRECT_H
#define SHADE_DIRECT_H

#include "environment.h"
#include "err.h"
#include "gbuffer.h"
#include "method.h"
#include "rays.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

struct direct;
struct kernels;

struct direct_desc {
    enum method method;
    uint32_t samples;          /* N_s per shade point, 1..2^20 */
    uint64_t seed, pass;       /* together they decide every random number */
    bool no_visibility;        /* V = 1, as the paper */
    const atomic_bool *cancel; /* once true, what is left is not shaded; may be NULL */
};

struct direct_stats {
    uint64_t rays;      /* shadow rays traced */
    uint64_t generated; /* light samples drawn from the sky's tables, for all points together */
    uint64_t chosen;    /* light samples in use, summed over the points: sum of ceil(N_f) */
    uint64_t effective; /* of these, with positive cosines and light: the green dots of [LPG13, Fig. 1] */
    uint64_t lobes;     /* samples of the material's lobes, summed over the points */
};

/* kernels: from kernels_select; must outlive the object. NULL when out of memory. */
struct direct *direct_create(const struct kernels *kernels);
void direct_destroy(struct direct *d); /* NULL is allowed */

/* lo: float[packet_count][3][16], radiance towards the viewer; every lane is written, padding with 0. ERR_NOMEM. */
MUST_CHECK enum err direct_shade(struct direct *d, const struct gbuffer *g, const struct rays *rays,
                                 const struct environment *e, const struct direct_desc *desc, float *lo,
                                 struct direct_stats *stats);

/* The light samples of the last direct_shade (no strata under a black sky): for benchmarks, tests and the page's sky.
 */
const struct light_samples *direct_samples(const struct direct *d);

#endif
