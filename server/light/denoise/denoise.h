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

/* The same in parts (filter_part). */
uint32_t denoiser_parts(const struct denoiser *d);
void denoiser_filter_part(struct denoiser *d, uint32_t part, const float *const half[2], float *lo);

/* How often its halves were asked for and parts run: another number means that others have used it meanwhile. */
uint64_t denoiser_uses(const struct denoiser *d);

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

/* The same in parts, one after another with the same halves; the last writes. */
uint32_t filter_parts(const struct filter *f);
void filter_part(struct filter *f, uint32_t part, const float *const half[2], float *to);

/* ---- Over time ---- */

/* Keeps what earlier live images measured of the light at shade points while there is no cache yet. Camera and scene
 * are static, so a point's history needs no reprojection: only its light changes.
 *
 * The few unbiased samples S of an image, in two independent halves a and b, improve an estimate B that also has two
 * halves:
 *
 *     B <- B + (1 - w) (S - B),     w = min(n / (n + 1), V / D)
 *
 *     V = mean (S_a - S_b)^2 / 4,     D = mean (S - B)^2
 *
 * The means, relative as relMSE is, are over GROUP packets. n counts a packet's samples so far: n / (n + 1) gives their
 * plain mean; before the first one w is 0. V estimates the squared error of S; D's expectation is V plus the squared
 * error of B. A history that has become wrong, because the sky changed, thus loses its weight at once: the estimator of
 * [James and Stein 1961] between S and B, as in light/frame/refine.h.
 *
 * The halves are filtered (light/denoise/denoise.h). Under a still sky the displayed light moves to the filter's output
 * in steps, so that it does not jump. One thread of control. The bits depend on the order of images, so lockstep
 * renders must not use it. */

/* The displayed light can glide to the filter's output in so many images: the share of the way is x^2 (3 - 2 x) after
 * x of them, so that it neither jumps nor turns at once. In another number of images it is x: one such glide follows
 * another without a stop. */
#define ACCUMULATION_GLIDE 16

/* A quarter of the way, if each image begins such a glide: under a still sky, whose light only becomes more exact. */
#define ACCUMULATION_STEADY 4

struct accumulation;

/* Needs 51 bytes per shade point and 28 per pixel. g and denoiser, whose halves take the samples, must outlive it.
 * NULL when out of memory. */
struct accumulation *accumulation_create(const struct gbuffer *g, struct denoiser *denoiser);
void accumulation_destroy(struct accumulation *h); /* NULL is allowed */

/* Begins an image with the light that `key` identifies; a key other than the last image's discards the history.
 * steps: the displayed light moves to this image's in so many, of which accumulation_show takes the first, unless light
 * of another key was displayed before. 0: a glide ends. */
void accumulation_begin(struct accumulation *h, uint64_t key, unsigned steps);

/* `still`: the sky is the last image's; B is then still correct, and w is n / (n + 1). */
void accumulation_hold(struct accumulation *h, bool still);

/* The steps that are left. */
unsigned accumulation_glides(const struct accumulation *h);

/* Instead of accumulation_add and accumulation_show: takes the next step, if one is left, and writes the light to lo,
 * as accumulation_show does. */
void accumulation_glide(struct accumulation *h, float *lo);

/* Instead of accumulation_add and accumulation_show, once the cache makes images of a still sky: what is displayed
 * glides from the history's light to lo, which becomes that. last: the cache is complete; until then the glide does
 * not end, so that its parts appear without a jump. Returns the steps that are left; after the last one lo stays. */
unsigned accumulation_leave(struct accumulation *h, bool last, float *lo);

/* The number of images before, for their random numbers. */
uint64_t accumulation_turn(const struct accumulation *h);

/* Takes the samples, two halves of float[packet_count][3][16]; NULL: those of denoiser_half(.., 0 and 1). Do not call
 * it if they are incomplete. scale: the light that errors are relative to, float[packet_count][3][16]; NULL: the
 * history's own. */
void accumulation_add(struct accumulation *h, const float *const samples[2], const float *scale);

/* B's halves a and b, for k = 0 and 1: float[packet_count][3][16]. Borrowed. */
const float *accumulation_half(const struct accumulation *h, int k);

/* Writes the image's light to lo, float[packet_count][3][16]. Ends the image. */
void accumulation_show(struct accumulation *h, float *lo);

/* The same with two halves of further light of this image, in the same layout, which are filtered together with it; in
 * denoiser_parts, of which the last writes and ends the image. denoiser_uses tells whether others have used the
 * denoiser between two: then begin again with the first. */
void accumulation_show_part(struct accumulation *h, uint32_t part, const float *const more[2], float *lo);
