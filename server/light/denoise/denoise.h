/* Filters the light at shade points, which it holds as two independent halves (light/denoise/filter.h). A relighter's
 * images are then P(F) plus background and particles: F is the filtered light, P maps points to pixels. Light that
 * the light tracer adds to pixels is not filtered. Thread: one at a time. */
#pragma once

#include "base/err.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/view.h"

#include <stdint.h>

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

/* ---- Splats ---- */

/* Lone bright splats of the light tracer in denoised images (denoise.h), whose filter works on shade points. The
 * excess of a pixel over four times the brightest of the 24 around it, in the sum of its channels, is spread evenly
 * over the 5 x 5 pixels: the image keeps its light, which moves by two pixels at most. Lines and spots of caustics
 * have bright neighbours and stay. */

/* splats: float[height][width][3], of particles only, changed in place. Bits do not depend on the number of threads.
 * ERR_NOMEM: unchanged. Thread: any. */
MUST_CHECK enum err splats_spread(float *splats, uint32_t width, uint32_t height);
