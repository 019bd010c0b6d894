/* The file of a relighter's cache, at the place of cache_place.h: read before the computation, written after it. Each
 * fault is logged once, and what cannot be loaded is computed. One thread at a time. */
#ifndef LIGHT_RELIGHT_KEEP_H
#define LIGHT_RELIGHT_KEEP_H

#include "bounce/bounce.h"
#include "light/cache_place.h"
#include "base/digest.h"
#include "light/relight.h"
#include "transport/transport.h"

struct relight_keep {
    struct cache_place place;
    struct digest key;
    bool unreadable, unwritable; /* a warning said so */
};

/* desc: names the file; transport: what is computed, by these kernels. */
void relight_keep_init(struct relight_keep *k, const struct set *set, const struct kernels *kernels,
                       const struct relight_desc *desc, const struct transport_desc *transport);

/* *out is NULL if the file cannot be used. ERR_RANGE: it would exceed the memory limit; ERR_NOMEM. */
MUST_CHECK enum err relight_keep_load(struct relight_keep *k, const struct set *set, const struct kernels *kernels,
                                      const struct transport_desc *transport, struct transport **out,
                                      struct reason *why);

/* Interreflection from the same file, as relight_keep_load. */
MUST_CHECK enum err relight_keep_load_bounce(struct relight_keep *k, const struct kernels *kernels,
                                             const struct bounce_desc *desc, struct bounce **out, struct reason *why);

/* Stores direct light (NULL: that is not computed yet, and a file of it will replace this one), and interreflection of
 * that desc (NULL and NULL: none). */
void relight_keep_save(struct relight_keep *k, const struct transport *t, const struct bounce *bounce,
                       const struct bounce_desc *desc);

#endif
