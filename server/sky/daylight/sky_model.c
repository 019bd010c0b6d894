#include "sky/daylight/sky.h"

#include "base/luminance.h"
#include "base/vec.h"

#include <math.h>

#define DEGREE (PI / 180.0)
#define SUN_KELVIN 5772.0 /* effective temperature of the sun [IAU 2015 B3] */
#define SUN_WATTS 1361.0  /* solar irradiance above the atmosphere, W m^-2 [IAU 2015 B3] */

static double clamp(double v, double least, double most)
{
    return v < least ? least : v > most ? most : v;
}

/* 0 below 0, 1 above 1, smooth in between. */
static double smooth_step(double t)
{
    t = clamp(t, 0.0, 1.0);
    return t * t * (3.0 - 2.0 * t);
}

/* ---- Transmission of the atmosphere ---- */

/* One term of the fits to the CIE 1931 colour-matching functions: a bell with different widths on both sides, nm [Wyman
 * et al. 2013, Eq. 4]. */
static double bell(double nm, double centre, double below, double above)
{
    const double t = (nm - centre) / (nm < centre ? below : above);
    return exp(-0.5 * t * t);
}

static void colour_matching(double nm, double xyz[3])
{
    xyz[0] =
        1.056 * bell(nm, 599.8, 37.9, 31.0) + 0.362 * bell(nm, 442.0, 16.0, 26.7) - 0.065 * bell(nm, 501.1, 20.4, 26.2);
    xyz[1] = 0.821 * bell(nm, 568.8, 46.9, 40.5) + 0.286 * bell(nm, 530.9, 16.3, 31.1);
    xyz[2] = 1.217 * bell(nm, 437.0, 11.8, 36.0) + 0.681 * bell(nm, 459.0, 26.0, 13.8);
}

/* The sun above the atmosphere as a black body with the sun's total, W m^-2 um^-1; um: wavelength. */
static double solar_spectrum(double um)
{
    const double t4 = SUN_KELVIN * SUN_KELVIN * SUN_KELVIN * SUN_KELVIN;
    const double emitted = 3.741772e8 / (pow(um, 5.0) * expm1(14387.769 / (um * SUN_KELVIN)));
    return SUN_WATTS * emitted / (5.670374e-8 * t4);
}

/* Optical path relative to the zenith [Kasten and Young 1989]. The fit turns back about two degrees below the horizon,
 * where no part of the disc is visible; it is clamped one degree below. */
static double air_mass(double elevation)
{
    const double h = clamp(elevation / DEGREE, -1.0, 90.0);
    return 1.0 / (sin(h * DEGREE) + 0.50572 * pow(h + 6.07995, -1.6364));
}

/* Zenith optical depth [Preetham et al. 1999, App. 1]: molecules, haze (Angstrom's law with exponent 1.3) and 3.5 mm of
 * ozone. Water vapour and mixed gases hardly absorb visible light and are omitted. Ozone's Chappuis band is a bell that
 * we fitted to the coefficients tabulated there. */
static double optical_depth(double um, double turbidity)
{
    const double beta = 0.04608 * turbidity - 0.04586;
    return 0.008735 * pow(um, -4.08) + beta * pow(um, -1.3) + 0.0035 * 12.5 * bell(1e3 * um, 593.0, 55.0, 55.0);
}

void sky_sun_radiance(double elevation, double turbidity, double rgb[3])
{
    const double mass = air_mass(elevation), step = 10.0; /* nm; the spectrum has no lines, so coarse steps suffice */
    double xyz[3] = { 0.0 };

    for (double nm = 380.0; nm <= 780.0; nm += step) {
        double match[3];
        const double um = 1e-3 * nm;
        const double watts = solar_spectrum(um) * exp(-mass * optical_depth(um, turbidity)) * 1e-3 * step;
        colour_matching(nm, match);
        for (int c = 0; c < 3; c++)
            xyz[c] += 683.0 / LUMINOUS_EFFICACY * watts * match[c];
    }
    const double solid_angle = 2.0 * PI * (1.0 - cos(SKY_SUN_RADIUS)), sum = xyz[0] + xyz[1] + xyz[2];
    sky_rgb_from_xyy(xyz[0] / sum, xyz[1] / sum, xyz[1] / solid_angle, rgb);
}

/* ---- Luminance of the sky ---- */

/* log10 of the illuminance in lux from the sun's elevation in degrees, -18 (clamped below) to 5 [Janiczek and DeYoung
 * 1987, Table 1]. The four pieces differ by up to 1 % where they meet and are blended over 0.6 degrees there. */
static double twilight_log10_lux(double degrees)
{
    static const double piece[4][4] = {
        { 13.84, 262.72, 1447.42, 2797.93 }, /* -18 to -12 */
        { 2.70, 12.17, -431.69, -1899.83 },  /* to -5 */
        { 2.88, 21.81, -258.11, -858.36 },   /* to -0.8 */
        { 2.88, 22.26, -207.64, 1034.30 },   /* to 5 */
    };
    static const double joint[4] = { -18.0, -12.0, -5.0, -0.8 };
    const double x = clamp(degrees, -18.0, 5.0) / 90.0;
    double value = 0.0;

    for (int i = 0; i < 4; i++) {
        const double p = piece[i][0] + x * (piece[i][1] + x * (piece[i][2] + x * piece[i][3]));
        value = i == 0 ? p : value + smooth_step((90.0 * x - joint[i] + 0.3) / 0.6) * (p - value);
    }
    return value;
}

/* Diffuse horizontal irradiance of the clear sky, W m^-2, with the sun above the horizon [Rigollier et al. 2000, Eq. 13
 * to 17]; our turbidity takes the place of Linke's at air mass 2. */
static double diffuse_watts(double sin_elevation, double t)
{
    const double zenith = -1.5843e-2 + t * (3.0543e-2 + t * 3.797e-4);
    const double a1 = 2.0402 + t * (1.8945e-2 - t * 1.1161e-2), a2 = -1.3025 + t * (3.9231e-2 + t * 8.5079e-3);
    double a0 = 2.6463e-1 + t * (-6.1581e-2 + t * 3.1408e-3);

    if (a0 * zenith < 2e-3)
        a0 = 2e-3 / zenith;
    return SUN_WATTS * zenith * (a0 + sin_elevation * (a1 + sin_elevation * a2));
}

double sky_illuminance(double elevation, double turbidity)
{
    const double efficacy = 130.0; /* lm/W of a clear sky [Littlefair 1985] */
    const double degrees = elevation / DEGREE, day = smooth_step(degrees / 5.0);
    const double twilight = log(10.0) * twilight_log10_lux(degrees);

    if (day == 0.0)
        return exp(twilight);
    return exp((1.0 - day) * twilight + day * log(efficacy * diffuse_watts(sin(elevation), turbidity)));
}

/* ---- Distribution and colour ---- */

/* A to E for luminance, x and y: slope over turbidity, and constant [Preetham et al. 1999, App. 2]. */
static const double perez_fit[3][5][2] = {
    { { 0.1787, -1.4630 }, { -0.3554, 0.4275 }, { -0.0227, 5.3251 }, { 0.1206, -2.5771 }, { -0.0670, 0.3703 } },
    { { -0.0193, -0.2592 }, { -0.0665, 0.0008 }, { -0.0004, 0.2125 }, { -0.0641, -0.8989 }, { -0.0033, 0.0452 } },
    { { -0.0167, -0.2608 }, { -0.0950, 0.0092 }, { -0.0079, 0.2102 }, { -0.0441, -1.6537 }, { -0.0109, 0.0529 } },
};

/* Zenith chromaticity x and y: rows T^2, T, 1; columns the cube, square, first and zeroth power of the sun's zenith
 * angle [ibid.]. */
static const double zenith_fit[2][3][4] = {
    { { 0.00166, -0.00375, 0.00209, 0.0 },
      { -0.02903, 0.06377, -0.03202, 0.00394 },
      { 0.11693, -0.21196, 0.06052, 0.25886 } },
    { { 0.00275, -0.00610, 0.00317, 0.0 },
      { -0.04214, 0.08970, -0.04153, 0.00516 },
      { 0.15346, -0.26756, 0.06670, 0.26688 } },
};

/* The two factors of F [ibid., Eq. 1]: by angle from the zenith and by angle from the sun. */
static double gradation(const double p[5], double cos_zenith)
{
    return 1.0 + p[0] * exp(p[1] / (cos_zenith > 1e-6 ? cos_zenith : 1e-6));
}

static double indicatrix(const double p[5], double angle)
{
    const double c = cos(angle);
    return 1.0 + p[2] * exp(p[3] * angle) + p[4] * c * c;
}

static double zenith_chromaticity(const double fit[3][4], double turbidity, double sun_zenith)
{
    double value = 0.0;

    for (int i = 0; i < 3; i++) {
        const double *row = fit[i];
        value = value * turbidity + ((row[0] * sun_zenith + row[1]) * sun_zenith + row[2]) * sun_zenith + row[3];
    }
    return value;
}

/* All terms of the dome except its level and the ground. */
static void dome_shape(const struct sky_desc *d, double elevation, struct sky_dome *dome)
{
    /* The fit's range: below it the gradation approaches 0 at the zenith, above it the colours become unnatural. */
    const double t = clamp(d->turbidity, 2.2, 6.0);
    const double zenith = 0.5 * PI - elevation, held = clamp(zenith, 0.0, 0.5 * PI);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 5; k++)
            dome->perez[i][k] = perez_fit[i][k][0] * t + perez_fit[i][k][1];
    dome->gain[0] = 1.0;
    for (int i = 0; i < 2; i++) {
        const double *p = dome->perez[i + 1];
        dome->gain[i + 1] = zenith_chromaticity(zenith_fit[i], t, held) / (gradation(p, 1.0) * indicatrix(p, zenith));
    }
    dome->twilight[0] = 0.85 * smooth_step((-2.0 * DEGREE - elevation) / (10.0 * DEGREE));
    dome->twilight[1] = 0.90 * smooth_step((20.0 * DEGREE - elevation) / (26.0 * DEGREE));
    sky_rgb_from_xyy(0.27, 0.28, 1.0, dome->night);
    for (int c = 0; c < 3; c++)
        dome->ground[c] = 0.0;
}

double sky_twilight_weight(const struct sky_dome *dome, double up)
{
    return dome->twilight[1] + (dome->twilight[0] - dome->twilight[1]) * exp(-4.0 * up);
}

double sky_warmth_kept(double angle)
{
    return 0.3 + 0.7 * exp(-1.5 * angle);
}

void sky_radiance(const struct sky_state *s, const double w[3], double rgb[3])
{
    const struct sky_dome *dome = &s->dome;
    double value[3], half = 0.0;

    if (w[1] < 0.0) {
        for (int c = 0; c < 3; c++)
            rgb[c] = dome->ground[c];
        return;
    }
    for (int i = 0; i < 3; i++)
        half += 0.25 * (w[i] - s->sun_direction[i]) * (w[i] - s->sun_direction[i]);
    const double angle = 2.0 * asin(sqrt(clamp(half, 0.0, 1.0))); /* accurate near 0, unlike acos */
    for (int i = 0; i < 3; i++)
        value[i] = dome->gain[i] * gradation(dome->perez[i], w[1]) * indicatrix(dome->perez[i], angle);
    const double blue = sky_twilight_weight(dome, w[1]);
    const double y = value[2] + blue * (SKY_TWILIGHT_Y - value[2]);
    double x = value[1] + blue * (SKY_TWILIGHT_X - value[1]);
    if (x > SKY_WHITE_X)
        x = SKY_WHITE_X + sky_warmth_kept(angle) * (x - SKY_WHITE_X);
    const double locus = sky_locus(x);
    sky_rgb_from_xyy(x, clamp(y, locus - SKY_LOCUS_BELOW, locus + SKY_LOCUS_ABOVE), value[0], rgb);
    for (int c = 0; c < 3; c++)
        rgb[c] += dome->night[c] * gradation(dome->perez[0], w[1]);
}

/* ---- Integration ---- */

#define RINGS 32   /* rings of the hemisphere, equal in height and so in solid angle */
#define SECTORS 48 /* per half ring; the other half is its mirror image */

/* Integrals over the upper hemisphere of radiance and of radiance times cosine. Midpoint rule; the sectors start at the
 * sun's azimuth, so that the error does not change as the sun moves. */
static void integrate(const struct sky_state *s, double mean[3], double irradiance[3])
{
    struct sky_state turned = *s;
    const double across = sqrt(s->sun_direction[0] * s->sun_direction[0] + s->sun_direction[2] * s->sun_direction[2]);

    turned.sun_direction[0] = 0.0;
    turned.sun_direction[2] = across;
    for (int c = 0; c < 3; c++)
        mean[c] = irradiance[c] = 0.0;
    for (int i = 0; i < RINGS; i++) {
        const double up = (i + 0.5) / RINGS, out = sqrt(1.0 - up * up);
        for (int k = 0; k < SECTORS; k++) {
            const double phi = (k + 0.5) * PI / SECTORS;
            const double w[3] = { out * sin(phi), up, out * cos(phi) };
            double rgb[3];
            sky_radiance(&turned, w, rgb);
            for (int c = 0; c < 3; c++) {
                mean[c] += rgb[c] / (RINGS * SECTORS);
                irradiance[c] += 2.0 * PI * up * rgb[c] / (RINGS * SECTORS);
            }
        }
    }
}

/* The visible share of the disc and the integral of the cosine over it, by slices at equal height above the horizon. A
 * slice at zenith angle z is 2 half(z) wide; z = centre - radius cos(t) makes the integrand smooth at the rim. */
static void disc_over_horizon(double elevation, double *visible, double *cosine)
{
    const double r = SKY_SUN_RADIUS;
    const double full = 2.0 * PI * (1.0 - cos(r));

    *visible = 1.0;
    *cosine = PI * sin(r) * sin(r) * sin(elevation); /* a cap entirely above the horizon */
    if (elevation >= r)
        return;
    *visible = *cosine = 0.0;
    if (elevation <= -r)
        return;
    /* Solid angle of the intersection of cap and hemisphere (Gauss and Bonnet). */
    const double se = sin(elevation), ce = cos(elevation);
    *visible =
        2.0 * (PI - acos(clamp(se / sin(r), -1.0, 1.0)) - acos(clamp(-se / ce * cos(r) / sin(r), -1.0, 1.0)) * cos(r)) /
        full;
    const int slices = 64;
    const double end = acos(clamp(-elevation / r, -1.0, 1.0));
    for (int i = 0; i < slices; i++) {
        const double t = (i + 0.5) * end / slices, z = 0.5 * PI - elevation - r * cos(t);
        const double half = acos(clamp((cos(r) - cos(z) * se) / (sin(z) * ce), -1.0, 1.0));
        *cosine += 2.0 * half * cos(z) * sin(z) * r * sin(t) * end / slices;
    }
}

static void fill_sun(const struct sky_desc *d, struct sky_state *s)
{
    double visible, cosine;

    s->sun_solid_angle = 2.0 * PI * (1.0 - cos(SKY_SUN_RADIUS));
    disc_over_horizon(s->sun_elevation, &visible, &cosine);
    s->sun_visible = clamp(visible, 0.0, 1.0);
    sky_sun_radiance(s->sun_elevation, d->turbidity, s->sun_radiance);
    double gain = d->scale;
    if (d->sun_ratio > 0.0) /* keeps the atmosphere's colour */
        gain = d->sun_ratio * luminance_of(LUMINANCE_REC709, s->sky_mean) /
               luminance_of(LUMINANCE_REC709, s->sun_radiance);
    for (int c = 0; c < 3; c++) {
        s->sun_radiance[c] *= gain;
        s->sun_irradiance[c] = s->sun_radiance[c] * cosine;
    }
}

void sky_state_fill(const struct sky_desc *d, struct sky_state *s)
{
    struct sky_dome *dome = &s->dome;
    double mean[3], irradiance[3];
    const double units = d->scale / LUMINOUS_EFFICACY; /* per cd m^-2 */

    dome_shape(d, s->sun_elevation, dome);
    /* Measure the distribution at level 1, then set the level: first the night's, whose distribution is the gradation
     * alone. */
    const double night[3] = { dome->night[0], dome->night[1], dome->night[2] };
    for (int c = 0; c < 3; c++)
        dome->night[c] = 0.0;
    integrate(s, mean, irradiance);
    dome->gain[0] =
        units * sky_illuminance(s->sun_elevation, d->turbidity) / luminance_of(LUMINANCE_REC709, irradiance);
    double spread = 0.0;
    for (int i = 0; i < RINGS; i++)
        spread += 2.0 * PI * (i + 0.5) / RINGS * gradation(dome->perez[0], (i + 0.5) / RINGS) / RINGS;
    for (int c = 0; c < 3; c++)
        dome->night[c] = units * d->night_lux * night[c] / spread;
    integrate(s, s->sky_mean, s->sky_irradiance);
    fill_sun(d, s);
    for (int c = 0; c < 3; c++)
        dome->ground[c] = d->ground_albedo * (s->sky_irradiance[c] + s->sun_irradiance[c]) / PI;
}
