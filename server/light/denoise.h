/* server/light/denoise.h */
/* The light at shade points as two independent halves, which are filtered (filter/filter.h). Part of a relighter, whose
 * pictures are then P(F) plus background and particles: F is the filtered light, P goes from points to pixels. What the
 * light tracer adds to pixels is not filtered. One thread of control. */
#ifndef LIGHT_DENOISE_H
#define LIGHT_DENOISE_H

#include "light/relight_passes.h"

struct denoiser;

/* The filter and 24 bytes a shade point. set and kernels must outlive it. NULL when out of memory. */
struct denoiser *denoiser_create(const struct set *set, const struct kernels *kernels);
void denoiser_destroy(struct denoiser *d); /* NULL is allowed */

/* Where half k, 0 or 1, of the light goes: float[packet_count][3][16]. Owned by d. */
float *denoiser_half(struct denoiser *d, int k);

/* Writes the filtered mean of two halves, d's own or others: float[packet_count][3][16]. */
void denoiser_filter(struct denoiser *d, const float *const half[2], float *lo);

/* The passes of half k, with random numbers of its own. The counts of *p are those of one half. */
void denoiser_passes(const struct picture_passes *p, int k, struct picture_passes *out);

#endif
