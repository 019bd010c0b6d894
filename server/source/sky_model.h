/* server/source/sky_model.h */
/* The physics behind sky.h, each from its paper: where the sun stands, what the air lets through of it, and how bright
 * and of what colour the clear sky is. Inside this room only. Any thread; no state. */
#ifndef SOURCE_SKY_MODEL_H
#define SOURCE_SKY_MODEL_H

#include "sky.h"

#define SKY_SUN_RADIUS 0.0046513 /* radians: half of 0.533 degrees */
#define SKY_EFFICACY 179.0       /* lm/W: luminance in cd m^-2 over the radiance of a white [Ward 1994] */

/* Unit direction of the sun (Y up, north +Z, east -X) for a latitude in radians at `hours` of local solar time since
 * midnight of day 1 (1 January = 1) of a year of 365 days [Spencer 1971]. */
void sky_sun_place(double latitude, int day, double hours, double w[3]);

/* Solar time minus mean time at that moment, minutes [Spencer 1971]. */
double sky_equation_of_time(int day, double hours);

/* Luminance (linear Rec.709, W sr^-1 m^-2 as in sky.h) of the sun's disc through the air, elevation in radians. */
void sky_sun_radiance(double elevation, double turbidity, double rgb[3]);

/* Illuminance by the clear sky, without sun and night, on the horizontal plane, lux; elevation in radians. */
double sky_illuminance(double elevation, double turbidity);

/* Everything of *s that follows from its sun_direction and sun_elevation. */
void sky_state_fill(const struct sky_desc *d, struct sky_state *s);

/* Twilight's blue, which the ozone gives the sky when the sun is low [Hulburt 1953], CIE x and y. */
#define SKY_TWILIGHT_X 0.245
#define SKY_TWILIGHT_Y 0.245

/* Its weight in the row whose cosine to the zenith is `up`: it begins high up, the horizon stays warm longer. */
double sky_twilight_weight(const struct sky_dome *dome, double up);

/* How far from the CIE daylight locus y may lie. Natural skies keep near that locus; the fit leaves it towards yellow
 * and green at low sun and in haze, and towards pink at the horizon of a clear day. */
#define SKY_LOCUS_ABOVE 0.006
#define SKY_LOCUS_BELOW 0.004

/* y of the daylight locus [Judd et al. 1964], x in 0.2..0.7. */
static inline double sky_locus(double x)
{
    return (-3.0 * x + 2.870) * x - 0.275;
}

/* Where x exceeds that of an even white, only this share of the excess is kept at an angle from the sun: the fit makes
 * the whole horizon as warm as the sun's side of it, while reddened light is scattered forward. */
#define SKY_WHITE_X (1.0 / 3.0)

double sky_warmth_kept(double angle);

/* CIE xyY to linear Rec.709; what lies outside its gamut is drawn towards grey of the same luminance until the smallest
 * channel is 0: continuous, never negative for Y >= 0, y > 0. */
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
            rgb[c] = v > 0.0 ? v : 0.0; /* the smallest may round to just below 0 */
        }
    }
}

#endif
