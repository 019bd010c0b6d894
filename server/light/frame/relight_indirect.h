/* Indirect light by a cache (light/cache_indirect/indirect.h), in addition to the cache of direct light, if the request
 * includes indirect light and leaves its estimator to the plan. Thread: one. */
#pragma once

#include "light/cache_direct/transport.h"
#include "light/cache_indirect/indirect.h"
#include "light/frame/relight.h"
#include "light/frame/relight_keep.h"

struct relight_indirect { /* zero it first */
    struct indirect_cache *indirect;
    bool loaded;  /* from a file */
    bool refused; /* it exceeds the memory limit, which is logged; eye paths replace it */
};

/* Frees it and leaves it zeroed. */
void relight_indirect_finish(struct relight_indirect *b);

/* The cache description for a request, with the blocks of `direct`. */
struct indirect_desc relight_indirect_describe(const struct prepared_scene *set, const struct relight_desc *desc,
                                               const struct transport *direct);

/* Whether the cache provides PATH_INDIRECT_LIT of the request. */
bool relight_indirect_wanted(const struct prepared_scene *set, const struct relight_desc *desc);

/* Loads or computes the cache if it is needed and missing, and adds the milliseconds to *ms. direct: the cache of
 * direct light, whose packets and file it shares; NULL: that one was cancelled, and so is this one. Errors are those of
 * indirect_create, but too little memory is not an error. */
MUST_CHECK enum err relight_indirect_make(struct relight_indirect *b, const struct transport *direct,
                                          const struct prepared_scene *set, const struct kernels *kernels,
                                          const struct relight_desc *desc, struct relight_keep *keep, bool progress,
                                          double *ms);

/* The argument of transport_frame, borrowed. Fills stats->indirect and bias. */
const struct transport_indirect *relight_indirect_take(const struct relight_indirect *b, struct relight_stats *stats);
