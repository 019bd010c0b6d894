/* The built-in daylight: an analytic clear sky with its sun, for any place and time [Preetham et al. 1999]. Its
 * luminance follows [Rigollier et al. 2000] by day and [Janiczek and DeYoung 1987] in twilight; docs/sky.md describes
 * the model. Radiance is linear Rec.709 with luminance = cd m^-2 / 179, in lat-long with OpenEXR's orientation (image
 * centre +Z, a quarter left +X, top +Y). North is +Z and east is -X, so that with +Y up, east is on the right of a map
 * with north at the top: the sun rises at -X and is over -Z at noon (northern hemisphere). Thread: any. */
#pragma once

#include "base/err.h"
#include "sky/daylight/moments.h"
#include "sky/daylight/reinhart.h"
#include "sky/daylight/sun.h"

#include <stdbool.h>
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

/* The day of a frame, by solar time. */
struct sun_day sky_day(const struct sky_desc *d, uint64_t frame);

/* Sky radiance without the sun's disc in unit direction w (Y up); below the horizon, the lit ground. Continuous in w
 * above the horizon and in the sun's position; never negative. */
void sky_radiance(const struct sky_state *s, const double w[3], double rgb[3]);

/* Renders a frame to float[height][width][3]. Distributes the disc's energy over the texels it covers, in proportion to
 * the covered solid angle; the sum is exact, and the disc moves continuously. Uses OpenMP; the result does not depend
 * on the number of threads. */
void sky_render(const struct sky_desc *d, const struct sky_state *s, float *rgb);

/* A disc of uniform radiance in a lat-long image of width x height texels. */
struct sky_disc {
    double theta, phi;  /* of its centre, where w = (sin theta sin phi, cos theta, sin theta cos phi) */
    double radius;      /* radians, below pi / 2 */
    double solid_angle; /* sr, of its part in the rows */
    double radiance[3]; /* added to a texel that it covers */
    uint32_t width, height;
    uint32_t first, end; /* rows that take it, from the top; rgb begins with row `first` */
};

/* Adds the disc's energy to the texels it covers, in proportion to the covered solid angle: radiance x solid_angle in
 * all, exactly. */
void sky_add_disc(const struct sky_disc *d, float *rgb);

/* ---- The model ---- */

/* The physics behind sky.h, each part from its paper: atmospheric transmission, and the luminance
 * and colour of the clear sky. Private to this room. Stateless. Thread: any. */

#define SKY_SUN_RADIUS SUN_RADIUS /* radians */

/* Radiance of the sun's disc through the atmosphere (linear Rec.709, W sr^-1 m^-2 as in sky.h); elevation in radians.
 */
void sky_sun_radiance(double elevation, double turbidity, double rgb[3]);

/* Horizontal illuminance of the clear sky without sun and night, lux; elevation in radians. */
double sky_illuminance(double elevation, double turbidity);

/* Computes everything in *s from its sun_direction and sun_elevation. */
void sky_state_fill(const struct sky_desc *d, struct sky_state *s);

/* Adds the sun's disc to float[height][width][3] of the size in d, by the fields of s that begin with sun_. */
void sky_add_sun(const struct sky_desc *d, const struct sky_state *s, float *rgb);

/* Chromaticity of twilight's blue, caused by ozone when the sun is low [Hulburt 1953], CIE x and y. */
#define SKY_TWILIGHT_X 0.245
#define SKY_TWILIGHT_Y 0.245

/* Its weight where the cosine to the zenith is `up`: it starts high up, and the horizon stays warm longer. */
double sky_twilight_weight(const struct sky_dome *dome, double up);

/* Maximum distance in y from the CIE daylight locus. Natural skies stay near it; the fit deviates towards yellow and
 * green at low sun and in haze, and towards pink at the horizon of a clear day. */
#define SKY_LOCUS_ABOVE 0.006
#define SKY_LOCUS_BELOW 0.004

/* y on the daylight locus [Judd et al. 1964], x in 0.2..0.7. */
static inline double sky_locus(double x)
{
    return (-3.0 * x + 2.870) * x - 0.275;
}

/* The fit makes the whole horizon as warm as the sun's side, although reddened light scatters forward. Where x exceeds
 * equal-energy white, only this share of the excess is kept at an angle (radians) from the sun. */
#define SKY_WHITE_X (1.0 / 3.0)

double sky_warmth_kept(double angle); /* the share, 0..1 */

/* CIE xyY to linear Rec.709. Out-of-gamut colours are mixed with grey of the same luminance until the smallest channel
 * is 0. Continuous; never negative for Y >= 0, y > 0. */
static inline void sky_rgb_from_xyy(double x, double y, double luminance, double rgb[3])
{
    const double s = luminance / y, cx = x * s, cz = (1.0 - x - y) * s;

    rgb[0] = 3.2404542 * cx - 1.5371385 * luminance - 0.4985314 * cz; /* [IEC 61966-2-1] */
    rgb[1] = -0.9692660 * cx + 1.8760108 * luminance + 0.0415560 * cz;
    rgb[2] = 0.0556434 * cx - 0.2040259 * luminance + 1.0572252 * cz;
    double least = rgb[0] < rgb[1] ? rgb[0] : rgb[1];
    least = least < rgb[2] ? least : rgb[2];
    if (least < 0.0) {
        const double keep = luminance / (luminance - least);
        for (int c = 0; c < 3; c++) {
            const double v = luminance + keep * (rgb[c] - luminance);
            rgb[c] = v > 0.0 ? v : 0.0; /* rounding may leave the smallest just below 0 */
        }
    }
}

/* ---- Weather files, standard skies and matrices ---- */

/* Environment frames from weather files (`epw:FILE`), of the standard skies (`cie:TYPE`), which are grey, and from
 * matrices of Radiance's gendaymtx (`mtx:FILE`), in W sr^-1 m^-2 with luminance = 179 cd m^-2 per unit, in lat-long
 * with OpenEXR's orientation, north +Z and east -X unless `north` turns them. Thread: any, after daylight_open. */

/* The keys of specs, one line each, for --help and the documentation. */
extern const char *const daylight_help;

struct daylight {
    char file[4096];          /* of epw: and mtx: */
    struct sky_matrix matrix; /* of mtx: */
    struct epw weather;       /* of epw: */
    struct moments year;      /* of epw: every moment that was chosen, dark ones included */
    size_t *lit;              /* [count]: those that make a frame; cie: one moment */
    size_t count;
    int cie;                /* type; 0: Perez et al. */
    double north;           /* radians: where north is, clockwise from +Z as seen from above */
    double ground_albedo;   /* grey, below the horizon, 0..1 */
    bool sun, sky;          /* which of them shines */
    double scale;           /* output units per W sr^-1 m^-2 */
    uint32_t width, height; /* texels; 2:1, even height */
};

/* Whether a spec is of this kind. */
bool daylight_is(const char *spec);

/* Reads "epw:FILE,key=value,...", "cie:TYPE,key=value,..." or "mtx:FILE,key=value,...", and the file. Missing hours are
 * named in the log. The caller frees *out with daylight_close. ERR_USAGE names an unknown key or a value out of range;
 * errors of epw_read, moments_choose and sky_matrix_read. */
MUST_CHECK enum err daylight_open(const char *spec, struct daylight **out, struct reason *why);
void daylight_close(struct daylight *d); /* NULL is allowed */

/* The moment of frame `index`, 0..count - 1. */
const struct moment *daylight_moment(const struct daylight *d, size_t index);

/* The unit direction towards the sun of a moment, in the scene: turned by `north`. */
void daylight_sun(const struct daylight *d, const struct moment *m, double w[3]);

/* Renders a moment to float[height][width][3], on all OpenMP threads. The horizontal illuminance of the upper half
 * without the sun's disc is exactly the moment's diffuse_lux. */
void daylight_render(const struct daylight *d, const struct moment *m, float *rgb);
