/* What the blocks see of one tile of the sun's directions (light/cache_direct/sun.c). */
#pragma once

#include "base/err.h"
#include "light/cache_direct/internal.h"

#include <stdatomic.h>

/* What a block sees of a tile: of each packet, the lanes that see all of it, and those that see a part. The latter
 * have a bit for each direction, of packets one after another. */
struct sun_view {
    uint16_t whole[TRANSPORT_PACKETS], parts[TRANSPORT_PACKETS];
    uint16_t known;                             /* bits of the directions that have been traced */
    uint16_t bits[TRANSPORT_PACKETS][SUN_TILE]; /* stored only as far as used */
};

/* The most frequent views; never written. */
extern struct sun_view sun_all_lit, sun_all_dark;

/* All blocks' views of a tile. A view's place is a number, half a pointer; its memory comes from chunks, since there
 * are a million views of some fifty bytes. */
struct sun_views {
    uint32_t *at; /* [blocks]: 0: not looked at yet */
    uint32_t blocks, chunk_count;
    _Atomic uint32_t used;     /* of the chunks, in units of two bytes */
    uint16_t *_Atomic *chunks; /* [chunk_count]; NULL: not needed yet */
    _Atomic uint64_t *bytes;   /* the sum over all tiles, borrowed; sun_views_count moves them to another */
};

/* ERR_NOMEM. */
MUST_CHECK enum err sun_views_begin(struct sun_views *v, uint32_t blocks, _Atomic uint64_t *bytes);
void sun_views_finish(struct sun_views *v); /* NULL is allowed, and what could not begin */

/* From now on they count there. One thread. */
void sun_views_count(struct sun_views *v, _Atomic uint64_t *bytes);

/* NULL: the block has not looked at it yet, or its view is forgotten. Thread: any, one per block. */
struct sun_view *sun_views_get(const struct sun_views *v, uint32_t block);

/* Keeps what a block of so many packets sees, with so many rows of bits. NULL without memory. Thread: any, one per
 * block. */
struct sun_view *sun_views_put(struct sun_views *v, uint32_t block, const struct sun_view *view, uint32_t packets,
                               uint32_t rows);

/* Its memory is free only when that of all is. */
void sun_views_forget(struct sun_views *v, uint32_t block);

/* Its bytes in files, and writes them; returns where they end. Not while views are put. */
size_t sun_views_size(const struct sun_views *v);
uint8_t *sun_views_save(const struct sun_views *v, uint8_t *to);

/* Reads them into empty views of as many blocks. Errors: those of cache_reader_get; ERR_NOMEM. */
MUST_CHECK enum err sun_views_load(struct sun_views *v, const struct transport_block *blocks, struct cache_reader *r,
                                   struct reason *why);
