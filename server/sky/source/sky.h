/* The built-in daylight: an analytic clear sky with its sun, for any place and time [Preetham et al. 1999]. Its
 * luminance follows [Rigollier et al. 2000] by day and [Janiczek and DeYoung 1987] in twilight; docs/sky.md describes
 * the model. Radiance is linear Rec.709 with luminance = cd m^-2 / 179, in lat-long with OpenEXR's orientation (image
 * centre +Z, a quarter left +X, top +Y). North is +Z and east is -X, so that with +Y up, east is on the right of a map
 * with north at the top: the sun rises at -X and is over -Z at noon (northern hemisphere). Thread: any. */
#pragma once

#include "base/err.h"

#include <stddef.h>
#include <stdint.h>

/* The keys of a spec, one line each, for --help and the documentation. */
extern const char *const sky_help;

#define SKY_SIDE_MAX 16384 /* texels */

struct sky_desc {
    double latitude_degrees;  /* -90..90, north positive */
    double longitude_degrees; /* -180..180, east positive; only used for utc= */
    int month, day;           /* of frame 0; the year is ignored */
    double hour;              /* local solar time of frame 0, 0..24 */
    double speed_hours;       /* solar hours per frame, >= 0 (speed= is in minutes); continues across midnight */
    double turbidity;         /* 1.7..10 */
    double ground_albedo;     /* 0..1, grey, below the horizon */
    double sun_ratio;         /* luminance of the sun's disc over the sky's mean; 0: computed from the atmosphere */
    double night_lux;         /* illuminance at night, 0..100; 0.002 is starlight and airglow */
    double scale;             /* output units per W sr^-1 m^-2 */
    uint32_t width, height;   /* texels; 2:1, even height */
};

/* The terms of the sky at one moment (docs/sky.md): set by sky_state_*, used by sky_radiance and sky_render. */
struct sky_dome {
    double perez[3][5]; /* A..E for luminance, chromaticity x and y */
    double gain[3];     /* factors of F: luminance in output units; zenith x and y over their F */
    double twilight[2]; /* weight of twilight's blue at the horizon and high up, 0..1 */
    double night[3];    /* factor of the gradation, output units */
    double ground[3];   /* radiance below the horizon, output units */
};

struct sky_state {            /* the sky at one moment, for tests, statistics and the page */
    double sun_elevation;     /* radians, negative below the horizon */
    double sun_direction[3];  /* unit, towards the centre of the disc */
    double sun_radiance[3];   /* of the disc, uniform; output units */
    double sun_solid_angle;   /* of the whole disc, sr */
    double sun_visible;       /* share of the disc above the horizon, 0..1 */
    double sun_irradiance[3]; /* horizontal, from the disc's part above the horizon; output units times sr */
    double sky_irradiance[3]; /* horizontal, from the upper hemisphere without the disc; output units times sr */
    double sky_mean[3];       /* mean radiance of the upper hemisphere without the disc; output units */
    struct sky_dome dome;
};

/* Parses "latitude=48,date=06-21,turbidity=3,..." on top of the defaults. The empty string is a clear June morning with
 * a moving sun. ERR_USAGE names an unknown key or a value out of range. */
MUST_CHECK enum err sky_parse(const char *text, struct sky_desc *out, struct reason *why);

/* Computes the sun's position at a frame number and the rest of the state from it. */
void sky_state_at(const struct sky_desc *d, uint64_t frame, struct sky_state *out);

/* Sky radiance without the sun's disc in unit direction w (Y up); below the horizon, the lit ground. Continuous in w
 * above the horizon and in the sun's position; never negative. */
void sky_radiance(const struct sky_state *s, const double w[3], double rgb[3]);

/* Renders a frame to float[height][width][3]. Distributes the disc's energy over the texels it covers, in proportion to
 * the covered solid angle; the sum is exact, and the disc moves continuously. Uses OpenMP; the result does not depend
 * on the number of threads. */
void sky_render(const struct sky_desc *d, const struct sky_state *s, float *rgb);
