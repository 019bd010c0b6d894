/* server/shade/kernels.h */
/* The inner loops, one build of the same source per CPU level: kernels_select picks one at start. Within a level the
 * bits are the same everywhere; between levels they differ by rounding only (no contraction, same order of sums; the
 * levels differ in vector width, not in arithmetic, so in practice they are equal: tests/unit/shade/kernelcheck.c). */
#ifndef SHADE_KERNELS_H
#define SHADE_KERNELS_H

#include "environment.h"
#include "err.h"
#include "gbuffer.h"
#include "method.h"
#include "rays.h"
#include "samples.h"
#include "sky_table.h"

#include <stdbool.h>
#include <stdint.h>

struct direct_counts {
    uint64_t rays, chosen, effective;
};

#define SETS_MAX 16 /* of light samples */

struct direct_log;

struct direct_frame { /* what all packets of a frame share; borrowed */
    const struct environment *environment;
    const struct sky_table *table;      /* the strata's; NULL: the environment's own faces, or one stratum */
    const struct light_samples *lights; /* [sets] */
    uint8_t set_of[SETS_MAX];           /* from shade_packet.set to the one of `lights` that the packet uses */
    const struct rays *rays;            /* NULL: everything is visible */
    enum share share;
    bool systematic;             /* whole counts for a packet at a time; else N_f of each point */
    uint32_t samples;            /* N_s */
    const uint32_t *counts;      /* [packet_count]: N_s of each packet, none above `samples`; NULL: that, for all */
    float light_part, brdf_part; /* of N_s */
    const uint32_t *numbers; /* [ceil(brdf_part N_s)][2]: points of the unit square in units of 2^-32, for the lobes */
    uint64_t seed;           /* packets turn the numbers by it and their index */
    struct direct_log *log;  /* NULL, or where one of the packets writes down its samples: direct_log.h */
};

struct transport_kernels;
struct bounce_kernels;

struct kernels {
    const char *level; /* "v3", "v4": x86-64 micro-architecture levels; "baseline" everywhere */
    /* Where counts are systematic: how many samples of each stratum the packet takes, count[strata]. */
    void (*direct_counts)(const struct direct_frame *f, const struct shade_packet *p, uint32_t index, uint32_t *count);

    /* Radiance of one packet into lo[3][16]; adds to *counts. */
    void (*direct_packet)(const struct direct_frame *f, const struct shade_packet *p, uint32_t index, float *lo,
                          struct direct_counts *counts);

    const struct transport_kernels *transport; /* transport_parts.h */
    const struct bounce_kernels *bounce;       /* bounce_parts.h */
};

/* The best level that this CPU has, or the one named ("baseline", "v3", "v4"); ERR_USAGE when it is unknown or
 * the CPU lacks it. */
MUST_CHECK enum err kernels_select(const char *level, const struct kernels **out, struct reason *why);

/* All levels that this CPU has, worst first, ended by NULL: for tests. */
const struct kernels *const *kernels_all(void);

#endif
