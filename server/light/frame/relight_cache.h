/* The light transport cache of `--method cached`, loaded or computed before the relighter's first frame, or on request.
 * Thread: one. */
#pragma once

#include "base/precedence.h"
#include "light/cache_direct/transport.h"
#include "light/frame/relight.h"
#include "light/frame/relight_caustics.h"
#include "light/frame/relight_indirect.h"
#include "light/frame/relight_keep.h"

struct relight_builder;

struct relight_cache {                /* zero it first */
    struct transport *transport;      /* the builder's if there is one */
    struct relight_builder *builder;  /* computes it in the background, or has finished */
    bool building;                    /* the builder has not finished */
    struct precedence urgent;         /* of images over it */
    struct relight_indirect indirect; /* of the same packets */
    struct relight_keep keep;         /* the file of both */
    const struct cache_share *share;  /* other processes that have the same cache; NULL: none. Stays when it is freed */
    bool no_visibility;               /* the setting it was computed with */
    uint64_t max_bytes;
    bool loaded;  /* from a file */
    bool refused; /* with these settings; it is not retried */
    bool kept;    /* relight_cache_keep was called */
    struct reason why;
};

/* Frees it. */
void relight_cache_finish(struct relight_cache *c);

/* Loads or computes it if it is missing, in *ms milliseconds (0: it was there). progress: draw a line. With
 * desc->cache_background a thread computes it, and a refusal is not an error, because METHOD_AUTO lights the images
 * then. Otherwise the call waits for a running computation. ERR_RANGE: it would exceed the memory limit. Cancellation
 * leaves no cache and is not an error. A file that cannot be used or written is logged and is not an error. */
MUST_CHECK enum err relight_cache_make(struct relight_cache *c, const struct prepared_scene *set,
                                       const struct kernels *kernels, const struct relight_desc *desc, bool progress,
                                       double *ms);

/* With other processes: tells them if a request needs a missing cache, so that all load or compute it. ERR_IO:
 * one does not answer. */
MUST_CHECK enum err relight_cache_begin(const struct relight_cache *c, const struct prepared_scene *set,
                                        const struct relight_desc *desc);

/* With other processes, once both caches are complete and stored: process 0 frees the parts that only other processes
 * need. ERR_NOMEM. */
MUST_CHECK enum err relight_cache_keep(struct relight_cache *c);

/* With other processes, once the range share->first to share->end has shrunk: frees the data outside. ERR_NOMEM.
 */
MUST_CHECK enum err relight_cache_narrow(struct relight_cache *c);

/* As relighter_follow. */
double relight_cache_follow(struct relight_cache *c);

/* As relight_builder_behind and relight_builder_take_caustics. */
const struct eye_store *const *relight_cache_behind(const struct relight_cache *c);
void relight_cache_take_caustics(struct relight_cache *c, struct relight_caustics *to);

/* True once there is a finished cache, and frames use no other. */
bool relight_cache_is_settled(const struct relight_cache *c);
