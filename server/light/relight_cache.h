/* The cache of light transport that a relighter has for `--method cached`: loaded or made before its first frame, or
 * when it is asked for. One thread. */
#ifndef LIGHT_RELIGHT_CACHE_H
#define LIGHT_RELIGHT_CACHE_H

#include "light/relight.h"
#include "light/relight_bounce.h"
#include "light/relight_keep.h"
#include "transport/transport.h"

struct relight_builder;

struct relight_cache {               /* zeroed at first */
    struct transport *transport;     /* the builder's where there is one */
    struct relight_builder *builder; /* it was computed in the background, or is */
    bool building;                   /* it is */
    struct relight_bounce bounce;    /* of the same packets */
    struct relight_keep keep;        /* where both are kept */
    bool no_visibility;              /* what it was made for */
    uint64_t max_bytes;
    bool loaded;  /* out of a file */
    bool refused; /* for these; it is not tried again */
    struct reason why;
};

void relight_cache_finish(struct relight_cache *c);

/* Loads or makes it where it is not there yet; *ms is what that took, 0 where it was. progress: draw a line. With
 * desc->cache_background it is made while pictures are made, and then it is no error that it is refused: they are lit
 * by METHOD_AUTO. Without, what is under way is waited for. ERR_RANGE: it would take more memory than it may. When
 * cancelled there is none, and no error. That a file cannot be used or written is a line in the log and no error. */
MUST_CHECK enum err relight_cache_make(struct relight_cache *c, const struct set *set, const struct kernels *kernels,
                                       const struct relight_desc *desc, bool progress, double *ms);

/* As relighter_follow. */
double relight_cache_follow(struct relight_cache *c);

/* Direct light into lo: by the cache, and what it leaves or has not yet by direct_shade with METHOD_AUTO; and
 * interreflection, where stats->plan gives it to the cache. Fills stats->direct, stats->cache_* and stats->bounce_*. */
MUST_CHECK enum err relight_cache_shade(struct relight_cache *c, struct direct *direct, const struct set *set,
                                        const struct environment *e, const struct relight_desc *desc, float *lo,
                                        struct relight_stats *stats);

#endif
