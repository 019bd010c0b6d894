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
 * so x is at least a quarter of the mean over 3 x 3 pixels. A measured factor (STATED_PER) makes up for the rest.
 *
 * M tells of the picture before, with much noise. The noise V of any picture, from its two filtered halves, has little.
 * Error and noise fall together, so a picture's error is its V times the ratio of the measurements so far, m and v,
 * and of the ratio expected of any scene, R +- d, each by its certainty:
 *
 *     E = V max(1, (d^2 m v + R var(m)) / (d^2 v^2 + var(m))),    m = sum(q M),    v = sum(q V),    q = KEPT^age
 *
 * The estimate excludes light that the samples cannot find, such as light beyond a limit (light/beside.h). One thread
 * of control. */
#ifndef HISTORY_STATED_H
#define HISTORY_STATED_H

#include "scene/gbuffer.h"

/* docs/internals/decisions.md has the figures. */
#define STATED_PER 1.2       /* true over measured M */
#define STATED_RATIO 6.0     /* R: error over noise, and */
#define STATED_RATIO_OFF 5.0 /* d: its standard deviation between scenes and skies */

struct stated;

/* Needs 28 bytes per pixel; g must outlive it. NULL when out of memory. */
struct stated *stated_create(const struct gbuffer *g);
void stated_destroy(struct stated *s); /* NULL is allowed */

/* Call it when other light is shown: the error becomes unknown. */
void stated_forget(struct stated *s);

struct stated_light {             /* all float[packet_count][3][16] */
    const float *shown, *half[2]; /* P and what was filtered for it */
    const float *apart;           /* half the difference of the filtered halves */
};

/* Takes the displayed picture: float[height][width][3], P and other light. */
void stated_see(struct stated *s, const float *rgb, const struct stated_light *light);

/* Takes new samples. half: a and b, and more: further light of both halves, or NULLs; shown: P of the last picture
 * seen; all float[packet_count][3][16]. Without such a picture it does nothing. */
void stated_take(struct stated *s, const float *const half[2], const float *const more[2], const float *shown);

/* relMSE of the last picture seen; 0: unknown. */
double stated_error(const struct stated *s);

#endif
