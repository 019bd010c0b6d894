/* Filters the light at shade points, which it holds as two independent halves. A relighter's
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

/* ---- The filter ---- */

/* Removes noise from the light at shade points, guided by the G-buffer: an edge-avoiding a-trous wavelet filter
 * [Dammertz et al. 2010], steered by variance as in SVGF [Schied et al. 2017].
 *
 * The light comes as two independent halves a and b of one image, each divided by the surface's reflectance. Every
 * level k replaces a point's light by the weighted mean over 5 x 5 pixels that are 2^k apart, with the weights
 *
 *     w = h(dx) h(dy) * max(0, n.n')^64 * (1 - (d / s)^2)+ * (1 - |y - y'|^2 / (9 (v + v')))+^2
 *
 * h is the B-spline (1, 4, 6, 4, 1) / 16, n the shading normal, d the distance from the point's tangent plane, s twice
 * the width of 2^k pixels there, y the light of the other half and v its variance. Points with other lobes, or seen in
 * a mirror, have weight 0. Where a pixel shows two unlike points (both sides of a leaf, a coat and the surface below,
 * a pane and what it reflects), the second ones are filtered as an image of their own.
 * Since a's weights come from b and b's from a, weights are not correlated with the noise that they average [Rousselle
 * et al. 2012]. The variance is (a - b)^2 / 2, averaged over 7 x 7 points with the first three factors, and then
 * propagated through the levels. Where both halves agree, nothing changes, so sharp sun shadows stay sharp.
 *
 * Finally, a point that is brighter than all 24 pixels around it is clamped to the brightest of them, unless its halves
 * agree within 3 %. A directly seen point in a shadow thinner than the filter, whose halves are both darker than the
 * filtered light y but not black, becomes m + w (y - m): m is the halves' mean, w = min(1, 4 (v / 2) / (m - y)^2) with
 * the averaged v.
 *
 * The filter is biased where light changes within the noise: docs/internals/where-methods-fail.md. */

struct filter;

/* g and v, its camera's view, must outlive the filter. level: the CPU level (base/cpu.h); NULL: the best. Needs 96
 * bytes per pixel, twice that if a pixel shows two unlike points, and 96 for each further shade point.
 * NULL when out of memory. */
struct filter *filter_create(const struct gbuffer *g, const struct view *v, const char *level);
void filter_destroy(struct filter *f); /* NULL is allowed */

/* Writes the filtered mean of two independent estimates with the same expectation to `to`; all
 * float[packet_count][3][16], as direct_shade writes them, `to` none of the halves. Runs on all OpenMP threads; the
 * bits do not depend on their number. Thread: one at a time. */
void filter_run(struct filter *f, const float *const half[2], float *to);
