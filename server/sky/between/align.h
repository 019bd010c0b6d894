/* Where north is. From the directions in which a camera saw the sun and those in which it stood, the rotation that
 * turns the camera's images into the world: Y up, north +Z, east -X (sky/daylight/sun.h). Thread: any. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* ---- The sun of a place and time ---- */

/* Unit direction in which the sun is seen, the centre of its disc: coordinates of the Astronomical Almanac to 0.01
 * degrees [Michalsky 1988], raised by the refraction of the air [Saemundsson 1986]. Degrees, north and east positive;
 * micros: UTC since 1970. From 1950 to 2050. */
void align_sun(double latitude, double longitude, int64_t micros, double w[3]);

/* ---- The sun of an image ---- */

/* The direction of what is far brighter than the rest of a lat-long image (float[height][width][3], linear Rec.709), as
 * the centroid of what exceeds a level between the two: within a texel, also of a clipped sun. *found is false when
 * nothing compact is. It may be a lamp or a reflection: align_fit copes with some. ERR_NOMEM. */
MUST_CHECK enum err align_find_sun(const float *rgb, uint32_t width, uint32_t height, double w[3], bool *found);

/* ---- The rotation ---- */

struct sun_pair {
    double seen[3], known[3]; /* unit */
};

enum align_kind {
    ALIGN_NONE,     /* no pairs, or less than half of them agree: r is the identity */
    ALIGN_AZIMUTH,  /* about +Y alone: one pair, or all within ALIGN_SPREAD_DEGREES */
    ALIGN_ROTATION, /* azimuth and tilt */
};

enum align_rig {
    ALIGN_UPRIGHT,
    ALIGN_UPSIDE_DOWN,     /* the camera hangs: turned by more than 90 degrees about a horizontal axis */
    ALIGN_MIRRORED,        /* left and right are exchanged */
    ALIGN_MIRRORED_BOTTOM, /* top and bottom are exchanged: rows from the bottom up */
};

#define ALIGN_SPREAD_DEGREES 10.0 /* between the sun's places, from which on a tilt can be told */
#define ALIGN_TRUST_DEGREES 1.5   /* a pair that is further off is an outlier */

struct alignment {
    enum align_kind kind;
    enum align_rig rig;   /* known for ALIGN_ROTATION */
    double r[3][3];       /* known = r seen; orthogonal, determinant -1 for a mirrored rig */
    double azimuth;       /* degrees clockwise as seen from above, from north: where the image's centre goes */
    double tilt;          /* degrees, 0 .. 90: between the image's vertical and the world's, exchanges apart */
    double residual;      /* degrees: root mean square of the angles that are left over of the pairs in use; for
                             ALIGN_AZIMUTH mostly the elevation's */
    double elevation_off; /* degrees: mean of seen minus known elevation of the pairs in use, before the rotation */
    size_t used, count;   /* pairs in use, and all */
    char note[200];       /* one printable line */
};

/* Fits the rotation that minimises the sum of squared angles [Wahba 1965; Davenport's q method] over the pairs that
 * agree: the best of those that two pairs give [Fischler and Bolles 1981], refined on its inliers. A mirrored rig is
 * assumed if its rotation fits far better, or as well with 30 degrees less tilt: a short arc of the sun fits both.
 * Deterministic. */
void align_fit(const struct sun_pair *pairs, size_t count, struct alignment *out);

/* Turns a lat-long image: out(r w) = in(w), bilinear with 2 x 2 samples a texel, across the seam and the poles. r:
 * orthogonal, also mirrored. in and out: float[height][width][3], no overlap. On all OpenMP threads; the result does
 * not depend on their number. */
void align_apply(const double r[3][3], const float *in, float *out, uint32_t width, uint32_t height);
