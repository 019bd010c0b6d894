/* Decoded images of any layout as lat-long texels. Private to this room. Thread: one per
 * environment; OpenMP is used. */
#pragma once

#include "sky/tables/environment.h"

/* The layout of e's image, by choice, file or shape, and the size of the lat-long image: its own, or one with as many
 * texels. Another layout's tables are built, from which latlong_copy looks it up. Errors of layout_guess, layout_fits
 * and environment_rebuild. */
MUST_CHECK enum err latlong_size(struct environment *e, enum layout *layout, uint32_t *width, uint32_t *height,
                                 struct reason *why);

/* The texels, float[height][width][3], top row first: bit for bit if the image is lat-long, else looked up, as the
 * background is, at nine places of each. */
void latlong_copy(const struct environment *e, enum layout layout, uint32_t width, uint32_t height, float *out);
