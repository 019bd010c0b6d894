/* The relighter's store of light paths for PLAN_STORED: built before the first frame, or on request; every turn redraws
 * a part of it. One thread. */
#pragma once

#include "light/estimators/eye_store.h"
#include "light/frame/relight.h"
#include "sky/tables/sky_split.h"

struct relight_caustics { /* zero it first */
    struct caustic_store *store;
    struct caustic_store_desc made; /* the settings it was built with */
    struct sky_split sky;
    size_t image;                      /* floats in one image */
    struct eye_store *behind;          /* of points behind mirrors and glass; NULL: not asked for */
    struct eye_store_desc behind_made; /* the settings it was built with */
};

/* Frees it and leaves it zeroed. */
void relight_caustics_finish(struct relight_caustics *c);

/* Creates an empty store for these classes if it is missing. ERR_RANGE, ERR_NOMEM. */
MUST_CHECK enum err relight_caustics_begin(struct relight_caustics *c, const struct prepared_scene *set,
                                           const struct relight_desc *desc, uint32_t classes);

/* What such a store is made of. */
struct caustic_store_desc relight_caustics_describe(const struct prepared_scene *set, const struct relight_desc *desc,
                                                    uint32_t classes);

/* Owns `made`, of this description; the store so far is replaced if it is of the same. */
void relight_caustics_adopt(struct relight_caustics *c, struct caustic_store *made,
                            const struct caustic_store_desc *desc);

/* For live images: draws missing parts of desc->turn for about `seconds`, at least two parts. ERR_NOMEM. */
MUST_CHECK enum err relight_caustics_grow(struct relight_caustics *c, const struct relight_desc *desc, double seconds,
                                          struct relight_stats *stats);

/* Whether the store has all its parts, of whichever turns. */
bool relight_caustics_is_full(const struct relight_caustics *c);

/* True once the store of live images has grown enough to light them better than eye paths. */
bool relight_caustics_serve(const struct relight_caustics *c);

/* Divides the sky of an image into what stored paths light and what particles of the sun do. ERR_NOMEM. */
MUST_CHECK enum err relight_caustics_take(struct relight_caustics *c, const struct environment *e,
                                          const struct relight_desc *desc);

/* The light tracer's description for the sun of e, which gets its energy share of `particles`, under the sky
 * taken. */
struct light_tracer_desc relight_caustics_sun(const struct relight_caustics *c, const struct environment *e,
                                              const struct relight_desc *desc, uint64_t particles);

/* Builds the store for these classes if it is missing, and adds the milliseconds to *ms. progress: draw a line.
 * ERR_RANGE: a few paths would exceed the memory limit. Cancellation may leave it incomplete and is not an error. */
MUST_CHECK enum err relight_caustics_make(struct relight_caustics *c, const struct prepared_scene *set,
                                          const struct relight_desc *desc, uint32_t classes, bool progress, double *ms);

/* Draws the missing parts of desc->turn, then adds to rgb the store's light under e and the light of particles from the
 * sun, which gets its energy share of plan->particles. With a ground, rgb has the layout of
 * caustic_store_desc.ground_apart. Fills stats->light and stats->stored. ERR_NOMEM. */
MUST_CHECK enum err relight_caustics_run(struct relight_caustics *c, struct light_tracer *light,
                                         const struct environment *e, const struct relight_desc *desc, float *rgb,
                                         struct relight_stats *stats);

/* Stores eye paths of these classes at points behind mirrors and glass (eye_store.h), 8 for each of `paths`, if they
 * are missing, and adds the milliseconds to *ms. ERR_NOMEM. */
MUST_CHECK enum err relight_caustics_make_behind(struct relight_caustics *c, const struct prepared_scene *set,
                                                 const struct relight_desc *desc, uint32_t classes, uint32_t paths,
                                                 double *ms);

/* Adds their light to the shade points, if there are any. */
void relight_caustics_behind(const struct relight_caustics *c, const struct environment *e, float *lo,
                             struct relight_stats *stats);
