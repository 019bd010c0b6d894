/* Where the texels of a lat-long image are (sky/tables/layout.h), and how large. Private to this room. Thread: any. */
#pragma once

#include "base/vec.h"

#include <stddef.h>
#include <stdint.h>

/* The unit direction of a point of the image, in texels from the top left. */
static inline void texel_direction(uint32_t width, uint32_t height, double x, double y, double w[3])
{
    const double theta = PI * y / height, phi = PI - 2.0 * PI * x / width;

    w[0] = sin(theta) * sin(phi);
    w[1] = cos(theta);
    w[2] = sin(theta) * cos(phi);
}

/* Where a unit direction is: x in 0 .. width, y in 0 .. height. */
static inline void texel_place(uint32_t width, uint32_t height, const double w[3], double *x, double *y)
{
    *x = (PI - atan2(w[0], w[2])) / (2.0 * PI) * width;
    *y = atan2(sqrt(w[0] * w[0] + w[2] * w[2]), w[1]) / PI * height;
}

/* Of a texel in row y, sr; cos a - cos b as a product, which is accurate for thin rows. */
static inline double texel_solid_angle(uint32_t width, uint32_t height, uint32_t y)
{
    return 4.0 * PI / width * sin(PI * (y + 0.5) / height) * sin(0.5 * PI / height);
}

/* The angle between unit vectors, accurate near 0, unlike acos. */
static inline double angle_between(const double a[3], const double b[3])
{
    const double d[3] = { a[0] - b[0], a[1] - b[1], a[2] - b[2] };
    return 2.0 * asin(fmin(1.0, 0.5 * sqrt(dot3(d, d))));
}

static inline double texel_luminance(const float *rgb, size_t i)
{
    return (double)rgb_luminance(rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2]);
}

/* The largest channel: where a camera clips first. */
static inline float texel_brightest(const float *rgb, size_t i)
{
    const float *c = rgb + 3 * i;
    return fmaxf(c[0], fmaxf(c[1], c[2]));
}
