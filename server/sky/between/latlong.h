/* Lat-long images (sky/tables/layout.h): where texels are and how large, bright spots, and images of other layouts as
 * such texels. Private to this room. Thread: one per environment, of which OpenMP is used; otherwise any. */
#pragma once

#include "base/vec.h"
#include "sky/tables/environment.h"

#include <stddef.h>

/* ---- Texels ---- */

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

/* ---- Bright spots ---- */

struct spot_area { /* the upper `rows` of an image */
    const float *rgb;
    uint32_t width, height, rows;
};

struct spot {
    size_t texels;      /* 0: nothing reaches the level */
    double solid_angle; /* sr */
    double radius;      /* of a disc of this solid angle, radians */
    double round;       /* a disc's spread over the spot's: 1 for a disc, less for any other shape; approximate */
    double weight;      /* solid angle, or solid angle times what is above the level */
    double w[3];        /* unit, the centroid by that weight */
};

/* The connected area (corners count, and the image wraps) of texels whose largest channel is at least `level` with the
 * largest weight. excess: texels count by what they have above the level, which locates the centroid within a texel;
 * else alike. ERR_NOMEM. */
MUST_CHECK enum err spot_find(const struct spot_area *a, float level, bool excess, struct spot *out);

/* ---- Other layouts ---- */

/* The layout of e's image, by choice, file or shape, and the size of the lat-long image: its own, or one with as many
 * texels. Another layout's tables are built, from which latlong_copy looks it up. Errors of layout_guess, layout_fits
 * and environment_rebuild. */
MUST_CHECK enum err latlong_size(struct environment *e, enum layout *layout, uint32_t *width, uint32_t *height,
                                 struct reason *why);

/* The texels, float[height][width][3], top row first: bit for bit if the image is lat-long, else looked up, as the
 * background is, at nine places of each. */
void latlong_copy(const struct environment *e, enum layout layout, uint32_t width, uint32_t height, float *out);
