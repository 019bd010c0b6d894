/* What the pictures before found out about the light of shade points, for live pictures while their cache is being
 * computed. Camera and scene stand still, so a point's history needs no search: only its light changes.
 *
 * C is the light that the cache gives so far, with the errors of its rough versions; before the first version, 0. A few
 * unbiased samples S of a picture, in two independent halves a and b, correct an estimate B that also has two halves:
 *
 *     B <- B + C - C'                       where the sky changed: by as much as the cache says since the last picture,
 *     B <- B + (1 - w) (S - B)              at the points that this picture samples
 *
 *     w = min(n / (n + 1), V / D),     V = mean (S_a - S_b)^2 / 4,     D = mean (S - B)^2
 *
 * The means, relative as relMSE is, go over GROUP packets. n counts a packet's samples so far: n / (n + 1) makes their
 * plain mean. Before the first, B is C, which has no n, or w is 0. V estimates the squared error of S; D's expectation
 * is V, plus the squared error of B. So what has become wrong, since the sky changed otherwise than the cache says,
 * loses its weight at once: the estimator of [James and Stein 1961] between S and B, as light/still.h has it. Where
 * another version of the cache takes over, C - C' is no change of the sky and is left out.
 *
 * The halves are filtered (light/denoise.h) once all packets have had their turn. The picture's light is what the
 * filter gave, changed with C since then; and C itself as far as it is final.
 *
 * One thread of control. Bits follow from the order of pictures and the progress of the cache: not for lockstep. */
#ifndef LIGHT_HISTORY_H
#define LIGHT_HISTORY_H

#include "light/denoise.h"
#include "light/stated.h"

#define HISTORY_TURNS 8 /* once there is a cache, a picture samples one in so many packets */

struct history;

/* 50 bytes a shade point, 12 a pixel. set and denoiser, whose halves take the samples, must outlive it. NULL when out
 * of memory. */
struct history *history_create(const struct set *set, struct denoiser *denoiser);
void history_destroy(struct history *h); /* NULL is allowed */

/* Begins a picture of light that `key` stands for; another key than the last picture's: all is forgotten. */
void history_begin(struct history *h, uint64_t key);

/* `still`: the sky is the last picture's. Then B is not wrong, and w is n / (n + 1). For pictures without a cache. */
void history_hold(struct history *h, bool still);

/* What the cache gives in this picture: lo, float[packet_count][3][16]. The caller writes `final` and `changed` before,
 * as relight_cache_versions does; packets whose `final` is 1 get no samples. Without a call there is no cache. */
void history_follow(struct history *h, const float *lo);
float *history_final(struct history *h);  /* [packet_count] */
bool *history_changed(struct history *h); /* [packet_count] */

/* The packets whose samples this picture takes, and the number of pictures before, for their random numbers. */
const struct packet_list *history_due(const struct history *h);
uint64_t history_turn(const struct history *h);

/* After history_follow: the packets whose light is for the most part the cache's. */
const struct packet_list *history_beyond(const struct history *h);

/* Takes the samples of the due packets from denoiser_half(.., 0 and 1). Not called if they are incomplete. more: as
 * history_show gets it. scale: light that errors are relative to, float[packet_count][3][16]; NULL: the history's own.
 */
void history_add(struct history *h, const float *const more[2], const float *scale);

/* The error of what is shown (stated.h); unknown in the first picture, and beside a cache. Borrowed. */
struct stated *history_stated(struct history *h);

/* Writes the picture's light to lo, float[packet_count][3][16]. more: two halves of further light of this picture,
 * likewise, that are filtered together with it, where there is no cache; NULL: none. Ends the picture. */
void history_show(struct history *h, const float *const more[2], float *lo);

#endif
