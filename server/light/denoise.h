/* server/light/denoise.h */
/* Filters the light at shade points, which it holds as two independent halves (filter/filter.h). Part of a relighter,
 * whose pictures are then P(F) plus background and particles: F is the filtered light, P maps points to pixels. Light
 * that the light tracer adds to pixels is not filtered. Thread: one at a time. */
#ifndef LIGHT_DENOISE_H
#define LIGHT_DENOISE_H

#include "light/relight_passes.h"

struct denoiser;

/* Needs the filter's memory and 24 bytes per shade point. set and kernels must outlive it. NULL when out of memory. */
struct denoiser *denoiser_create(const struct set *set, const struct kernels *kernels);
void denoiser_destroy(struct denoiser *d); /* NULL is allowed */

/* The buffer for half k, 0 or 1, of the light: float[packet_count][3][16]. Owned by d. */
float *denoiser_half(struct denoiser *d, int k);

/* Writes the filtered mean of two halves, d's own or others: float[packet_count][3][16]. */
void denoiser_filter(struct denoiser *d, const float *const half[2], float *lo);

/* The passes for half k, with random numbers of its own. The counts in *p are per half. */
void denoiser_passes(const struct picture_passes *p, int k, struct picture_passes *out);

#endif
