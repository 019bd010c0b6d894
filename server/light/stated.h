/* The stated error of live pictures that no cache lights yet: an estimate of their relMSE against the truth T, the
 * filter's bias included. New samples S of a picture have independent halves a and b, of which the light P that was
 * shown before knows nothing:
 *
 *     E[(S_a - P) (S_b - P)] = (T - P)^2
 *
 * The product is taken over pixels, relative to x^2 + 1e-2 m^2: x is the picture before, m its mean. A pixel that is
 * too dark by chance would count too much, so that x is at least the mean of the nine pixels around. What samples do
 * not find is not stated, such as light beyond a limit (beside.h). One thread of control. */
#ifndef LIGHT_STATED_H
#define LIGHT_STATED_H

#include "light/relight.h"

struct stated;

/* 12 bytes a pixel; set must outlive it. NULL when out of memory. */
struct stated *stated_create(const struct set *set);
void stated_destroy(struct stated *s); /* NULL is allowed */

/* Other light is shown from now on: the error is unknown. */
void stated_forget(struct stated *s);

/* x: float[height][width][3]. Before, nothing is known of an error. */
void stated_see(struct stated *s, const float *rgb);

/* half: a and b, and more: further light of both, or NULLs; shown: P; all float[packet_count][3][16]. by: what is shown
 * next has so much of the error that the samples tell of. */
void stated_take(struct stated *s, const float *const half[2], const float *const more[2], const float *shown,
                 double by);

/* relMSE; 0: unknown. */
double stated_error(const struct stated *s);

#endif
