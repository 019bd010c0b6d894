/* The physics behind sky.h, each part from its paper: atmospheric transmission, and the luminance
 * and colour of the clear sky. Private to this room. Stateless. Thread: any. */
#pragma once

#include "sky/daylight/sun.h"
#include "sky/source/sky.h"

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
