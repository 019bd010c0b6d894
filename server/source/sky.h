/* server/source/sky.h */
/* The built-in daylight: an analytic clear sky with its sun, for any place and time. Radiance in linear Rec.709,
 * lat-long in OpenEXR's orientation (DESIGN: image centre = +Z, a quarter left = +X, top = +Y). North is +Z, east is
 * -X: +Y is up, so that the sun rises at -X and stands at noon over -Z (northern hemisphere). */
#ifndef SOURCE_SKY_H
#define SOURCE_SKY_H

#include "err.h"

#include <stdint.h>

struct sky_desc {
    double latitude_degrees;   /* -90..90, north positive */
    double longitude_degrees;  /* -180..180, east positive; only shifts the clock */
    int month, day;            /* date=MM-DD; the year does not matter here */
    double hour;               /* local solar time of frame 0, 0..24 */
    double speed_hours;        /* solar hours per frame; the sky turns day after day */
    double turbidity;          /* 1.7..10, haziness */
    double ground_albedo;      /* 0..1, of the ground below the horizon */
    double sun_ratio;          /* radiance of the sun's disc over the sky's mean; 0: as the atmosphere gives it */
    double scale;              /* output units per W sr^-1 m^-2 */
    uint32_t width, height;    /* texels, 2:1 */
};

struct sky_state { /* what the sky is at one moment, for tests, statistics and the page */
    double sun_elevation;   /* radians, negative below the horizon */
    double sun_direction[3];
    double sun_radiance[3]; /* of the disc, mean over it; output units */
    double sun_solid_angle; /* of the whole disc, sr */
};

/* Reads "latitude=48,date=06-21,turbidity=3,..." into a description that starts from the defaults; unknown keys and
 * values out of range are ERR_USAGE, named. An empty string gives the defaults: a clear June morning that moves. */
MUST_CHECK enum err sky_parse(const char *text, struct sky_desc *out, struct reason *why);

/* The sun's place for a frame number; the rest of the state follows from it. Any thread. */
void sky_state_at(const struct sky_desc *d, uint64_t frame, struct sky_state *out);

/* Sky radiance without the sun's disc towards unit direction w (Y up) for the sun at `sun_elevation`; below the
 * horizon the lit ground. Continuous in the sun's elevation at every angle from -90 to 90 degrees, never negative.
 * The azimuth between w and the sun is taken from state. */
void sky_radiance(const struct sky_desc *d, const struct sky_state *s, const double w[3], double rgb[3]);

/* The whole frame: float[height][width][3]. The disc's energy is spread exactly over the texels that it covers. */
void sky_render(const struct sky_desc *d, const struct sky_state *s, float *rgb);

#endif
