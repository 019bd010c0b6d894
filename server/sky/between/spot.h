/* Bright spots of a lat-long image. Private to this room. Thread: any. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

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
