/* Compresses a group of blocks to T = U W V with a common V. Private to the cache of indirect light. Thread: one per
 * workspace. */
#pragma once

#include "light/cache_indirect/internal.h"

struct indirect_workspace;

struct indirect_workspace *indirect_workspace_create(uint32_t k); /* k: size of the basis; NULL when out of memory */
void indirect_workspace_destroy(struct indirect_workspace *w);    /* NULL is allowed */

/* Compresses one group: call begin, then for each row all of its blocks in order, followed by that row's end. blocks:
 * the group's. t: float[points][3 k], destroyed. scale: float[points], above 0, the weight of a point's error. least:
 * squared error that a rank must remove for each point, weighted. ERR_NOMEM. */
void indirect_compress_begin(struct indirect_workspace *w);
void indirect_compress_block(struct indirect_workspace *w, uint32_t slot, uint32_t row, uint32_t points, float *t,
                             const float *scale, double least);
MUST_CHECK enum err indirect_compress_end(struct indirect_workspace *w, struct indirect_group *g,
                                          struct indirect_block *blocks, uint32_t row, double least);
