/* False colour: luminance as a colour from dark blue over green and yellow to red, ever brighter up to yellow. Thread:
 * any. */
#pragma once

#include <stdint.h>

/* The colour (8-bit sRGB) of a share 0..1, clamped; NaN is grey. */
void false_colour(double share, uint8_t rgb[3]);

/* The scale of TONE_FALSE_COLOUR: exposed luminance from LEAST to MOST, logarithmic. */
#define FALSE_COLOUR_LEAST 0.01
#define FALSE_COLOUR_MOST 10.0

/* The place on that scale, 0..1; NaN counts as 0. */
double false_colour_share(double exposed);
