/* The cache of light transport of `--method cached`: loaded or computed before the relighter's first frame, or on
 * request. One thread. */
#ifndef LIGHT_RELIGHT_CACHE_H
#define LIGHT_RELIGHT_CACHE_H

#include "light/relight.h"
#include "light/relight_bounce.h"
#include "light/relight_keep.h"
#include "transport/transport.h"

struct light_part;
struct relight_builder;

struct relight_cache {               /* zeroed at first */
    struct transport *transport;     /* the builder's where there is one */
    struct relight_builder *builder; /* computes it in the background, or has done so */
    bool building;                   /* still */
    struct relight_bounce bounce;    /* of the same packets */
    struct relight_keep keep;        /* where both are kept */
    bool no_visibility;              /* as it was computed for */
    uint64_t max_bytes;
    bool loaded;  /* out of a file */
    bool refused; /* with these settings; it is not tried again */
    struct reason why;
};

/* Frees it. */
void relight_cache_finish(struct relight_cache *c);

/* Loads or computes it if it is missing, in *ms milliseconds (0: it was there). progress: draw a line. With
 * desc->cache_background a thread computes it, and refusal is no error: METHOD_AUTO lights the pictures. Without, a
 * running computation is waited for. ERR_RANGE: it would exceed the memory limit. When cancelled there is none, and no
 * error. A file that cannot be used or written is logged and no error. */
MUST_CHECK enum err relight_cache_make(struct relight_cache *c, const struct set *set, const struct kernels *kernels,
                                       const struct relight_desc *desc, bool progress, double *ms);

/* As relighter_follow. */
double relight_cache_follow(struct relight_cache *c);

/* Direct light into lo by the cache, and packets that it lacks by direct_shade with METHOD_AUTO; and interreflection,
 * if stats->plan assigns it to the cache. part: only for those packets, of a complete cache; NULL: for all. Fills
 * stats->direct, stats->cache_* and stats->bounce_*. Errors are those of transport_shade and direct_shade. */
MUST_CHECK enum err relight_cache_shade(struct relight_cache *c, struct direct *direct, const struct set *set,
                                        const struct environment *e, const struct relight_desc *desc,
                                        const struct light_part *part, float *lo, struct relight_stats *stats);

/* The packets' versions, [packet_count], as by transport_live_versions, interreflection included. */
void relight_cache_versions(struct relight_cache *c, float *final, bool *changed);

/* True once frames get the finished cache alone. */
bool relight_cache_is_settled(const struct relight_cache *c);

#endif
