/* Corners that up to four tiles of the sun's directions share, and what points see of them (light/cache_direct/sun.c).
 * They are kept while frames ask for their tiles. Thread: one; of sun_corner_look any, for other packets. */
#pragma once

#include "light/cache_direct/internal.h"

struct sun_corner;

struct sun_corners { /* zeroed: none */
    struct sun_corner **at;
    size_t count, capacity;
    uint64_t frame, bytes;
};

/* The corner at a row and column of tiles. NULL without memory. */
struct sun_corner *sun_corner_find(struct sun_corners *x, const struct transport *t, uint32_t grid, uint32_t face,
                                   uint32_t row, uint32_t column);

/* Adds which lanes of a packet see the sky at the corner, and which do not, to *view, and the rays that it took. */
void sun_corner_look(const struct transport *t, struct sun_corner *c, uint32_t packet, struct transport_view *view,
                     uint64_t *rays);

/* A frame begins: frees the corners that none of the last `kept` has asked for. */
void sun_corners_frame(struct sun_corners *x, uint64_t kept);
void sun_corners_forget(struct sun_corners *x, uint32_t first, uint32_t packets); /* what these packets see */
void sun_corners_finish(struct sun_corners *x);
