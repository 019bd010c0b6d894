/* Skies whose sun is known, and what a camera does to them: what the tests of this room share. */
#pragma once

#include "support/unit.h"

#include "base/luminance.h"
#include "sky/between/latlong.h"
#include "sky/daylight/pattern.h"
#include "sky/daylight/sky.h"

#define DEGREE (PI / 180.0)

struct picture {
    uint32_t width, height;
    float *rgb;
};

static inline struct picture picture_make(uint32_t width)
{
    return (struct picture){ width, width / 2, test_calloc((size_t)3 * width * (width / 2), sizeof(float)) };
}

static inline size_t picture_values(const struct picture *p)
{
    return (size_t)3 * p->width * p->height;
}

/* Horizontal illuminance of the upper hemisphere, lx at 1 unit per W sr^-1 m^-2. */
static inline double picture_lux(const struct picture *p)
{
    double sum = 0.0;

    for (uint32_t y = 0; y < p->height / 2; y++)
        for (uint32_t x = 0; x < p->width; x++) {
            double w[3];
            texel_direction(p->width, p->height, x + 0.5, y + 0.5, w);
            sum += w[1] * texel_solid_angle(p->width, p->height, y) * texel_luminance(p->rgb, (size_t)y * p->width + x);
        }
    return LUMINOUS_EFFICACY * sum;
}

static inline void picture_scale(struct picture *p, double by)
{
    for (size_t i = 0; i < picture_values(p); i++)
        p->rgb[i] *= (float)by;
}

static inline void picture_clip(struct picture *p, double level)
{
    for (size_t i = 0; i < picture_values(p); i++)
        p->rgb[i] = fminf(p->rgb[i], (float)level);
}

/* The brightest value of the sky that a camera still tells apart. */
static inline double picture_brightest_sky(const struct picture *p, const double sun[3])
{
    double most = 0.0;

    for (size_t i = 0; i < picture_values(p) / 3; i++) {
        double w[3];
        texel_direction(p->width, p->height, i % p->width + 0.5, (double)(i / p->width) + 0.5, w);
        if (angle_between(w, sun) > 2.0 * DEGREE)
            most = fmax(most, (double)texel_brightest(p->rgb, i));
    }
    return most;
}

static inline void sun_at(double elevation, double azimuth, double w[3])
{
    w[0] = -cos(elevation * DEGREE) * sin(azimuth * DEGREE);
    w[1] = sin(elevation * DEGREE);
    w[2] = cos(elevation * DEGREE) * cos(azimuth * DEGREE);
}

/* Adds the disc of a sun of this illuminance at normal incidence. */
static inline void add_sun(struct picture *p, const double w[3], double lux)
{
    const struct sky_desc size = { .width = p->width, .height = p->height };
    struct sky_state s = { .sun_elevation = asin(w[1]),
                           .sun_direction = { w[0], w[1], w[2] },
                           .sun_solid_angle = 2.0 * PI * (1.0 - cos(SUN_RADIUS)),
                           .sun_visible = 1.0 };

    for (int c = 0; c < 3; c++)
        s.sun_radiance[c] = lux / LUMINOUS_EFFICACY / s.sun_solid_angle;
    sky_add_sun(&size, &s, p->rgb);
}

/* The sky of a pattern, grey, with this diffuse horizontal illuminance. */
static inline void paint_pattern(struct picture *p, const struct sky_pattern *pattern, const double sun[3], double lux)
{
    for (size_t i = 0; i < picture_values(p) / 3; i++) {
        double w[3];
        texel_direction(p->width, p->height, i % p->width + 0.5, (double)(i / p->width) + 0.5, w);
        const double v =
            w[1] > 0.0 ? pattern_gradation(pattern, w[1]) * pattern_indicatrix(pattern, angle_between(w, sun)) : 0.0;
        for (int c = 0; c < 3; c++)
            p->rgb[3 * i + (size_t)c] = (float)v;
    }
    picture_scale(p, lux / picture_lux(p));
}

/* The built-in sky with its sun. */
static inline void paint_sky(struct picture *p, const double sun[3], double turbidity)
{
    const struct sky_desc d = {
        .width = p->width, .height = p->height, .turbidity = turbidity, .ground_albedo = 0.2, .scale = 1.0
    };
    struct sky_state s = { .sun_elevation = asin(sun[1]), .sun_direction = { sun[0], sun[1], sun[2] } };

    sky_state_fill(&d, &s);
    sky_render(&d, &s, p->rgb);
}
