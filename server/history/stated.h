/* The stated error of live pictures before a cache exists: an estimate of their relMSE against the truth T, including
 * the filter's bias. New samples S of a picture have independent halves a and b, which are also independent of the
 * previously displayed light P:
 *
 *     E[(S_a - P) (S_b - P)] = (T - P)^2
 *
 * The product is taken over pixels, relative to x^2 + 1e-2 m^2: x is the previous picture, m its mean. A pixel that is
 * too dark by chance would count too much, so x is at least a quarter of the mean over 3 x 3 pixels. Pixels that are
 * too bright count too little, which a measured factor (STATED_PER) makes up for. As few samples measure with much
 * noise, the last few measurements M count:
 *
 *     E <- w^(1/2) (E + (STATED_PER M - E) / min(k, 4)),    k = 1, 2, ...
 *
 * w is the share of the old light in the new: the variance has w of the old one, the bias stays. The estimate excludes
 * light that the samples cannot find, such as light beyond a limit (beside.h). One thread of control. */
#ifndef HISTORY_STATED_H
#define HISTORY_STATED_H

#include "scene/gbuffer.h"

#define STATED_PER 1.35 /* true over measured: 1.0 to 2.3 (docs/internals/decisions.md) */

struct stated;

/* Needs 12 bytes per pixel; g must outlive it. NULL when out of memory. */
struct stated *stated_create(const struct gbuffer *g);
void stated_destroy(struct stated *s); /* NULL is allowed */

/* Call it when other light is shown: the error becomes unknown. */
void stated_forget(struct stated *s);

/* Takes the displayed picture x: float[height][width][3]. The error is unknown before the first call. */
void stated_see(struct stated *s, const float *rgb);

/* half: a and b, and more: further light of both halves, or NULLs; shown: P; all float[packet_count][3][16]. by: w. */
void stated_take(struct stated *s, const float *const half[2], const float *const more[2], const float *shown,
                 double by);

/* relMSE; 0: unknown. */
double stated_error(const struct stated *s);

#endif
