/* The file of a relighter's cache, at the path of light/cache/cache_place.h: read before the computation, written after
 * it. Each fault is logged once, and parts that cannot be loaded are computed. Thread: one at a time. */
#pragma once

#include "base/digest.h"
#include "light/cache/cache_place.h"
#include "light/cache_direct/transport.h"
#include "light/cache_indirect/indirect.h"
#include "light/frame/relight.h"

struct relight_keep {
    struct cache_place place;
    struct digest key;
    bool unreadable, unwritable;     /* a warning was logged */
    const struct cache_share *share; /* other processes that load the same; process 0 stores it. NULL: none */
};

/* desc: names the file; transport: the cache to compute, with these kernels. */
void relight_keep_init(struct relight_keep *k, const struct prepared_scene *set, const struct kernels *kernels,
                       const struct relight_desc *desc, const struct transport_desc *transport);

/* *out is NULL if the file cannot be used. ERR_RANGE: it would exceed the memory limit; ERR_NOMEM. */
MUST_CHECK enum err relight_keep_load(struct relight_keep *k, const struct prepared_scene *set,
                                      const struct kernels *kernels, const struct transport_desc *transport,
                                      struct transport **out, struct reason *why);

/* Collective, after loading: returns this process's error or that of another, and whether all processes have loaded it;
 * if not, all compute it. */
MUST_CHECK enum err relight_keep_agree(const struct relight_keep *k, enum err own, bool loaded, bool *all,
                                       struct reason *why);

/* Loads indirect light from the same file, as relight_keep_load. */
MUST_CHECK enum err relight_keep_load_indirect(struct relight_keep *k, const struct kernels *kernels,
                                               const struct indirect_desc *desc, struct indirect_cache **out,
                                               struct reason *why);

/* Stores direct light and indirect light. t NULL: direct light is not computed yet, and a file with it will replace
 * this one. bounce and its desc NULL: no indirect light. */
void relight_keep_save(struct relight_keep *k, const struct transport *t, const struct indirect_cache *indirect,
                       const struct indirect_desc *desc);
