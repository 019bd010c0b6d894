/* server/film/film.h */
/* From radiance to picture: the sum of a pixel's parts, exposure, tone curve, 8-bit sRGB.
 * Float pictures are float[height][width][3], linear Rec.709 radiance, top row first. */
#ifndef FILM_FILM_H
#define FILM_FILM_H

#include "err.h"

#include <stdbool.h>
#include <stdint.h>

enum tone_curve {
    TONE_FILMIC,   /* toe and shoulder, the default */
    TONE_REINHARD, /* x (1 + x / white^2) / (1 + x) on luminance [Reinhard 2002, Eq. 4] */
    TONE_LINEAR,   /* clipped at 1 */
};

/* The scene value that filmic and Reinhard bring to white, the exposed middle grey being 0.18: 5.8 stops above it. */
#define TONE_WHITE 10.0

MUST_CHECK enum err tone_parse(const char *name, enum tone_curve *out, struct reason *why);
const char *tone_name(enum tone_curve curve);

/* The curve alone, exact: exposed scene value x to display-linear light in 0..1. x is a channel for filmic and linear,
 * the luminance for Reinhard. NaN and what is below 0 give 0. */
double tone_value(enum tone_curve curve, double x);

/* Display-linear light 0..1 to the sRGB signal 0..1 [IEC 61966-2-1]. */
double tone_srgb(double linear);

/* Exposure that follows the picture: the log-average luminance is brought to the key of 0.18 [Reinhard 2002, Eq. 1]
 * and approached by a fixed share per frame, in stops, never staying further from it than one stop, so that a script
 * and a stream step alike: no clock. Zeroed memory with desc set by exposure_init is ready; the first frame is taken at
 * once. */
struct exposure {
    double key;        /* 0.18 */
    double adapt;      /* share of the way covered per frame, 0..1; 1: at once */
    double bias_stops; /* the user's wish on top */
    double log2_gain;  /* present gain, stops */
    int started;
};

void exposure_init(struct exposure *e);

/* Mean of log2 luminance. Pixels of luminance 0 or NaN do not count, nor do those where mask (uint8_t[height][width],
 * NULL: all) is 0. A pixel further than 8 stops from the median counts as 8 stops: neither near-black, however much of
 * it there is up to a half, nor a sun can drag the picture. False when nothing counts; *out is then untouched. */
bool exposure_log2_mean(const float *rgb, const uint8_t *mask, uint32_t width, uint32_t height, double *out);

/* Steps by `frames` >= 1, the environment frames that passed since the last picture (one in a script; more where a
 * stream dropped some), and returns the gain (a factor, finite and > 0): n steps by one on the same picture and one
 * step by n end alike. Black pictures keep the gain; the user's bias acts at once. All sums in double and in fixed
 * order: the same picture gives the same gain at any thread count. */
double exposure_step(struct exposure *e, const float *rgb, uint32_t width, uint32_t height, uint64_t frames);

struct tone_desc {
    double gain;
    enum tone_curve curve;
    const char *level; /* of the CPU's, as kernels_select took it; NULL: the best there is */
};

/* gain * rgb through the curve and the sRGB transfer function [IEC 61966-2-1] into uint8_t[height][width][3].
 * Filmic and linear act per channel, Reinhard on luminance. No input makes it fail: NaN becomes 0, infinity 255.
 * Within 1 code value of the exact formula, and equal to it for more than 99.8 % of a dense ramp; never falls as the
 * light rises. The same bits on every CPU and at every level. Uses all OpenMP threads. */
void tone_map(const float *rgb, uint32_t width, uint32_t height, const struct tone_desc *desc, uint8_t *out);

#endif
