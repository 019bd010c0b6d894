/* Filters the light at shade points, which it holds as two independent halves (light/denoise/filter.h). A relighter's
 * images are then P(F) plus background and particles: F is the filtered light, P maps points to pixels. Light that
 * the light tracer adds to pixels is not filtered. Thread: one at a time. */
#pragma once

#include "scene/geometry/gbuffer.h"
#include "scene/geometry/view.h"

struct denoiser;

/* Needs the filter's memory and 24 bytes per shade point. g, v and level are as for filter_create. NULL when out of
 * memory. */
struct denoiser *denoiser_create(const struct gbuffer *g, const struct view *v, const char *level);
void denoiser_destroy(struct denoiser *d); /* NULL is allowed */

/* The buffer for half k, 0 or 1, of the light: float[packet_count][3][16]. Owned by d. */
float *denoiser_half(struct denoiser *d, int k);

/* Writes the filtered mean of two halves, d's own or others, to lo; all float[packet_count][3][16]. lo is none of the
 * halves. */
void denoiser_filter(struct denoiser *d, const float *const half[2], float *lo);
