/* Smooths the noise of the gather over a group of blocks. Private to the cache of indirect light. Thread: one per
 * smoother.
 */
#pragma once

#include "light/cache_indirect/internal.h"

#define INDIRECT_GROUP_POINTS (INDIRECT_GROUP * TRANSPORT_POINTS)

struct indirect_smoother { /* a group's points, 64 per block */
    float at[3][INDIRECT_GROUP_POINTS], normal[3][INDIRECT_GROUP_POINTS];
    float near[INDIRECT_GROUP_POINTS]; /* harmonic mean distance to surrounding surfaces, m, above 0 */
    bool used[INDIRECT_GROUP_POINTS];
    float weights[TRANSPORT_POINTS][INDIRECT_GROUP_POINTS];
};

struct indirect_smoother *indirect_smoother_create(void);    /* NULL when out of memory */
void indirect_smoother_destroy(struct indirect_smoother *s); /* NULL is allowed */

/* from, to: float[64 blocks][wide], no overlap; unused points are ignored. Each block is averaged with `reach` blocks
 * on either side. */
void indirect_smooth(struct indirect_smoother *s, uint32_t blocks, uint32_t reach, uint32_t wide, const float *from,
                   float *to);

/* The sum of the weights, 0..1, of all points that are averaged with point p, from a quarter of them; blocks and reach
 * as in indirect_smooth. */
float indirect_alike(const struct indirect_smoother *s, uint32_t blocks, uint32_t reach, uint32_t p);
