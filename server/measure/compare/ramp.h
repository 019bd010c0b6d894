/* The colours of an error map: black over violet, red and orange to pale yellow, lightness growing evenly, so that
 * equal steps look equal and the map survives a grey printer. Any thread. */
#pragma once

#include <stdint.h>

/* sRGB at t; what is outside 0..1 takes the nearer end. */
void ramp_colour(double t, uint8_t rgb[3]);
