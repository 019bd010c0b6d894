/* FLIP: the difference that a person perceives between two images that alternate on one display [Andersson et al.
 * 2020], written from the paper. Each pixel's difference is in 0..1: 0 where none is visible, 1 for the largest
 * difference of colours or a lone pixel that appears. Noise that the eye averages away at the viewing distance counts
 * little, edges and dots count more. It is symmetric. Sums have a fixed order: the same bits at any number of threads.
 * Any thread. */
#pragma once

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Pixels in a degree of the observer's eye: 0.7 m in front of a display 0.69 m and 3840 pixels wide [Andersson et al.
 * 2020, Eq. 1]. */
#define FLIP_PIXELS_PER_DEGREE 67.0
#define FLIP_PIXELS_PER_DEGREE_MAX 200.0

enum flip_plane {
    FLIP_L, /* L*a*b* after the eye's own blur, a* and b* less where it is dark */
    FLIP_A,
    FLIP_B,
    FLIP_EDGE,  /* strength of edges in the image as it is, 0..1 */
    FLIP_POINT, /* and of dots and thin lines */
    FLIP_PLANES,
};

/* An image as the eye sees it, to be compared with any number of others. Never changes after flip_view_init. */
struct flip_view {
    double *plane[FLIP_PLANES]; /* [height][width] */
    uint32_t width, height;
};

/* rgb: float[height][width][3], display-linear light 0..1, as flip_tone makes it; values outside are clipped and NaN is
 * black. pixels_per_degree: above 0, at most FLIP_PIXELS_PER_DEGREE_MAX. False when out of memory; *v
 * then needs no finish. */
bool flip_view_init(struct flip_view *v, const float *rgb, uint32_t width, uint32_t height, double pixels_per_degree);
void flip_view_finish(struct flip_view *v); /* zeroed memory is allowed */

/* Mean difference of two views of one size. mask: uint8_t[height][width], 0 = leave the pixel out of the mean; NULL
 * counts all. map, when not NULL: float[height][width], each pixel's own (0 where left out). 0 where none is counted.
 */
double flip_mean(const struct flip_view *a, const struct flip_view *b, const uint8_t *mask, float *map);

/* Of scene light: the filmic curve over gain * rgb, without quantization; count values. */
void flip_tone(const float *rgb, size_t count, double gain, float *display);

/* The same from two linear images, both under the exposure of r, like delta E in metrics.h. False when out of memory
 * or if no pixel is counted. */
bool flip_compare(const float *x, const float *r, const uint8_t *mask, uint32_t width, uint32_t height,
                  double pixels_per_degree, float *map, double *mean);
