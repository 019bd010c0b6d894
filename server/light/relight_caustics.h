/* The relighter's store of light paths for PLAN_STORED: built before the first frame, or on request; a part of it is
 * redrawn with every turn. One thread. */
#ifndef LIGHT_RELIGHT_CAUSTICS_H
#define LIGHT_RELIGHT_CAUSTICS_H

#include "light/relight.h"
#include "env/sky_split.h"

struct relight_caustics { /* zeroed at first */
    struct caustic_store *store;
    struct caustic_store_desc made; /* as it was built for */
    struct sky_split sky;
    size_t image; /* numbers of one picture */
};

/* Frees it and leaves it zeroed. */
void relight_caustics_finish(struct relight_caustics *c);

/* Makes an empty one for these classes if it is missing. ERR_RANGE, ERR_NOMEM. */
MUST_CHECK enum err relight_caustics_begin(struct relight_caustics *c, const struct set *set,
                                           const struct relight_desc *desc, uint32_t classes);

/* For live pictures: draws parts that desc->turn lacks for about `seconds`, at least two. ERR_NOMEM. */
MUST_CHECK enum err relight_caustics_grow(struct relight_caustics *c, const struct relight_desc *desc, double seconds,
                                          struct relight_stats *stats);

/* Adds to rgb the light of half `half` of the store, 0 or 1, as far as it has grown. To be called for 0 first.
 * ERR_NOMEM.
 */
MUST_CHECK enum err relight_caustics_half(struct relight_caustics *c, const struct environment *e,
                                          const struct relight_desc *desc, uint32_t half, float *rgb);

/* The run of the light tracer for the bright part of e: of `particles` its share of the energy. After
 * relight_caustics_half. */
struct light_tracer_desc relight_caustics_bright(const struct relight_caustics *c, const struct environment *e,
                                                 const struct relight_desc *desc, uint64_t particles);

/* Builds it for these classes if it is missing, and adds the milliseconds to *ms. progress: draw a line. ERR_RANGE: a
 * few paths would exceed the memory limit. When cancelled it may be incomplete, which is no error. */
MUST_CHECK enum err relight_caustics_make(struct relight_caustics *c, const struct set *set,
                                          const struct relight_desc *desc, uint32_t classes, bool progress, double *ms);

/* Draws the parts that desc->turn lacks, then adds to rgb the light of the store under e, and that of particles of the
 * bright part: of plan->particles its share of the energy. With a ground rgb is as
 * caustic_store_desc.ground_apart says. Fills stats->light and stats->stored. ERR_NOMEM. */
MUST_CHECK enum err relight_caustics_run(struct relight_caustics *c, struct light_tracer *light,
                                         const struct environment *e, const struct relight_desc *desc, float *rgb,
                                         struct relight_stats *stats);

#endif
