/* A cache of direct light that lights frames while it is being built. The builder's thread computes the blocks, first
 * coarsely and then finely; the frame's thread shades with the blocks built so far. Other techniques light the missing
 * blocks (transport_unbuilt).
 *
 * The builder hands a block over in a slot by one atomic exchange. The frame's thread collects the slots at the start
 * of a frame (transport_live_advance) and frees the blocks that they replace. Once all blocks are built, the cache
 * equals that of transport_create to the bit. */
#pragma once

#include "light/cache/memory.h"
#include "light/cache_direct/transport.h"

struct transport_live;

/* Prepares a build; desc->progress and desc->cancel are ignored. The caller frees *out with transport_live_destroy; on
 * ERR_NOMEM it is NULL. */
MUST_CHECK enum err transport_live_create(const struct gbuffer *g, const struct rays *rays,
                                          const struct kernels *kernels, const struct transport_desc *desc,
                                          struct transport_live **out, struct reason *why);
void transport_live_destroy(struct transport_live *live); /* after the builder has ended; NULL is allowed */

/* ---- The builder ---- */

enum transport_stage {
    TRANSPORT_COARSE, /* a sixteenth of the rays: one direction in 2 x 2 cells */
    TRANSPORT_FINE,
    TRANSPORT_STAGES,
};

/* Builds all blocks of a stage on `threads` OpenMP threads of the caller (0: all). Call it once per stage, in order, or
 * for the last stage only. ERR_RANGE: max_bytes is too small; *why states a sufficient limit. ERR_NOMEM. When
 * cancelled: ERR_OK, with blocks missing. */
MUST_CHECK enum err transport_live_build(struct transport_live *live, enum transport_stage stage, uint32_t threads,
                                         struct reason *why);

/* The finished cache for transport_save, NULL before the last stage ends; valid until transport_live_destroy. */
const struct transport *transport_live_built(const struct transport_live *live);

/* The finished cache as far as it is built. Its block layout is valid from the start. */
const struct transport *transport_live_layout(const struct transport_live *live);

/* ---- Any thread ---- */

/* Makes transport_live_build return early. */
void transport_live_cancel(struct transport_live *live);

/* The share of the stage's packets that are built, 0..1. */
double transport_live_share(const struct transport_live *live, enum transport_stage stage);

/* ---- The frame's thread ---- */

/* The cache to shade with; valid as long as `live`. */
struct transport *transport_live_cache(struct transport_live *live);

/* Takes over newly built blocks. Call it before each frame. */
void transport_live_advance(struct transport_live *live);

/* Whether a builder that may use `most` bytes waits for frames: more are held, but frames will free enough. newest:
 * what is held without what has been replaced. */
static inline bool transport_live_waits(uint64_t most, uint64_t held, uint64_t newest)
{
    return !cache_memory_suffices(most, held) && cache_memory_suffices(most, newest);
}

/* Whether all blocks would take more than `most` bytes if each takes as many as those done. */
static inline bool transport_will_exceed(uint64_t most, uint64_t bytes, uint32_t done, uint32_t all)
{
    return (double)bytes * all / done > (double)most;
}
