/* server/env/colour.h */
/* Primaries and white point of linear RGB, and the way from one to another through XYZ [SMPTE RP 177]; white points
 * are brought together by Bradford's adaptation. */
#ifndef ENV_COLOUR_H
#define ENV_COLOUR_H

#include "err.h"

struct chromaticities { /* CIE xy */
    double red[2], green[2], blue[2], white[2];
};

extern const struct chromaticities colour_rec709;

/* Row-major 3x3 that takes linear RGB of `from` to linear Rec.709. ERR_RANGE when the primaries are not finite, lie on
 * a line or have y of 0. */
MUST_CHECK enum err colour_to_rec709(const struct chromaticities *from, double out[9]);

/* Row-major 3x3 from CIE XYZ (white point E, as Radiance's XYZE) to linear Rec.709. */
void colour_xyz_to_rec709(double out[9]);

#endif
