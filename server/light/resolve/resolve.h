/* Resolves shade points to pixels. A pixel is the sum of its parts: weight * Lo(shade point) over its entries, weight *
 * Lenv(direction) over its escapes (e NULL: without those). lo: float[packet_count][3][16] as direct_shade writes it.
 * Writes every pixel of rgb, float[height][width][3]. Runs on all OpenMP threads; the result does not depend on their
 * number. */
#pragma once

#include "scene/geometry/gbuffer.h"
#include "sky/tables/environment.h"

/* Stateless. Thread: one at a time. */
void resolve_pixels(const struct gbuffer *g, const float *lo, const struct environment *e, float *rgb);

/* Gives the same bits as resolve_pixels, faster from the second frame on. While layout, size and rotation of the sky
 * stay the same, it caches where escapes look up the sky (lookup_place.h, 16 bytes per escape), which pixels are a
 * single shade point or escape (4 bytes per pixel), and the entries of the others (8 bytes per pixel and 16 per entry).
 * It belongs to one G-buffer, which must outlive it and not change, and to one thread at a time. When out of memory it
 * caches nothing, which is not an error. */
struct resolver;

struct resolver *resolver_create(const struct gbuffer *g); /* NULL when out of memory */
void resolver_destroy(struct resolver *r);                 /* NULL is allowed */
/* As resolve_pixels. */
void resolver_pixels(struct resolver *r, const float *lo, const struct environment *e, float *rgb);

/* uint8_t[height][width]: 1 where a pixel holds a shade point, as the relative error counts them. */
void resolve_mask(const struct gbuffer *g, uint8_t *mask);
