/* Skies by their spec, rendered, and the geometry of their texels: what the tests of the sky share. */
#pragma once

#include "support/unit.h"

#include "base/luminance.h"
#include "base/vec.h"
#include "sky/daylight/sky.h"
#include "sky/daylight/sky_sun.h"

#include <math.h>
#include <omp.h>

#define DEGREE (PI / 180.0)

/* The frames here are small: threads that wait for each other cost more than they bring. */
static inline struct sky_desc parse(const char *text)
{
    struct sky_desc d;
    struct reason why = { "" };

    omp_set_num_threads(1);
    if (sky_parse(text, &d, &why))
        fail_msg("%s: %s", text, why.text);
    return d;
}

static inline double luminance(const double rgb[3])
{
    return 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
}

/* Illuminance in lux out of an irradiance in output units. */
static inline double lux(const struct sky_desc *d, const double irradiance[3])
{
    return luminance(irradiance) * LUMINOUS_EFFICACY / d->scale;
}

static inline float *render(const struct sky_desc *d, const struct sky_state *s)
{
    float *rgb = test_malloc((size_t)3 * d->width * d->height * sizeof(float));

    sky_render(d, s, rgb);
    return rgb;
}

static inline double texel_solid_angle(const struct sky_desc *d, uint32_t y)
{
    return 2.0 * PI / d->width * (cos(PI * y / d->height) - cos(PI * (y + 1.0) / d->height));
}

static inline void texel_direction(const struct sky_desc *d, uint32_t x, uint32_t y, double w[3])
{
    const double phi = PI - 2.0 * PI * (x + 0.5) / d->width, theta = PI * (y + 0.5) / d->height;

    w[0] = sin(theta) * sin(phi);
    w[1] = cos(theta);
    w[2] = sin(theta) * cos(phi);
}
