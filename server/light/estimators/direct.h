/* Direct light at the shading points of a G-buffer: the paths E S* D L. At point p with normal n, seen from o,
 *     Lo = integral of f(o, w) max(0, n.w) V(p, w) L(w) dw,
 * estimated by multiple importance sampling with the balance heuristic over the strata of the sky and the lobes of the
 * BRDF [LPG13, Eq. 4 and 6]. Visibility V, which the paper omits, is ray-traced. A direction counts only if its cosines
 * with the geometric and the shading normal are both positive. Thread: one per struct direct. direct_shade runs on all
 * OpenMP threads; its result does not depend on their number.
 */
#pragma once

#include "base/err.h"
#include "light/estimators/method.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/rays.h"
#include "sky/tables/environment.h"
#include "sky/tables/samples.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

struct progress_part;
struct direct;
struct direct_log;
struct kernels;

/* Whether to compensate the sky's tables for MIS with BRDF samples [Karlik et al. 2019]. */
enum compensate {
    COMPENSATE_OFF,
    COMPENSATE_ON,
    COMPENSATE_AUTO, /* if the sky has no sun (sky_table.h), or if the sun is a separate stratum: in other cases
                        compensation increased the error in measurements */
};

struct direct_desc {
    enum method method;  /* not METHOD_CACHED (see light/cache_direct/transport.h) or a reference */
    uint32_t samples;    /* N_s per shading point, 1..2^20 */
    uint64_t seed, pass; /* determine all random numbers */
    bool no_visibility;  /* V = 1, as in the paper */

    /* Extensions of the paper; all zero selects the paper's method. The first three apply only to methods whose strata
     * are faces (faces, faces-uniform, mis and auto) and are otherwise ignored.
     *
     * cells: strata per edge of a face: 1, 2, 4 or 8, a divisor of the cube map's size; 0: 1, the faces themselves.
     * From 2 on, a packet draws integer counts for all its points at once by systematic resampling: the expected count
     * is N q, where q is the mean of its points' shares. beta of Eq. 5 then applies only to the sun. sun: make the sun,
     * if there is one, a separate stratum. compensate: only effective if BRDF lobes are sampled too. scatter: each
     * packet takes one of 16 sets of light samples, by its index, instead of all sharing one. The error of a set
     * then looks like noise, which a filter removes, instead of a tint. */
    uint32_t cells;
    bool sun;
    enum compensate compensate;
    bool scatter;

    /* only: the packets to shade, NULL: all; other packets' places in lo are unchanged. A packet's result does not
     * depend on the list, except with cells, whose samples are as many as the packets of the list need. keep: sky,
     * cells, sun, compensate and method are unchanged since the last call, so the tables are reused. */
    const struct packet_list *only;
    bool keep;

    /* [packet_count]: N_s per packet, 1..samples; NULL: `samples` for all. Counts must be independent of the random
     * numbers: adapting them to the first samples' values causes bias [Kirk and Arvo 1991]. */
    const uint32_t *counts;

    /* Records a point's samples (below) without changing the result. NULL: no recording. */
    struct direct_log *log;

    const atomic_bool *cancel;      /* once true, remaining packets are not shaded; may be NULL */
    struct progress_part *progress; /* stepped by the samples of each packet; may be NULL */
    struct reason *why;             /* explains errors other than ERR_NOMEM; may be NULL */
};

struct direct_stats {
    uint64_t rays;      /* shadow rays traced */
    uint64_t generated; /* light samples drawn from the sky's tables, for all points together */
    uint64_t chosen;    /* light samples used, summed over the points: sum of ceil(N_f) */
    uint64_t effective; /* of these, with positive cosines and light: the green dots of [LPG13, Fig. 1] */
    uint64_t lobes;     /* BRDF samples, summed over the points */
    uint32_t strata;    /* strata of light samples, including the sun; 0 under a black sky */
    bool sun;           /* the sun was a stratum */
    bool compensated;
};

/* Adds the counts of another run; strata and what else describes the tables stay. */
void direct_stats_add(struct direct_stats *to, const struct direct_stats *more);

/* kernels: from kernels_select; must outlive the object. The caller owns the result. NULL: out of memory. */
struct direct *direct_create(const struct kernels *kernels);
void direct_destroy(struct direct *d); /* NULL is allowed */

/* Shades a G-buffer. lo: float[packet_count][3][16], radiance towards the viewer; every lane is written, padding with
 * 0. ERR_UNSUPPORTED: a latlong method on a source that is not lat-long. ERR_USAGE: invalid cells.
 * ERR_NOMEM. */
MUST_CHECK enum err direct_shade(struct direct *d, const struct gbuffer *g, const struct rays *rays,
                                 const struct environment *e, const struct direct_desc *desc, float *lo,
                                 struct direct_stats *stats);

/* Whether what is known of an open sky corrects the samples (open_sky.h): a point that sees all of it has no noise but
 * the sun's. */
bool direct_is_corrected(const struct direct_desc *desc);

/* The first set of light samples of the last direct_shade (no strata under a black sky), for tests; owned by d. Their
 * number is the paper's N_s / 2 per face, N_s for methods without BRDF samples, and the same
 * for the sun. A cell gets the largest count that any packet needs, at most ceil(N q) for the largest share q that it
 * has at a packet. */
const struct light_samples *direct_samples(const struct direct *d);

/* ---- Recorded samples ---- */

/* A log of one shading point's samples, which the kernel records while it shades (direct_desc.log). The values are
 * those of the actual run: their sum by N_s, plus what is known of an open sky, is the point's radiance. Thread: that
 * of direct_shade. The log owns its arrays. */

struct direct_log_sample { /* one sample */
    float w[3];            /* direction, unit; for BRDF samples only if chosen */
    float beta;            /* of [LPG13, Eq. 5]; 0: not chosen by this point */
    float mis;             /* 0..1: balance heuristic weight of the technique that drew it */
    float rgb[3];          /* contribution if unoccluded, before 1 / N_s */
    bool chosen;           /* beta > 0 */
    bool effective;        /* of these: positive cosines and light, so it was traced */
    bool visible;          /* of these: not occluded */
};

struct direct_log {
    uint32_t packet, lane; /* in: the point; its packet must be among those shaded */

    uint32_t samples; /* N_s */
    uint32_t strata, cells;
    bool has_sun;                    /* the last stratum is the sun */
    float share[STRATA_MAX];         /* mu_f(n) of [LPG13, Eq. 3] */
    float count[STRATA_MAX];         /* N_f */
    uint32_t first[STRATA_MAX + 1];  /* stratum f generated light[first[f]] .. light[first[f + 1] - 1] */
    double energy[STRATA_MAX];       /* I_f */
    struct direct_log_sample *light; /* [light_count], in the order of the sky's tables, for all points together */
    struct direct_log_sample *lobes; /* [lobe_count] */
    float known[3];                  /* what the correction by an open sky adds (open_sky.h); 0: there is none */
    uint32_t light_count, lobe_count, light_room, lobe_room;
};

void direct_log_finish(struct direct_log *log); /* frees the arrays; zeroed memory is allowed */
