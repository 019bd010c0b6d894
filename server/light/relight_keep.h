/* The file of a relighter's cache (cache_place.h says where): read before anything is computed, written after. Whatever
 * is wrong with it is a line in the log, and what cannot be loaded is computed. */
#ifndef LIGHT_RELIGHT_KEEP_H
#define LIGHT_RELIGHT_KEEP_H

#include "bounce/bounce.h"
#include "light/cache_place.h"
#include "base/digest.h"
#include "light/relight.h"
#include "transport/transport.h"

struct relight_keep {
    struct cache_places places;
    struct digest key; /* where there are places */
    bool read_only;
};

/* desc: for the file's name; transport: what is computed. */
void relight_keep_init(struct relight_keep *k, const struct set *set, const struct relight_desc *desc,
                       const struct transport_desc *transport);

/* *out is NULL where no file can be used. ERR_RANGE: it would take more memory than it may; ERR_NOMEM. */
MUST_CHECK enum err relight_keep_load(const struct relight_keep *k, const struct set *set,
                                      const struct kernels *kernels, const struct transport_desc *transport,
                                      struct transport **out, struct reason *why);

/* Interreflection out of the same file, as relight_keep_load. */
MUST_CHECK enum err relight_keep_load_bounce(const struct relight_keep *k, const struct kernels *kernels,
                                             const struct bounce_desc *desc, struct bounce **out, struct reason *why);

/* In the first place that can be written: direct light, and interreflection where there is one, of that desc; without,
 * NULL and NULL. */
void relight_keep_save(const struct relight_keep *k, const struct transport *t, const struct bounce *bounce,
                       const struct bounce_desc *desc);

#endif
