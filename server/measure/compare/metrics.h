/* The error of an image against a reference (docs/internals/how-it-works.md, Conventions). Both are linear,
 * float[height][width][3]. Any thread. */
#pragma once

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct metrics {
    double mean_ratio;      /* mean luminance of the image over that of the reference */
    double rel_mse;         /* mean((x - r)^2 / (r^2 + 1e-2 mean(r)^2)), over channels and the pixels counted */
    double rel_mse_trimmed; /* the same without the worst `trim` share of pixels */
    double delta_e;         /* mean CIE76 delta E*ab after one fixed tone map on both (gain from the reference) */
    uint64_t pixels;        /* counted */
};

/* mask: uint8_t[height][width], 0 = leave the pixel out; NULL counts all. trim: 0..1, as 0.02.
 * error_map, when not NULL: float[height][width], each pixel's own relative squared error (0 where left out).
 * False when out of memory or if no pixel is counted. */
bool metrics_compare(const float *x, const float *r, const uint8_t *mask, uint32_t width, uint32_t height, double trim,
                     float *error_map, struct metrics *out);

struct metrics_halves {
    double rel_mse;        /* mean((x - a)(x - b) / (r^2 + 1e-2 mean^2)) */
    double standard_error; /* of that mean, from its pixels */
};

/* relMSE against a noisy reference of two independent halves a and b: their noise cancels in the product. It would not
 * if each pixel's own noise divided it, so r is the mean of both halves over the 5 x 5 pixels around, of those counted.
 * mask as above. False if no pixel is counted. */
bool metrics_halves(const float *x, const float *a, const float *b, const uint8_t *mask, uint32_t width,
                    uint32_t height, struct metrics_halves *out);

/* ---- FLIP ---- */

/* FLIP: the difference that a person perceives between two images that alternate on one display [Andersson et al.
 * 2020], written from the paper. Each pixel's difference is in 0..1: 0 where none is visible, 1 for the largest
 * difference of colours or a lone pixel that appears. Noise that the eye averages away at the viewing distance counts
 * little, edges and dots count more. It is symmetric. Sums have a fixed order: the same bits at any number of threads.
 * Any thread. */

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

/* ---- Flicker ---- */

/* Flicker: second differences in time of images as shown, |c(t) - 2 c(t-1) + c(t-2)| in 8-bit codes, which are 0 where
 * light changes evenly. Thread: one at a time. */

#define FLICKER_MOST (2 * 255) /* |a - 2 b + c| of bytes */

struct flicker {
    uint64_t of[FLICKER_MOST + 1]; /* values by second difference */
    uint64_t triples;              /* of images */
};

/* Adds three images in a row, uint8_t[count] each. */
void flicker_add(struct flicker *f, const uint8_t *newest, const uint8_t *middle, const uint8_t *oldest, size_t count);

/* The least number of codes that a share of all values (0..1) does not exceed; 0 of none. */
int flicker_percentile(const struct flicker *f, double share);

/* ---- Colour spaces ---- */

/* Display-linear Rec.709 to CIE XYZ and CIE 1976 (L*a*b*), white D65. Any thread. */

struct lab {
    double l, a, b;
};

/* CIE 1976 (L*a*b*) [CIE 15:2004, 8.2.1]: f(t). */
static inline double lab_root(double t)
{
    const double d = 6.0 / 29.0;
    return t > d * d * d ? cbrt(t) : t / (3.0 * d * d) + 4.0 / 29.0;
}

/* X, Y and Z over those of white. The rows add up to the white point's X and Z, so that white is (1, 1, 1). */
static inline void lab_xyz(const double c[3], double xyz[3])
{
    xyz[0] = (0.4123907993 * c[0] + 0.3575843394 * c[1] + 0.1804807884 * c[2]) / 0.9504559271;
    xyz[1] = 0.2126390059 * c[0] + 0.7151686788 * c[1] + 0.0721923154 * c[2];
    xyz[2] = (0.0193308187 * c[0] + 0.1191947798 * c[1] + 0.9505321522 * c[2]) / 1.0890577508;
}

static inline struct lab lab_from(const double c[3])
{
    double xyz[3];

    lab_xyz(c, xyz);
    const double fx = lab_root(xyz[0]), fy = lab_root(xyz[1]), fz = lab_root(xyz[2]);
    return (struct lab){ 116.0 * fy - 16.0, 500.0 * (fx - fy), 200.0 * (fy - fz) };
}

/* Of a pixel, linear Rec.709, as shown under the exposure `gain` and the filmic curve. */
struct lab lab_of_pixel(const float *rgb, double gain);
