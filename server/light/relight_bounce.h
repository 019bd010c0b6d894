/* Interreflection by a cache (bounce/bounce.h) beside that of direct light, if the request includes it and leaves its
 * estimator to the plan. One thread. */
#ifndef LIGHT_RELIGHT_BOUNCE_H
#define LIGHT_RELIGHT_BOUNCE_H

#include "bounce/bounce.h"
#include "light/relight.h"
#include "light/relight_keep.h"
#include "transport/transport.h"

#define RELIGHT_BOUNCE_FADE 8 /* frames in which a cache takes over from the one before */

struct relight_bounce { /* zeroed at first */
    struct bounce *bounce;
    struct bounce *before; /* the quick one, while it fades out; NULL: none */
    uint32_t weight;       /* of `bounce` then, in parts of RELIGHT_BOUNCE_FADE */
    bool changed;          /* what frames get: set here, cleared by relight_cache_versions */
    bool loaded;           /* out of a file */
    bool refused;          /* it exceeds the memory limit, as the log says; eye paths replace it */
};

/* Frees it and leaves it zeroed. */
void relight_bounce_finish(struct relight_bounce *b);

/* Takes over a cache; the one before fades out over the next frames, or at once. */
void relight_bounce_replace(struct relight_bounce *b, struct bounce *next, bool at_once);

/* One frame on, or to the end of the fade. */
void relight_bounce_advance(struct relight_bounce *b, bool to_end);

/* What is computed for a request, with the blocks of `direct`. */
struct bounce_desc relight_bounce_describe(const struct set *set, const struct relight_desc *desc,
                                           const struct transport *direct);

/* Whether it computes PATH_INDIRECT_LIT of the request. */
bool relight_bounce_wanted(const struct set *set, const struct relight_desc *desc);

/* Loads or computes it if it is needed and missing, and adds the milliseconds to *ms. direct: the cache of direct
 * light, whose packets it uses and whose file it shares; NULL: that was cancelled, and so is this. Errors are those of
 * bounce_create, except that too little memory is none. */
MUST_CHECK enum err relight_bounce_make(struct relight_bounce *b, const struct transport *direct, const struct set *set,
                                        const struct kernels *kernels, const struct relight_desc *desc,
                                        struct relight_keep *keep, bool progress, double *ms);

/* The argument of transport_frame, borrowed; or, with lo, which a fade requires, adds the light there and returns NULL.
 * Fills stats->bounce and bias. */
const struct transport_indirect *relight_bounce_take(struct relight_bounce *b, const struct environment *e,
                                                     const struct relight_desc *desc, float *lo,
                                                     struct relight_stats *stats);

#endif
