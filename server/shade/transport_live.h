/* A cache of light transport that gives light while it is being built. One thread, the builder, computes its blocks,
 * first coarsely and then as they stay; another, the frame's, has the cache and shades with it: blocks that are not
 * there yet are lit by other means (transport_unbuilt), and what takes a block's place does so over TRANSPORT_FADE
 * frames.
 *
 * A finished block is handed over in a slot of its own, by one atomic exchange; the frame's thread takes what it finds
 * there at the beginning of a frame (transport_live_advance), and gives free what that replaces when nothing is left of
 * it. When all is built and has taken its place, the cache is the very one that transport_create makes, to the bit. */
#ifndef SHADE_TRANSPORT_LIVE_H
#define SHADE_TRANSPORT_LIVE_H

#include "transport.h"

struct transport_live;

/* desc->progress and desc->cancel are not looked at. ERR_NOMEM. */
MUST_CHECK enum err transport_live_create(const struct gbuffer *g, const struct rays *rays,
                                          const struct kernels *kernels, const struct transport_desc *desc,
                                          struct transport_live **out, struct reason *why);
void transport_live_destroy(struct transport_live *live); /* once the builder is done; NULL is allowed */

/* ---- The builder ---- */

enum transport_stage {
    TRANSPORT_COARSE, /* a sixteenth of the rays: one direction in 2 x 2 cells */
    TRANSPORT_FINE,
    TRANSPORT_STAGES,
};

/* All blocks of a stage, by so many OpenMP threads (0: as many as there are), which are the calling thread's own; each
 * stage once, in their order, or only the last. ERR_RANGE: max_bytes does not suffice; *why says what would. ERR_NOMEM.
 * When cancelled: no error, and not all blocks. */
MUST_CHECK enum err transport_live_build(struct transport_live *live, enum transport_stage stage, uint32_t threads,
                                         struct reason *why);

/* What was built, for transport_save; NULL before all is. It may be read until transport_live_destroy. */
const struct transport *transport_live_built(const struct transport_live *live);

/* ---- Any thread ---- */

void transport_live_cancel(struct transport_live *live);

/* The share of the stage's shade packets that are built. */
double transport_live_share(const struct transport_live *live, enum transport_stage stage);

/* ---- The frame's thread ---- */

/* Lasts as long as `live`. */
struct transport *transport_live_cache(struct transport_live *live);

/* Before each frame: takes over what is built. */
void transport_live_advance(struct transport_live *live);

/* The same at once, without fading: when the builder is done and whoever waits is to see nothing of the way there. */
void transport_live_settle(struct transport_live *live);

#endif
