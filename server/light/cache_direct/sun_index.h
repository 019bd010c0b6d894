/* The index of what points see of the sun, by tiles of directions (light/cache_direct/sun.c). Thread: the frames', or
 * one that holds transport.lock. */
#pragma once

#include "light/cache_direct/sun_corner.h"
#include "light/cache_direct/sun_views.h"

#define SUN_GRID 512 /* 0.1 to 0.2 degrees apart; half as many have three times the error in penumbrae */

struct sun_entry {
    uint32_t key; /* grid, face, row and column of its tile */
    struct sun_tile *tile;
    struct sun_views *views;
    uint64_t used; /* number of the last frame that asked for it */
};

struct sun_index {
    struct sun_entry *entries;
    uint32_t count;
    size_t capacity;
    uint64_t frame;
    _Atomic uint64_t bytes;
    double place[SUN_TILE][PACKET][2]; /* of each lane's look in a direction's square */
    struct sun_corners corners;        /* of frames, */
    struct sun_corners later_corners;  /* and of the questions ahead of them */
};

/* With corners. */
uint64_t sun_index_bytes(const struct transport *t);

/* Whether a number from a file names a tile. */
bool sun_key_is_sound(uint32_t key);

/* The place of the tile's entry, which is added if it is missing. -1 without memory. */
int64_t sun_index_find(struct transport *t, uint32_t key);

/* Frees what frames have not asked for longest, unless since frame `since`, until no more bytes than `most` are left.
 * Not while parts name places. */
void sun_index_make_room(struct transport *t, uint64_t most, uint64_t since);

/* Asks for the directions whose squares texel `at` of n x n meets, and spreads its light over them; rgb NULL: none.
 * ERR_NOMEM. */
MUST_CHECK enum err sun_spread_texel(struct transport *t, struct sun_parts *to, uint32_t n, uint32_t grid, uint32_t at,
                                     const float *rgb);

/* The block's view of a part's tile. Without memory to keep it, *own. Thread: any, one per block. */
const struct sun_view *sun_look(const struct transport *t, uint32_t block, const struct sun_part *p,
                                struct sun_view *own, uint64_t *rays);
