/* server/film/film.h */
/* From radiance to picture: the sum of a pixel's parts, exposure, tone curve, 8-bit sRGB.
 * Float pictures are float[height][width][3], linear Rec.709 radiance, top row first. */
#ifndef FILM_FILM_H
#define FILM_FILM_H

#include "err.h"

#include <stdint.h>

enum tone_curve {
    TONE_FILMIC,   /* toe and shoulder, the default */
    TONE_REINHARD, /* x (1 + x / white^2) / (1 + x) on luminance [Reinhard 2002, Eq. 4] */
    TONE_LINEAR,   /* clipped at 1 */
};

MUST_CHECK enum err tone_parse(const char *name, enum tone_curve *out, struct reason *why);
const char *tone_name(enum tone_curve curve);

/* Exposure that follows the picture: the log-average luminance is brought to the key of 0.18 [Reinhard 2002, Eq. 1]
 * and approached by a fixed share per frame, in stops, so that a script and a stream step alike: no clock.
 * Zeroed memory with desc set by exposure_init is ready; the first frame is taken at once. */
struct exposure {
    double key;       /* 0.18 */
    double adapt;     /* share of the way covered per frame, 0..1; 1: at once */
    double bias_stops; /* the user's wish on top */
    double log2_gain; /* present gain, stops */
    int started;
};

void exposure_init(struct exposure *e);

/* Steps by one frame and returns the gain (a factor). Black pictures keep the gain; pixels of luminance 0 do not
 * count; all sums in double and in fixed order: the same picture gives the same gain at any thread count. */
double exposure_step(struct exposure *e, const float *rgb, uint32_t width, uint32_t height);

/* gain * rgb through the curve and the sRGB transfer function [IEC 61966-2-1] into uint8_t[height][width][3].
 * No input makes it fail: NaN becomes 0, infinity white. */
void tone_map(const float *rgb, uint32_t width, uint32_t height, double gain, enum tone_curve curve, uint8_t *out);

#endif
