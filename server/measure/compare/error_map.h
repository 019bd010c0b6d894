/* Draws an error map: relative error, logarithmic from 0.1 % (black) through violet, red and orange to 100 % (pale
 * yellow), with evenly increasing lightness and a scale below. Any thread. */
#pragma once

#include "base/err.h"

#include <stdint.h>

/* Writes a PNG. squared: float[height][width], each pixel's relative squared error as metrics_compare gives it.
 * mask: uint8_t[height][width], where 0 the pixel is plain grey; NULL: none is. ERR_IO names path and cause. */
MUST_CHECK enum err error_map_write(const float *squared, const uint8_t *mask, uint32_t width, uint32_t height,
                                    const char *path, struct reason *why);

/* ---- Colours ---- */

/* The colours of an error map: black over violet, red and orange to pale yellow, lightness growing evenly, so that
 * equal steps look equal and the map survives a grey printer. Any thread. */

/* sRGB at t; what is outside 0..1 takes the nearer end. */
void ramp_colour(double t, uint8_t rgb[3]);
