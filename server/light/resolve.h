/* server/light/resolve.h */
/* A pixel is the sum of its parts: weight * Lo(shade point) over its entries, weight * Lenv(direction) over its
 * escapes (e NULL: without those). lo: float[packet_count][3][16] as direct_shade writes it. rgb:
 * float[height][width][3], every pixel is written. Runs on all OpenMP threads; the result does not depend on their
 * number. */
#ifndef LIGHT_RESOLVE_H
#define LIGHT_RESOLVE_H

#include "env/environment.h"
#include "scene/gbuffer.h"

void resolve_pixels(const struct gbuffer *g, const float *lo, const struct environment *e, float *rgb);

/* The same picture to the bit, in less time from the second frame on. Kept are, as long as layout, size and rotation of
 * the sky stay, where escapes look it up (lookup_place.h, 12 bytes an escape), and which pixels are but one shade point
 * or one escape (4 bytes a pixel), and what the others are made of (8 bytes a pixel and 16 an entry of it). It belongs
 * to one G-buffer, which must outlive it and not change, and to one thread at a time. Out of memory nothing is kept,
 * and that is no error. */
struct resolver;

struct resolver *resolver_create(const struct gbuffer *g); /* NULL when out of memory */
void resolver_destroy(struct resolver *r);                 /* NULL is allowed */
void resolver_pixels(struct resolver *r, const float *lo, const struct environment *e, float *rgb);

/* uint8_t[height][width]: 1 where a pixel holds a shade point, as the relative error counts them. */
void resolve_mask(const struct gbuffer *g, uint8_t *mask);

#endif
