/* What one shade point does with its samples, written down by the kernel while it shades (direct_desc.log): the very
 * numbers of that run, so that their sum is the point's radiance to the bit. */
#ifndef SHADE_DIRECT_LOG_H
#define SHADE_DIRECT_LOG_H

#include "err.h"
#include "samples.h"

#include <stdbool.h>
#include <stdint.h>

struct direct_note { /* one sample */
    float w[3];      /* direction, unit; of the lobes' only where chosen */
    float beta;      /* of [LPG13, Eq. 5]: 0 is not chosen by this point */
    float mis;       /* 0..1: the balance heuristic's weight of the strata, or of the lobes, that drew it */
    float rgb[3];    /* what it brings where nothing is in the way, before 1 / N_s */
    bool chosen;     /* beta > 0 */
    bool effective;  /* of these: positive cosines and light, so that it was traced */
    bool visible;    /* of these: and nothing in the way */
};

struct direct_log {
    uint32_t packet, lane; /* in: which point; the packet must be among those that are shaded */

    uint32_t samples; /* N_s */
    uint32_t strata, cells;
    bool has_sun;                   /* the last stratum is the sun */
    float share[STRATA_MAX];        /* mu_f(n) of [LPG13, Eq. 3] */
    float count[STRATA_MAX];        /* N_f */
    uint32_t first[STRATA_MAX + 1]; /* stratum f generated light[first[f]] .. light[first[f + 1]] */
    double energy[STRATA_MAX];      /* I_f */
    struct direct_note *light;      /* [light_count], as drawn from the sky's tables for all points together */
    struct direct_note *lobes;      /* [lobe_count] */
    uint32_t light_count, lobe_count, light_room, lobe_room;
};

void direct_log_finish(struct direct_log *log); /* zeroed memory is allowed */

#endif
