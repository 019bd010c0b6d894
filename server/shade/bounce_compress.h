/* The cache of interreflection: T = U W V of the blocks of a group, V theirs in common. One thread's. */
#ifndef SHADE_BOUNCE_COMPRESS_H
#define SHADE_BOUNCE_COMPRESS_H

#include "bounce_parts.h"

struct bounce_workspace;

struct bounce_workspace *bounce_workspace_create(uint32_t k); /* coefficients of the basis; NULL when out of memory */
void bounce_workspace_destroy(struct bounce_workspace *w);    /* NULL is allowed */

/* A group: begun, each row of its blocks in their order, and then each row's piece. blocks: the group's. t: [points][3
 * k], is destroyed. scale[points]: what a point's error counts, above 0. least: squares that a rank must bring
 * for each point, in these terms. ERR_NOMEM. */
void bounce_compress_begin(struct bounce_workspace *w);
void bounce_compress_block(struct bounce_workspace *w, uint32_t slot, uint32_t row, uint32_t points, float *t,
                           const float *scale, double least);
MUST_CHECK enum err bounce_compress_end(struct bounce_workspace *w, struct bounce_group *g, struct bounce_block *blocks,
                                        uint32_t row, double least);

#endif
