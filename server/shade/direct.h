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
struct direct_log;
struct kernels;

/* Whether the sky's tables are reshaped for what the lobes' samples will not cover as well [Karlik et al. 2019]. */
enum compensate {
    COMPENSATE_OFF,
    COMPENSATE_ON,
    COMPENSATE_AUTO, /* where the sky has no sun of its own (sky_table.h), or that is taken out: with a sun among the
                      * rest it has been seen to lose */
};

struct direct_desc {
    enum method method;  /* not METHOD_CACHED, which is transport.h's, nor a reference */
    uint32_t samples;    /* N_s per shade point, 1..2^20 */
    uint64_t seed, pass; /* together they decide every random number */
    bool no_visibility;  /* V = 1, as the paper */

    /* Beyond the paper; all zero is as the paper has it. The first three mean something only where faces are the
     * strata: faces, faces-uniform, mis and auto; elsewhere they change nothing.
     *
     * cells: strata along a face's edge: 1, 2, 4 or 8, a divisor of the cube map's size; 0: 1, the faces themselves.
     * From 2 on a packet draws whole counts for all its points at once, by systematic resampling: the mean of a count
     * is N q, q the mean of its points' shares. beta of Eq. 5 is then left to the sun alone.
     * sun: where the sky has one, it is one more stratum.
     * compensate: honoured only where lobes are sampled too.
     * interleave: K, for K x K sets of light samples, a divisor of the G-buffer's own; 0: 1. */
    uint32_t cells;
    bool sun;
    enum compensate compensate;
    uint32_t interleave;

    /* only: the packets to be shaded, NULL: all; of lo the others' places stay as they are. A packet has the same bits
     * in any list, but for cells, whose samples are as many as the packets of the list ask for. keep: sky, cells, sun,
     * compensate and method are those of the last call: its tables are not built again. */
    const struct packet_list *only;
    bool keep;

    /* [packet_count]: N_s of each packet, 1..samples, instead of `samples` for all; NULL: that. Counts must not depend
     * on the very numbers that are to be drawn: who samples on where the first samples came out high shifts the mean
     * [Kirk and Arvo 1991]. */
    const uint32_t *counts;

    /* What one point does with its samples is written down: direct_log.h. It changes no bit. NULL: nothing is. */
    struct direct_log *log;

    const atomic_bool *cancel; /* once true, what is left is not shaded; may be NULL */
    struct reason *why;        /* where an error other than ERR_NOMEM is explained; may be NULL */
};

struct direct_stats {
    uint64_t rays;      /* shadow rays traced */
    uint64_t generated; /* light samples drawn from the sky's tables, for all points together */
    uint64_t chosen;    /* light samples in use, summed over the points: sum of ceil(N_f) */
    uint64_t effective; /* of these, with positive cosines and light: the green dots of [LPG13, Fig. 1] */
    uint64_t lobes;     /* samples of the material's lobes, summed over the points */
    uint32_t strata;    /* that light samples are drawn in, the sun with them; 0 under a black sky */
    bool sun;           /* it was one of them */
    bool compensated;
};

/* kernels: from kernels_select; must outlive the object. NULL when out of memory. */
struct direct *direct_create(const struct kernels *kernels);
void direct_destroy(struct direct *d); /* NULL is allowed */

/* lo: float[packet_count][3][16], radiance towards the viewer; every lane is written, padding with 0.
 * ERR_UNSUPPORTED: latlong methods on a source that is none. ERR_USAGE: cells or interleave that do not fit. ERR_NOMEM.
 */
MUST_CHECK enum err direct_shade(struct direct *d, const struct gbuffer *g, const struct rays *rays,
                                 const struct environment *e, const struct direct_desc *desc, float *lo,
                                 struct direct_stats *stats);

/* The light samples of the last direct_shade (no strata under a black sky), the first set of them: for benchmarks,
 * tests and the page's sky. How many there are: the paper's N_s / 2 for each face, N_s for methods by light alone, and
 * as many for the sun. Cells get the largest count that any packet asks for, which is at most ceil(N q) for the largest
 * share q that the cell has at a packet. */
const struct light_samples *direct_samples(const struct direct *d);

#endif
