/* The store of light paths that a relighter has where the plan says PLAN_STORED: made before its first frame, or when
 * it is asked for, and a part of it drawn anew with every turn. One thread. */
#ifndef LIGHT_RELIGHT_CAUSTICS_H
#define LIGHT_RELIGHT_CAUSTICS_H

#include "light/relight.h"
#include "env/sky_split.h"

struct relight_caustics { /* zeroed at first */
    struct caustic_store *store;
    struct caustic_store_desc made; /* what it was made for */
    struct sky_split sky;
};

void relight_caustics_finish(struct relight_caustics *c);

/* Makes it for these classes where it is not there yet. *ms grows by what that took, 0 where it was there. progress:
 * draw a line. ERR_RANGE: a handful of paths would take more memory than it may. When cancelled it may be less than
 * whole, and no error. */
MUST_CHECK enum err relight_caustics_make(struct relight_caustics *c, const struct set *set,
                                          const struct relight_desc *desc, uint32_t classes, bool progress, double *ms);

/* Draws what desc->turn lacks, then adds to rgb what the store brings under e, and what particles of the bright part
 * do: of plan->particles as many as is its share of the energy. Fills stats->light and stats->stored. */
MUST_CHECK enum err relight_caustics_run(struct relight_caustics *c, struct light_tracer *light,
                                         const struct environment *e, const struct relight_desc *desc, float *rgb,
                                         struct relight_stats *stats);

#endif
