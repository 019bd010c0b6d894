/* A log of one shading point's samples, which the kernel records while it shades (direct_desc.log). The values are
 * those of the actual run, so their sum equals the point's radiance exactly. Thread: that of direct_shade. The log owns
 * its arrays. */
#pragma once

#include "sky/tables/samples.h"

#include <stdbool.h>
#include <stdint.h>

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
    uint32_t light_count, lobe_count, light_room, lobe_room;
};

void direct_log_finish(struct direct_log *log); /* frees the arrays; zeroed memory is allowed */
