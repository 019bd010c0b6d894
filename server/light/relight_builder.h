/* A thread that computes a relighter's cache of light transport while the relighter makes pictures (transport/live.h),
 * and then writes its file. */
#ifndef LIGHT_RELIGHT_BUILDER_H
#define LIGHT_RELIGHT_BUILDER_H

#include "light/relight_bounce.h"
#include "light/relight_keep.h"
#include "transport/live.h"

struct relight_builder;

/* Gives the calling thread and its OpenMP helpers the lowest priority, for good. */
void relight_stand_back(uint32_t threads);

/* The request; set and kernels must outlive the builder. */
struct relight_builder_desc {
    const struct set *set;
    const struct kernels *kernels;
    const struct relight_desc *light; /* copied */
    const struct transport_desc *transport;
    const struct relight_keep *keep;
    const struct transport *loaded; /* the cache of direct light if it is there already; else NULL */
};

/* Worst error first. Interreflection, if it is needed, quickly: a rough cache that frames use at once; direct light
 * coarsely; interreflection, which is stored at once, so that a kill does not lose it; direct light. What a file has is
 * loaded instead. ERR_NOMEM. */
MUST_CHECK enum err relight_builder_create(const struct relight_builder_desc *desc, struct relight_builder **out,
                                           struct reason *why);

/* Stops the computation within some hundredths of a second, and frees the cache. NULL is allowed. */
void relight_builder_destroy(struct relight_builder *b);

/* The cache of direct light that it computes; NULL if that was loaded. */
struct transport_live *relight_builder_live(struct relight_builder *b);

/* A new cache of interreflection, which the caller owns from then on and keeps until the builder is destroyed unless it
 * gets a further one; NULL: none. Any thread. */
struct bounce *relight_builder_take(struct relight_builder *b);

/* False while it computes; then nothing is left to take once relight_builder_take was called. *e is the result of
 * direct light, with a reason: ERR_RANGE, ERR_NOMEM. bounce->loaded, bounce->refused: that of interreflection; refused,
 * none may be used. */
bool relight_builder_is_done(struct relight_builder *b, enum err *e, struct relight_bounce *bounce, struct reason *why);

/* True once relight_builder_take has given the finished cache of interreflection, or none is to come. */
bool relight_builder_has_bounce(const struct relight_builder *b);

/* The share that is computed, 0 to 1; 1 only when complete. Of RELIGHT_COARSE and RELIGHT_DIRECT see relight.h. */
double relight_builder_share(const struct relight_builder *b);

#endif
