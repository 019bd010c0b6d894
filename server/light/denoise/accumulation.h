/* Keeps what earlier live images measured of the light at shade points while the cache is being computed. Camera and
 * scene are static, so a point's history needs no reprojection: only its light changes.
 *
 * C is the light by the cache so far, with the errors of its rough versions; 0 before the first version. A few unbiased
 * samples S of an image, in two independent halves a and b, correct an estimate B that also has two halves:
 *
 *     B <- B + C - C'                       where the sky changed: by as much as the cache says since the last image,
 *     B <- B + (1 - w) (S - B)              at the points that this image samples
 *
 *     w = min(n / (n + 1), V / D),     V = mean (S_a - S_b)^2 / 4,     D = mean (S - B)^2
 *
 * The means, relative as relMSE is, are over GROUP packets. n counts a packet's samples so far: n / (n + 1) gives their
 * plain mean. Before the first sample, B is C, which has no n, or w is 0. V estimates the squared error of S; D's
 * expectation is V plus the squared error of B. A history that has become wrong, because the sky changed in another way
 * than the cache predicts, thus loses its weight at once: the estimator of [James and Stein 1961] between S and B, as
 * in light/frame/refine.h. When a new version of the cache takes over, C - C' is not a change of the sky and is
 * omitted. Where C passes B, as where C misplaces the edge of a moving shadow, the difference between both has ended: B
 * then stays between B, B times the image's mean change of C, and C. Otherwise it would end below 0, or above any
 * light.
 *
 * The halves are filtered (light/denoise/denoise.h) once every packet was sampled. Beside a cache and under a still
 * sky, the displayed light moves to the filter's output in equal steps until the next one, so that it does not jump. It
 * also changes with C, and is C itself as far as that is final. One thread of control. The bits depend on the order of
 * images and the progress of the cache, so lockstep renders must not use it. */
#pragma once

#include "light/denoise/denoise.h"

#define ACCUMULATION_TURNS 8 /* once a cache exists, an image samples one packet in so many */

/* Without a cache, the displayed light can glide to the filter's output in so many images: the share of the way is
 * x^2 (3 - 2 x) after x of them, so that it neither jumps nor turns at once. */
#define ACCUMULATION_GLIDE 16

struct accumulation;

/* Needs 63 bytes per shade point and 28 per pixel. g and denoiser, whose halves take the samples, must outlive it.
 * NULL when out of memory. */
struct accumulation *accumulation_create(const struct gbuffer *g, struct denoiser *denoiser);
void accumulation_destroy(struct accumulation *h); /* NULL is allowed */

/* Begins an image with the light that `key` identifies; a key other than the last image's discards the history.
 * glides: without a cache, the displayed light moves to this image's in ACCUMULATION_GLIDE steps, of which
 * accumulation_show takes the first, unless light of another key was displayed before. Else a glide ends. */
void accumulation_begin(struct accumulation *h, uint64_t key, bool glides);

/* `still`: the sky is the last image's; B is then still correct, and w is n / (n + 1). Unless it glides, the
 * displayed light then moves a quarter of the way to the filter's output. Without a cache only. */
void accumulation_hold(struct accumulation *h, bool still);

/* The steps that are left. */
unsigned accumulation_glides(const struct accumulation *h);

/* Instead of accumulation_add and accumulation_show, while steps are left: takes the next one, and writes the light to
 * lo, as accumulation_show does. */
void accumulation_glide(struct accumulation *h, float *lo);

/* Takes the cache's light for this image, lo, float[packet_count][3][16]. The caller writes `final` and `changed`
 * before, as relight_cache_versions does; packets whose `final` is 1 get no samples. Without this call the image has
 * no cache. */
void accumulation_follow(struct accumulation *h, const float *lo);
float *accumulation_final(struct accumulation *h);  /* [packet_count] */
bool *accumulation_changed(struct accumulation *h); /* [packet_count] */

/* The packets that this image samples, and the number of images before, for their random numbers. */
const struct packet_list *accumulation_due(const struct accumulation *h);
uint64_t accumulation_turn(const struct accumulation *h);

/* After accumulation_follow: the packets whose light comes mostly from the cache. */
const struct packet_list *accumulation_beyond(const struct accumulation *h);

/* Takes the samples of the due packets from denoiser_half(.., 0 and 1). Do not call it if they are incomplete. scale:
 * the light that errors are relative to, float[packet_count][3][16]; NULL: the history's own. */
void accumulation_add(struct accumulation *h, const float *scale);

/* B's halves a and b, for k = 0 and 1: float[packet_count][3][16]. Borrowed. */
const float *accumulation_half(const struct accumulation *h, int k);

/* Writes the image's light to lo, float[packet_count][3][16]. more: two halves of further light of this image, in
 * the same layout, which are filtered together with it if no cache exists; NULL: none. Ends the image. */
void accumulation_show(struct accumulation *h, const float *const more[2], float *lo);
