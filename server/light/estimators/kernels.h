/* The inner loops, compiled from the same source once per CPU level; kernels_select picks one at start. Within a level,
 * results are the same on all machines; between levels they may differ by rounding only. (In practice they are equal,
 * since levels differ in vector width only, without contraction and with the same order of sums:
 * tests/unit/light/estimators/kernelcheck.c.) Thread: any. */
#pragma once

#include "base/cpu.h"
#include "base/err.h"
#include "light/estimators/method.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/rays.h"
#include "sky/tables/environment.h"
#include "sky/tables/irradiance.h"
#include "sky/tables/samples.h"
#include "sky/tables/sky_table.h"

#include <stdbool.h>
#include <stdint.h>

struct direct_counts {
    uint64_t rays, chosen, effective;
};

#define LIGHT_SETS_MAX PACKET_SETS /* sets of light samples */

struct direct_log;

struct direct_frame { /* common to all packets of a frame; borrowed */
    const struct environment *environment;
    const struct sky_table *table;      /* of the strata; NULL: the environment's own faces, or one stratum */
    const struct light_samples *lights; /* [2][LIGHT_SETS_MAX]: of samples and of scouts */
    bool scatter;            /* packets choose one of LIGHT_SETS_MAX sets by their index; else all have the first */
    const struct rays *rays; /* NULL: no occlusion */
    const struct irradiance
        *known; /* of an open sky, to correct samples by (open_sky.h); NULL: they are not corrected */
    enum share share;
    bool systematic;             /* integer counts per packet; else N_f per point */
    uint32_t samples;            /* N_s */
    const uint32_t *counts;      /* [packet_count]: N_s per packet, at most `samples`; NULL: `samples` for all */
    float light_part, brdf_part; /* shares of N_s */
    uint32_t lobes;              /* ceil(brdf_part N_s) */
    const uint32_t *numbers;     /* [2][lobes][2]: of BRDF samples and of such scouts, of the unit square, in 2^-32 */
    uint64_t seed;               /* shifts the numbers per packet, with its index */
    struct direct_log *log;      /* records the samples of one packet (direct.h); may be NULL */
};

/* How many scouts accompany N_s samples where the light of an open sky is known (open_sky.h). Fewer samples than
 * DIRECT_CORRECTED have none and are not corrected, since a correction could exceed the light of a point. */
#define DIRECT_CORRECTED 8u
#define DIRECT_SCOUTS 16u /* samples for each of them */
static inline uint32_t direct_scouts(const struct direct_frame *f, uint32_t samples)
{
    const uint32_t some = samples < 2 * DIRECT_SCOUTS ? 2 : samples / DIRECT_SCOUTS;

    return f->known && samples >= DIRECT_CORRECTED ? some : 0;
}

/* The set of light samples of a packet, or of its scouts. */
static inline const struct light_samples *direct_lights(const struct direct_frame *f, uint32_t index, bool scouts)
{
    return &f->lights[(scouts ? LIGHT_SETS_MAX : 0) + (f->scatter ? packet_set(index) : 0)];
}

struct kernels {
    enum cpu_level cpu; /* rooms with kernels of their own select them by it */
    const char *level;  /* "v3", "v4": x86-64 micro-architecture levels; "baseline" exists everywhere */
    /* With systematic counts: the number of samples that the packet takes from each stratum, count[strata]. */
    void (*direct_counts)(const struct direct_frame *f, const struct shade_packet *p, uint32_t index, uint32_t *count);

    /* Radiance of one packet to lo[3][16]; adds to *counts. */
    void (*direct_packet)(const struct direct_frame *f, const struct shade_packet *p, uint32_t index, float *lo,
                          struct direct_counts *counts);
};

/* Selects the best level this CPU supports, or the one named ("baseline", "v3", "v4"). ERR_USAGE: unknown or not
 * supported. */
MUST_CHECK enum err kernels_select(const char *level, const struct kernels **out, struct reason *why);
