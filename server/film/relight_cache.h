/* The cache of light transport that a relighter has for `--method cached`: loaded or made before its first frame, or
 * when it is asked for. One thread. */
#ifndef FILM_RELIGHT_CACHE_H
#define FILM_RELIGHT_CACHE_H

#include "relight.h"
#include "relight_bounce.h"
#include "transport.h"

struct relight_cache { /* zeroed at first */
    struct transport *transport;
    struct relight_bounce bounce; /* of the same packets */
    bool no_visibility;           /* what it was made for */
    uint64_t max_bytes;
    bool loaded;  /* out of a file */
    bool refused; /* for these; it is not tried again */
    struct reason why;
};

void relight_cache_finish(struct relight_cache *c);

/* Loads or makes it where it is not there yet; *ms is what that took, 0 where it was. progress: draw a line. ERR_RANGE:
 * it would take more memory than it may. When cancelled there is none, and no error. That a file cannot be used or
 * written is a line in the log and no error. */
MUST_CHECK enum err relight_cache_make(struct relight_cache *c, const struct set *set, const struct kernels *kernels,
                                       const struct relight_desc *desc, bool progress, double *ms);

/* Direct light into lo: by the cache, and what it leaves by direct_shade with METHOD_AUTO. Fills stats->direct and
 * stats->cache_*. */
MUST_CHECK enum err relight_cache_shade(struct relight_cache *c, struct direct *direct, const struct set *set,
                                        const struct environment *e, const struct relight_desc *desc, float *lo,
                                        struct relight_stats *stats);

#endif
