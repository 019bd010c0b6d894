/* Daylight glare probability [Wienold and Christoffersen 2006]:
 *     DGP = 5.87e-5 Ev + 9.18e-2 log10(1 + sum over sources  Ls^2 ws / (Ev^1.87 P^2)) + 0.16
 * with the vertical illuminance Ev at the eye, and the luminance Ls, solid angle ws and position index P of each source
 * of glare: connected pixels above a luminance. Thread: any, on separate outputs. */
#pragma once

#include "base/err.h"

#include <stdint.h>

#define GLARE_THRESHOLD 2000.0 /* cd/m^2, evalglare's default */

struct glare_desc {
    uint32_t width, height;
    const float *luminance;      /* [height][width], cd/m^2 */
    const float *solid_angle;    /* [height][width], sr; 0 outside the view */
    const float (*direction)[3]; /* [height][width], unit, from the eye */
    double ahead[3], up[3];      /* unit: the line of sight, and up, perpendicular to it */
};

struct glare {
    double vertical_lux; /* Ev, from what the image shows */
    double dgp;
    uint32_t sources;
    double source_sr;  /* solid angle of all sources */
    double source_lum; /* their mean luminance, cd/m^2 */
};

/* ERR_NOMEM. */
MUST_CHECK enum err glare_measure(const struct glare_desc *d, struct glare *out);

/* The position index of a direction: Guth's above the line of sight, Iwata's below [Wienold and Christoffersen 2006].
 * At least 1 and at most 16. */
double glare_position_index(const double w[3], const double ahead[3], const double up[3]);

/* The formula, without its sum: of sources that add up to `sum`. */
double glare_probability(double vertical_lux, double sum);
