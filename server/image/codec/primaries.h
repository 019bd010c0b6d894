/* Conversion between linear RGB spaces, given by primaries and white point, through XYZ [SMPTE RP 177] with Bradford
 * chromatic adaptation. Thread: any. */
#pragma once

#include "base/err.h"

#include <stdbool.h>

struct chromaticities { /* CIE xy */
    double red[2], green[2], blue[2], white[2];
};

extern const struct chromaticities colour_rec709;

/* Whether each coordinate differs by at most `tolerance`. False for NaN. */
bool colour_same(const struct chromaticities *a, const struct chromaticities *b, double tolerance);

/* Row-major 3x3 matrix from linear RGB of `from` to linear Rec.709. White maps to itself: (1, 1, 1) to (1, 1, 1).
 * ERR_RANGE: a coordinate is not finite or beyond +-10, the primaries are collinear, or the white point lies outside
 * their triangle or has a cone response that is not positive. */
MUST_CHECK enum err colour_to_rec709(const struct chromaticities *from, double out[9]);

/* Row-major 3x3 matrix from CIE XYZ (white point E, as in Radiance's XYZE) to linear Rec.709. */
void colour_xyz_to_rec709(double out[9]);
