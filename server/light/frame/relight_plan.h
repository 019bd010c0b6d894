/* Turns a request into the passes of an image, with the plan of light/plan/plan.h and the requested counts. Pure
 * functions. Thread: any. */
#pragma once

#include "light/frame/relight_passes.h"

/* Whether METHOD_CACHED computes direct light. */
bool relight_is_cached(const struct relight_desc *desc);

/* bounce: the cache of indirect light, or NULL. e may be NULL: the estimator of caustics is then undecided unless they
 * are stored. grown: relight_caustics_serve, before which live images under a soft sky take eye paths. */
void relight_plan(const struct prepared_scene *set, const struct indirect_cache *indirect, const struct environment *e,
                  const struct relight_desc *desc, bool grown, struct plan *out);

/* The classes that the plan assigns to `who`. */
uint32_t relight_plan_classes(const struct plan *p, enum plan_estimator who);

/* The classes that images with the cache will take from stored light paths, even if this one cannot yet; 0: none. */
uint32_t relight_plan_later(const struct relight_desc *desc, const struct plan *p);

/* The classes that stored eye paths light at points behind mirrors and glass; 0: none. */
uint32_t relight_plan_behind(const struct prepared_scene *set, const struct relight_desc *desc, const struct plan *p);

/* *out borrows desc, bounce and scratch. */
void relight_plan_passes(const struct prepared_scene *set, const struct indirect_cache *indirect,
                         struct scratch *scratch, const struct relight_desc *desc, const struct plan *p,
                         struct image_passes *out);
