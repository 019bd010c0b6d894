/* Keeps what earlier live pictures measured of the light at shade points while the cache is being computed. Camera and
 * scene are static, so a point's history needs no reprojection: only its light changes.
 *
 * C is the light by the cache so far, with the errors of its rough versions; 0 before the first version. A few unbiased
 * samples S of a picture, in two independent halves a and b, correct an estimate B that also has two halves:
 *
 *     B <- B + C - C'                       where the sky changed: by as much as the cache says since the last picture,
 *     B <- B + (1 - w) (S - B)              at the points that this picture samples
 *
 *     w = min(n / (n + 1), V / D),     V = mean (S_a - S_b)^2 / 4,     D = mean (S - B)^2
 *
 * The means, relative as relMSE is, are over GROUP packets. n counts a packet's samples so far: n / (n + 1) gives their
 * plain mean. Before the first sample, B is C, which has no n, or w is 0. V estimates the squared error of S; D's
 * expectation is V plus the squared error of B. A history that has become wrong, because the sky changed in another way
 * than the cache predicts, thus loses its weight at once: the estimator of [James and Stein 1961] between S and B, as
 * in light/frame/still.h. When a new version of the cache takes over, C - C' is not a change of the sky and is omitted.
 * Where C passes B, as where C misplaces the edge of a moving shadow, the difference between both has ended: B then
 * stays between B, B times the picture's mean change of C, and C. Otherwise it would end below 0, or above any light.
 *
 * The halves are filtered (light/denoise/denoise.h) once every packet was sampled. Beside a cache and under a still
 * sky, the displayed light moves to the filter's output in equal steps until the next one, so that it does not jump. It
 * also changes with C, and is C itself as far as that is final. One thread of control. The bits depend on the order of
 * pictures and the progress of the cache, so lockstep renders must not use it. */
#pragma once

#include "light/denoise/denoise.h"

#define HISTORY_TURNS 8 /* once a cache exists, a picture samples one packet in so many */

/* Without a cache, the displayed light can glide to the filter's output in so many pictures: the share of the way is
 * x^2 (3 - 2 x) after x of them, so that it neither jumps nor turns at once. */
#define HISTORY_GLIDE 16

struct history;

/* Needs 63 bytes per shade point and 28 per pixel. g and denoiser, whose halves take the samples, must outlive it.
 * NULL when out of memory. */
struct history *history_create(const struct gbuffer *g, struct denoiser *denoiser);
void history_destroy(struct history *h); /* NULL is allowed */

/* Begins a picture with the light that `key` identifies; a key other than the last picture's discards the history.
 * glides: without a cache, the displayed light moves to this picture's in HISTORY_GLIDE steps, of which history_show
 * takes the first, unless light of another key was displayed before. Else a glide ends. */
void history_begin(struct history *h, uint64_t key, bool glides);

/* `still`: the sky is the last picture's; B is then still correct, and w is n / (n + 1). Unless it glides, the
 * displayed light then moves a quarter of the way to the filter's output. Without a cache only. */
void history_hold(struct history *h, bool still);

/* The steps that are left. */
unsigned history_glides(const struct history *h);

/* Instead of history_add and history_show, while steps are left: takes the next one, and writes the light to lo, as
 * history_show does. */
void history_glide(struct history *h, float *lo);

/* Takes the cache's light for this picture, lo, float[packet_count][3][16]. The caller writes `final` and `changed`
 * before, as relight_cache_versions does; packets whose `final` is 1 get no samples. Without this call the picture has
 * no cache. */
void history_follow(struct history *h, const float *lo);
float *history_final(struct history *h);  /* [packet_count] */
bool *history_changed(struct history *h); /* [packet_count] */

/* The packets that this picture samples, and the number of pictures before, for their random numbers. */
const struct packet_list *history_due(const struct history *h);
uint64_t history_turn(const struct history *h);

/* After history_follow: the packets whose light comes mostly from the cache. */
const struct packet_list *history_beyond(const struct history *h);

/* Takes the samples of the due packets from denoiser_half(.., 0 and 1). Do not call it if they are incomplete. scale:
 * the light that errors are relative to, float[packet_count][3][16]; NULL: the history's own. */
void history_add(struct history *h, const float *scale);

/* B's halves a and b, for k = 0 and 1: float[packet_count][3][16]. Borrowed. */
const float *history_half(const struct history *h, int k);

/* Writes the picture's light to lo, float[packet_count][3][16]. more: two halves of further light of this picture, in
 * the same layout, which are filtered together with it if no cache exists; NULL: none. Ends the picture. */
void history_show(struct history *h, const float *const more[2], float *lo);
