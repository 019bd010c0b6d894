/* Reuses the parts of the last frame that have not changed (last.c). Private to transport/. One frame at a time. */
#pragma once

#include "light/cache_direct/internal.h"

/* Compares the sky of t, split and drawn, and the coefficients of indirect light with the last frame's, and keeps them.
 * True: the frame lights its blocks by way of transport_last_lit and _shone, whose parts without transport_last_work
 * are there, and then calls transport_last_end. False: it lights them whole, because little is the same, or for lack of
 * memory. Thread: the frame's. */
bool transport_last_begin(struct transport *t, const struct transport_indirect *indirect);
void transport_last_end(struct transport *t, bool complete); /* complete: all blocks were lit */
void transport_last_destroy(struct transport_last *l);       /* NULL is allowed */

#define TRANSPORT_LAST_PASSING                                                                                         \
    0x100u /* its cells' light is not kept: compute it elsewhere than in transport_last_lit */

/* Which parts of a block's light this frame must compute: bits of enum transport_work, and TRANSPORT_LAST_PASSING. Call
 * it once per block and frame. Thread: any. */
unsigned transport_last_work(const struct transport *t, uint32_t block);

/* The parts, from a packet on: [][3][PACKET]; valid until transport_destroy. Thread: any, one per block. */
float *transport_last_lit(const struct transport *t, uint32_t packet);
float *transport_last_shone(const struct transport *t, uint32_t packet);

/* Call transport_last_look when a block's transport_last_shone has been computed; transport_last_is_dark: it is all 0.
 * Thread: any, one per block. */
void transport_last_look(const struct transport *t, uint32_t block);
bool transport_last_is_dark(const struct transport *t, uint32_t block);
