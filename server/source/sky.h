/* server/source/sky.h */
/* The built-in daylight: an analytic clear sky with its sun, for any place and time [Preetham et al. 1999], its level
 * after [Rigollier et al. 2000] by day and [Janiczek and DeYoung 1987] in twilight; docs/sky.md has the whole model.
 * Radiance in linear Rec.709 with luminance = cd m^-2 / 179, lat-long in OpenEXR's orientation (image centre =
 * +Z, a quarter left = +X, top = +Y). North is +Z and east is -X, so that with +Y up east is on the right of a map
 * whose north is on top: the sun rises at -X and stands at noon over -Z (northern hemisphere). */
#ifndef SOURCE_SKY_H
#define SOURCE_SKY_H

#include "err.h"

#include <stddef.h>
#include <stdint.h>

/* The keys of a spec and what they mean, one line each, for --help texts and documents. */
extern const char *const sky_help;

#define SKY_SIDE_MAX 16384 /* texels */

struct sky_desc {
    double latitude_degrees;  /* -90..90, north positive */
    double longitude_degrees; /* -180..180, east positive; tells what utc= means, nothing else */
    int month, day;           /* of frame 0; the year does not matter here */
    double hour;              /* local solar time of frame 0, 0..24 */
    double speed_hours;       /* solar hours per frame, >= 0 (speed= counts minutes); day follows day */
    double turbidity;         /* 1.7..10, haziness */
    double ground_albedo;     /* 0..1, grey, of the ground below the horizon */
    double sun_ratio;         /* luminance of the sun's disc over the sky's mean; 0: as the atmosphere gives it */
    double night_lux;         /* illuminance of the night, 0..100; 0.002 is starlight and airglow */
    double scale;             /* output units per W sr^-1 m^-2 */
    uint32_t width, height;   /* texels, 2:1, the height even */
};

/* The sky of one moment as its terms (docs/sky.md): set by sky_state_*, read by sky_radiance and sky_render. */
struct sky_dome {
    double perez[3][5]; /* A..E of luminance, chromaticity x and y */
    double gain[3];     /* what multiplies their F: luminance in output units; x and y of the zenith over its F */
    double twilight[2]; /* weight of twilight's blue at the horizon and high up, 0..1 */
    double night[3];    /* multiplies the gradation, output units */
    double ground[3];   /* radiance below the horizon, output units */
};

struct sky_state {            /* what the sky is at one moment, for tests, statistics and the page */
    double sun_elevation;     /* radians, negative below the horizon */
    double sun_direction[3];  /* unit length, towards the centre of the disc */
    double sun_radiance[3];   /* of the disc, uniform over it; output units */
    double sun_solid_angle;   /* of the whole disc, sr */
    double sun_visible;       /* share of that above the horizon, 0..1 */
    double sun_irradiance[3]; /* horizontal, of the part above the horizon; output units times sr */
    double sky_irradiance[3]; /* horizontal, of the upper hemisphere without the disc; output units times sr */
    double sky_mean[3];       /* radiance, mean over the upper hemisphere without the disc; output units */
    struct sky_dome dome;
};

/* Reads "latitude=48,date=06-21,turbidity=3,..." into a description that starts from the defaults; unknown keys and
 * values out of range are ERR_USAGE, named. An empty string gives the defaults: a clear June morning that moves. */
MUST_CHECK enum err sky_parse(const char *text, struct sky_desc *out, struct reason *why);

/* The sun's place for a frame number; the rest of the state follows from it. Any thread. */
void sky_state_at(const struct sky_desc *d, uint64_t frame, struct sky_state *out);

/* The same for a sun that stands anywhere: elevation -pi/2..pi/2, azimuth clockwise from north, radians. */
void sky_state_for_sun(const struct sky_desc *d, double elevation, double azimuth, struct sky_state *out);

/* Sky radiance without the sun's disc towards unit direction w (Y up); below the horizon the lit ground. Continuous in
 * w above the horizon and in the sun's place everywhere, never negative. */
void sky_radiance(const struct sky_state *s, const double w[3], double rgb[3]);

/* The whole frame: float[height][width][3]. The disc's energy is spread over the texels that it covers, in proportion
 * to the covered solid angle and exact in the sum; it moves without steps. Uses OpenMP threads; the same bits at any
 * number of them. */
void sky_render(const struct sky_desc *d, const struct sky_state *s, float *rgb);

#endif
