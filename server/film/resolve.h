/* server/film/resolve.h */
/* A pixel is the sum of its parts: weight * Lo(shade point) over its entries, weight * Lenv(direction) over its
 * escapes (e NULL: without those). lo: float[packet_count][3][16] as direct_shade writes it. rgb:
 * float[height][width][3], every pixel is written. Runs on all OpenMP threads; the result does not depend on their
 * number. */
#ifndef FILM_RESOLVE_H
#define FILM_RESOLVE_H

#include "environment.h"
#include "gbuffer.h"

void resolve_pixels(const struct gbuffer *g, const float *lo, const struct environment *e, float *rgb);

/* uint8_t[height][width]: 1 where a pixel holds a shade point, as the relative error counts them. */
void resolve_mask(const struct gbuffer *g, uint8_t *mask);

#endif
