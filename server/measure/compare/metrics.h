/* The error of an image against a reference (docs/internals/how-it-works.md, Conventions). Both are linear,
 * float[height][width][3]. Any thread. */
#pragma once

#include <stdbool.h>
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
