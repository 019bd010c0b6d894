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
#pragma once

#include "light/denoise/denoise.h"

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

/* Takes the samples from denoiser_half(.., 0 and 1). Do not call it if they are incomplete. scale:
 * the light that errors are relative to, float[packet_count][3][16]; NULL: the history's own. */
void accumulation_add(struct accumulation *h, const float *scale);

/* B's halves a and b, for k = 0 and 1: float[packet_count][3][16]. Borrowed. */
const float *accumulation_half(const struct accumulation *h, int k);

/* Writes the image's light to lo, float[packet_count][3][16]. more: two halves of further light of this image, in
 * the same layout, which are filtered together with it; NULL: none. Ends the image. */
void accumulation_show(struct accumulation *h, const float *const more[2], float *lo);
