/* The display transform: exposure, tone curve, 8-bit sRGB. Linear images are float[height][width][3], linear Rec.709
 * radiance, top row first. Thread: any, one per struct exposure. The caller owns all arrays. */
#pragma once

#include "base/setting.h"

#include <stdbool.h>
#include <stdint.h>

enum tone_curve {
    TONE_FILMIC,       /* with toe and shoulder; the default */
    TONE_REINHARD,     /* x (1 + x / white^2) / (1 + x) on luminance [Reinhard 2002, Eq. 4] */
    TONE_LINEAR,       /* clamped at 1 */
    TONE_FALSE_COLOUR, /* no curve: luminance as a colour, of the scale below */
    TONE_PQ, /* none: absolute luminance for HDR screens; by tone_map_pq alone, the functions below clamp at 1 */
};

/* The exposed value that filmic and Reinhard map to white, 5.8 stops above middle grey (0.18). */
#define TONE_WHITE 10.0

/* All curves. A new one is a row here and a case in tone_value. */
extern const struct setting_choice tone_choices[];

/* Automatic modes, used in place of a fixed gain in stops (EV) and larger than any of these. */
enum exposure_mode {
    EXPOSURE_FOLLOW = 1000, /* each image adapts to its predecessors */
    EXPOSURE_AUTO,          /* one value for all images, from the first */
};
extern const struct setting_choice exposure_choices[];

/* The exact curve: exposed value x to display-linear light in 0..1. x is a channel for filmic and linear, the luminance
 * for Reinhard. NaN and negative values give 0. */
double tone_value(enum tone_curve curve, double x);

/* Automatic exposure: scales the log-average luminance to the key of 0.18 [Reinhard 2002, Eq. 1]. Each frame covers a
 * fixed share of the distance in stops and stays within one stop of the target; the first frame jumps to it. Time is
 * counted in frames, so scripts and live streams adapt alike. Initialise with exposure_init. */
struct exposure {
    double key;       /* 0.18 */
    double adapt;     /* share of the distance covered per frame, 0..1; 1: at once */
    double log2_gain; /* current gain, stops */
    int started;
};

void exposure_init(struct exposure *e); /* defaults; no frame seen yet */

/* Mean of log2 luminance. Ignores pixels of luminance 0 or NaN and pixels where mask (uint8_t[height][width]; NULL: no
 * mask) is 0. Clamps to 8 stops around the median, so that neither a sun nor near-black pixels, up to half of the
 * image, dominate the mean. False if no pixel counts; *out is then unchanged. */
bool exposure_log2_mean(const float *rgb, const uint8_t *mask, uint32_t width, uint32_t height, double *out);

/* Advances by `frames` >= 1 environment frames since the last image (1 in scripts; more if a stream dropped some) and
 * returns the gain, a finite factor > 0. n steps by one frame on the same image equal one step by n. A black image
 * keeps the gain. Sums are in double and in fixed order: the gain does not depend on the
 * number of threads. */
double exposure_step(struct exposure *e, const float *rgb, uint32_t width, uint32_t height, uint64_t frames);

struct tone_desc {
    double gain;
    enum tone_curve curve;
    const char *level; /* CPU level, as selected by kernels_select; NULL: the best */
};

/* Applies gain, tone curve and sRGB transfer function [IEC 61966-2-1] and writes uint8_t[height][width][3]. Filmic and
 * linear act per channel, Reinhard and false colour on luminance. Accepts any input: NaN becomes 0, infinity 255.
 * Within 1 code value of the exact formula, and equal to it on more than 99.8 % of a dense ramp; monotonic.
 * Bit-identical on every CPU level. Uses all OpenMP threads. */
void tone_map(const float *rgb, uint32_t width, uint32_t height, const struct tone_desc *desc, uint8_t *out);

/* The same by the exact formulas with 16 bits, 0..65535, of images with 3 or 4 channels; a fourth is scaled only: 1
 * becomes 65535. Uses all OpenMP threads. */
void tone_map_deep(const float *from, uint32_t width, uint32_t height, uint32_t channels, const struct tone_desc *desc,
                   uint16_t *out);

/* HDR: an exposed value of 1 is shown as 203 cd/m2, the reference white of [ITU-R BT.2408]; above the peak, light is
 * clipped per channel of Rec.2020, which holds all of Rec.709. */
#define TONE_PQ_WHITE 203.0
#define TONE_PQ_PEAK 1000.0

/* The inverse EOTF of [ITU-R BT.2100-2, Table 4]: cd/m2, 0..10000, to signal 0..1. */
double tone_pq(double luminance);

/* Applies gain, primaries of Rec.2020 and PQ and writes uint16_t[height][width][3], of which 65535 is a signal of 1.
 * NaN and negative light become 0. Uses all OpenMP threads. */
void tone_map_pq(const float *rgb, uint32_t width, uint32_t height, double gain, uint16_t *out);

/* ---- False colour ---- */

/* False colour: luminance as a colour from dark blue over green and yellow to red, ever brighter up to yellow. Thread:
 * any. */

/* The colour (8-bit sRGB) of a share 0..1, clamped; NaN is grey. */
void false_colour(double share, uint8_t rgb[3]);

/* values: [height][width], from 0 to `most`; rgb: [height][width][3]. A dark line between pixels of different steps of
 * the scale. NAN is grey. */
void false_colour_map(const float *values, uint32_t width, uint32_t height, double most, int steps, uint8_t *rgb);

/* The scale of TONE_FALSE_COLOUR: exposed luminance from LEAST to MOST, logarithmic. */
#define FALSE_COLOUR_LEAST 0.01
#define FALSE_COLOUR_MOST 10.0

/* The place on that scale, 0..1; NaN counts as 0. */
double false_colour_share(double exposed);

/* ---- Size ---- */

/* Scales a linear image down: each new pixel is the mean of the area that it covers, so that fine bright detail keeps
 * its energy. Images are float[height][width][3], top row first. Thread: any. */

/* The height that keeps the aspect ratio at a width of at most the image's; at least 1. */
uint32_t scale_height(uint32_t width, uint32_t height, uint32_t to_width);

/* Finite values. The caller owns the arrays. to_width and to_height are 1 to width and height. */
void scale_linear(const float *from, uint32_t width, uint32_t height, float *to, uint32_t to_width, uint32_t to_height);
