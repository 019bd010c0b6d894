/* Skies for the tests of what lies between two: a grey one with a sun of known place and energy, and clouds that drift.
 */
#pragma once

#include "base/luminance.h"
#include "sky/between/sun_patch.h"
#include "sky/between/latlong.h"
#include "support/skies.h"

#include <math.h>

#define DEGREES (PI / 180.0)

/* Elevation and azimuth from +Z towards -X, as the compass does. */
static inline void towards(double elevation, double azimuth, double w[3])
{
    w[0] = -sin(azimuth) * cos(elevation);
    w[1] = sin(elevation);
    w[2] = cos(azimuth) * cos(elevation);
}

static inline double degrees_between(const double a[3], const double b[3])
{
    const double d[3] = { a[0] - b[0], a[1] - b[1], a[2] - b[2] };
    return 2.0 * asin(0.5 * sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])) / DEGREES;
}

/* The luminance of all texels x solid angle, and its middle. */
static inline double light_of(const float *rgb, uint32_t width, uint32_t height, double middle[3])
{
    double sum = 0.0;

    middle[0] = middle[1] = middle[2] = 0.0;
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            const float *t = rgb + 3 * ((size_t)y * width + x);
            const double g = (double)rgb_luminance(t[0], t[1], t[2]) * 2.0 * PI / width *
                             (cos(PI * y / height) - cos(PI * (y + 1.0) / height));
            double w[3];
            texel_direction(width, height, x + 0.5, y + 0.5, w);
            for (int c = 0; c < 3; c++)
                middle[c] += g * w[c];
            sum += g;
        }
    const double length = sqrt(middle[0] * middle[0] + middle[1] * middle[1] + middle[2] * middle[2]);
    for (int c = 0; c < 3; c++)
        middle[c] /= length;
    return sum;
}

/* Smooth clouds on a plane 1 above, moved by `by`; the horizon and the ground are plain. */
static inline float cloud(const double w[3], const double by[2])
{
    static const double waves[6][3] = { { 3.1, 1.7, 0.3 }, { -2.3, 4.1, 1.1 }, { 5.9, -3.7, 2.9 },
                                        { 7.3, 6.1, 0.7 }, { -9.7, 2.9, 4.2 }, { 2.1, -11.3, 5.5 } };
    double sum = 0.0;

    if (w[1] <= 0.0)
        return 0.3f;
    const double x = w[0] / (w[1] + 0.05) - by[0], z = w[2] / (w[1] + 0.05) - by[1];
    for (int k = 0; k < 6; k++)
        sum += sin(waves[k][0] * x + waves[k][1] * z + waves[k][2]) / (1.0 + 0.5 * k);
    const double edge = fmin(1.0, w[1] / 0.2);
    return (float)(0.6 + edge * 0.4 * fmax(-1.0, fmin(1.0, sum)));
}

static inline struct frame cloudy(uint32_t width, uint32_t height, double east, double north)
{
    struct frame f = sky_constant(width, height, 0.0f);
    const double by[2] = { east, north };

    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            double w[3];
            texel_direction(width, height, x + 0.5, y + 0.5, w);
            const float g = cloud(w, by);
            sky_paint(&f, x, y, 0.8f * g, g, 1.2f * g);
        }
    return f;
}
