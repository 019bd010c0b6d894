/* The stated error of live pictures before a cache exists: an estimate of their relMSE against the truth T, including
 * the filter's bias. New samples S of a picture have independent halves a and b, which are also independent of the
 * previously displayed light P:
 *
 *     E[(S_a - P) (S_b - P)] = (T - P)^2
 *
 * The product M is taken over pixels, relative to x^2 + 1e-2 m^2: x is about T, m the mean of the picture with P. Where
 * the filter took a thin shadow for noise, P is several times T, and the error relative to P is a small part of that
 * relative to T. So x is the picture, but at a pixel whose halves before the filter are both darker than P by more than
 * two standard errors,
 *
 *     x = h + w (P - h),     w = 4 noise / (P - h)^2
 *
 * h is the halves' mean, and the noise that of 3 x 3 pixels. A pixel that is too dark by chance would count too much,
 * so x is at least a quarter of the mean over 3 x 3 pixels.
 *
 * Packets of one set (packet_set) have the same light samples, which tint them alike in each half: the product of two
 * tints is no error, but it is the same in a sixteenth of the picture. So a half loses what the points of its set and
 * of one of six directions of the normal have in common, beyond those of all sets with that direction. What is left of
 * such noise shows in the means over each set, whose scatter gives the variance of M.
 *
 * M tells of the picture before, with much noise. Picture k of a still sky has 2 k - 1 times the samples of the first
 * half picture, and its error falls with that number to the power STATED_FALL. So all measurements, the j-th of picture
 * j, estimate one constant, and picture k's error is
 *
 *     E = (2 k - 1)^-FALL  sum(q M_j (2 j - 1)^FALL) / sum(q),     q = KEPT^age
 *
 * A picture whose E has a standard error above STATED_DOUBT E states nothing. The estimate excludes light that the
 * samples cannot find, such as light beyond a limit (light/beside.h). One thread of control. */
#ifndef HISTORY_STATED_H
#define HISTORY_STATED_H

#include "scene/gbuffer.h"

/* docs/internals/decisions.md has the figures. */
#define STATED_FALL 0.6
#define STATED_DOUBT 0.25

struct stated;

/* Needs 28 bytes per pixel and 1 per shade point; g must outlive it. NULL when out of memory. */
struct stated *stated_create(const struct gbuffer *g);
void stated_destroy(struct stated *s); /* NULL is allowed */

/* Call it when other light is shown: the error becomes unknown. */
void stated_forget(struct stated *s);

struct stated_light {             /* all float[packet_count][3][16] */
    const float *shown, *half[2]; /* P and what was filtered for it */
};

/* Takes the displayed picture: float[height][width][3], P and other light. */
void stated_see(struct stated *s, const float *rgb, const struct stated_light *light);

/* Takes new samples. half: a and b, and more: further light of both halves, or NULLs; shown: P of the last picture
 * seen; all float[packet_count][3][16]. Without such a picture it does nothing. */
void stated_take(struct stated *s, const float *const half[2], const float *const more[2], const float *shown);

/* relMSE of the last picture seen; 0: unknown. */
double stated_error(const struct stated *s);

#endif
