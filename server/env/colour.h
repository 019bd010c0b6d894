/* server/env/colour.h */
/* Primaries and white point of linear RGB, and the way from one to another through XYZ [SMPTE RP 177]; white points
 * are brought together by Bradford's adaptation. */
#ifndef ENV_COLOUR_H
#define ENV_COLOUR_H

#include "err.h"

#include <stdbool.h>

struct chromaticities { /* CIE xy */
    double red[2], green[2], blue[2], white[2];
};

extern const struct chromaticities colour_rec709;

/* True when each coordinate differs by at most `tolerance`. NaN is never the same. */
bool colour_same(const struct chromaticities *a, const struct chromaticities *b, double tolerance);

/* Row-major 3x3 that takes linear RGB of `from` to linear Rec.709. White stays white: (1, 1, 1) maps to itself.
 * ERR_RANGE when a coordinate is not finite or beyond +-10, the primaries lie on a line, the white lies outside their
 * triangle, or it is no light that Bradford's cones can see. */
MUST_CHECK enum err colour_to_rec709(const struct chromaticities *from, double out[9]);

/* Row-major 3x3 from CIE XYZ (white point E, as Radiance's XYZE) to linear Rec.709. */
void colour_xyz_to_rec709(double out[9]);

#endif
