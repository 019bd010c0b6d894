#include "sky/daylight/pattern.h"

#include "base/vec.h"
#include "sky/daylight/sun.h"

#include <math.h>

#define DEGREE (PI / 180.0)
#define SOLAR_CONSTANT 1367.0 /* W m^-2, as in [Perez et al. 1990] */
#define LOWEST_COS 0.10452846 /* of the zenith angle at 6 degrees of elevation */

/* ---- Perez et al. ---- */

/* Upper bounds of clearness [Perez et al. 1990, Table 1]. */
static const double clearness_end[7] = { 1.065, 1.23, 1.5, 1.95, 2.8, 4.5, 6.2 };

/* [Perez et al. 1993, Table 1]: x1 to x4 of a, b, c, d and e for each category. */
static const double perez_table[8][5][4] = {
    { { 1.3525, -0.2576, -0.2690, -1.4366 },
      { -0.7670, 0.0007, 1.2734, -0.1233 },
      { 2.8000, 0.6004, 1.2375, 1.0000 },
      { 1.8734, 0.6297, 0.9738, 0.2809 },
      { 0.0356, -0.1246, -0.5718, 0.9938 } },
    { { -1.2219, -0.7730, 1.4148, 1.1016 },
      { -0.2054, 0.0367, -3.9128, 0.9156 },
      { 6.9750, 0.1774, 6.4477, -0.1239 },
      { -1.5798, -0.5081, -1.7812, 0.1080 },
      { 0.2624, 0.0672, -0.2190, -0.4285 } },
    { { -1.1000, -0.2515, 0.8952, 0.0156 },
      { 0.2782, -0.1812, -4.5000, 1.1766 },
      { 24.7219, -13.0812, -37.7000, 34.8438 },
      { -5.0000, 1.5218, 3.9229, -2.6204 },
      { -0.0156, 0.1597, 0.4199, -0.5562 } },
    { { -0.5484, -0.6654, -0.2672, 0.7117 },
      { 0.7234, -0.6219, -5.6812, 2.6297 },
      { 33.3389, -18.3000, -62.2500, 52.0781 },
      { -3.5000, 0.0016, 1.1477, 0.1062 },
      { 0.4659, -0.3296, -0.0876, -0.0329 } },
    { { -0.6000, -0.3566, -2.5000, 2.3250 },
      { 0.2937, 0.0496, -5.6812, 1.8415 },
      { 21.0000, -4.7656, -21.5906, 7.2492 },
      { -3.5000, -0.1554, 1.4062, 0.3988 },
      { 0.0032, 0.0766, -0.0656, -0.1294 } },
    { { -1.0156, -0.3670, 1.0078, 1.4051 },
      { 0.2875, -0.5328, -3.8500, 3.3750 },
      { 14.0000, -0.9999, -7.1406, 7.5469 },
      { -3.4000, -0.1078, -1.0750, 1.5702 },
      { -0.0672, 0.4016, 0.3017, -0.4844 } },
    { { -1.0000, 0.0211, 0.5025, -0.5119 },
      { -0.3000, 0.1922, 0.7023, -1.6317 },
      { 19.0000, -5.0000, 1.2438, -1.9094 },
      { -4.0000, 0.0250, 0.3844, 0.2656 },
      { 1.0468, -0.3788, -2.4517, 1.4656 } },
    { { -1.0500, 0.0289, 0.4260, 0.3590 },
      { -0.3250, 0.1156, 0.7781, 0.0025 },
      { 31.0625, -14.5000, -46.1148, 55.3750 },
      { -7.2312, 0.4050, 13.3500, 0.6234 },
      { 1.5000, -0.6426, 1.8564, 0.5636 } },
};

/* [Perez et al. 1990, Table 4]: a, b, c, d of Eq. 7 and of Eq. 8. */
static const double diffuse_efficacy[8][4] = {
    { 97.24, -0.46, 12.00, -8.91 },   { 107.22, 1.15, 0.59, -3.95 },    { 104.97, 2.96, -5.53, -8.77 },
    { 102.39, 5.59, -13.95, -13.90 }, { 100.71, 5.94, -22.75, -23.74 }, { 106.42, 3.83, -36.15, -28.83 },
    { 141.88, 1.90, -53.24, -14.03 }, { 152.23, 0.35, -45.27, -7.98 },
};
static const double direct_efficacy[8][4] = {
    { 57.20, -4.55, -2.98, 117.12 }, { 98.99, -3.46, -1.21, 12.38 },  { 109.83, -4.90, -1.71, -8.81 },
    { 110.34, -5.84, -1.99, -4.56 }, { 106.36, -3.97, -1.75, -6.16 }, { 107.19, -1.25, -1.51, -26.73 },
    { 105.75, 0.77, -1.26, -34.44 }, { 101.18, 1.58, -1.10, -8.29 },
};

/* No sky beyond these was measured, and the formulas leave what skies do: files have such values at low suns. */
static double measured(double brightness)
{
    return fmin(0.6, fmax(0.01, brightness));
}

double perez_clearness(double zenith, double direct_normal, double diffuse)
{
    const double k = 1.041 * zenith * zenith * zenith;
    return ((diffuse + direct_normal) / diffuse + k) / (1.0 + k);
}

double perez_brightness(double zenith, double diffuse, int day)
{
    /* Relative air mass [Kasten 1966], whose formula ends shortly below the horizon. */
    const double degrees = fmin(zenith / DEGREE, 90.0);
    const double air_mass = 1.0 / (cos(degrees * DEGREE) + 0.15 * pow(93.885 - degrees, -1.253));
    return diffuse * air_mass / (SOLAR_CONSTANT * sun_eccentricity(day));
}

int perez_category(double clearness)
{
    int k = 0;

    while (k < 7 && clearness >= clearness_end[k])
        k++;
    return k;
}

void perez_pattern(double zenith, double clearness, double brightness, struct sky_pattern *out)
{
    const int k = perez_category(clearness);
    const double(*x)[4] = perez_table[k];
    double p[5];

    if (clearness > 1.065 && clearness < 2.8)
        brightness = fmax(brightness, 0.2); /* the paper's limit */
    brightness = measured(brightness);
    for (int i = 0; i < 5; i++) /* Eq. 6 */
        p[i] = x[i][0] + x[i][1] * zenith + brightness * (x[i][2] + x[i][3] * zenith);
    if (k == 0) {
        p[2] = exp(pow(brightness * (x[2][0] + x[2][1] * zenith), x[2][2])) - x[2][3];           /* Eq. 7 */
        p[3] = -exp(brightness * (x[3][0] + x[3][1] * zenith)) + x[3][2] + brightness * x[3][3]; /* Eq. 8 */
    }
    *out = (struct sky_pattern){ .a = p[0], .b = p[1], .base = 1.0, .c = p[2], .d = p[3], .e = p[4] };
}

static double positive(double v)
{
    return v > 0.0 ? v : 0.0;
}

/* Precipitable water from the dew point [Perez et al. 1990, Eq. 3], cm. */
static double water(double dew_point)
{
    return exp(0.07 * dew_point - 0.075);
}

double perez_diffuse_efficacy(double zenith, double clearness, double brightness, double dew_point)
{
    const double *q = diffuse_efficacy[perez_category(clearness)];
    return positive(q[0] + q[1] * water(dew_point) + q[2] * cos(zenith) + q[3] * log(measured(brightness)));
}

double perez_direct_efficacy(double zenith, double clearness, double brightness, double dew_point)
{
    const double *q = direct_efficacy[perez_category(clearness)];
    return positive(q[0] + q[1] * water(dew_point) + q[2] * exp(5.73 * zenith - 5.0) + q[3] * measured(brightness));
}

/* ---- ISO 15469 ---- */

static const struct {
    const char *name;
    double a, b, c, d, e;
} cie_table[CIE_SKIES] = {
    { "CIE Standard Overcast Sky", 4.0, -0.70, 0.0, -1.0, 0.0 },
    { "overcast, steep gradation, slightly brighter towards the sun", 4.0, -0.70, 2.0, -1.5, 0.15 },
    { "overcast, moderately graded, uniform in azimuth", 1.1, -0.8, 0.0, -1.0, 0.0 },
    { "overcast, moderately graded, slightly brighter towards the sun", 1.1, -0.8, 2.0, -1.5, 0.15 },
    { "uniform", 0.0, -1.0, 0.0, -1.0, 0.0 },
    { "partly cloudy, no gradation, slightly brighter towards the sun", 0.0, -1.0, 2.0, -1.5, 0.15 },
    { "partly cloudy, no gradation, brighter around the sun", 0.0, -1.0, 5.0, -2.5, 0.30 },
    { "partly cloudy, no gradation, distinct corona", 0.0, -1.0, 10.0, -3.0, 0.45 },
    { "partly cloudy, with the sun hidden", -1.0, -0.55, 2.0, -1.5, 0.15 },
    { "partly cloudy, brighter around the sun", -1.0, -0.55, 5.0, -2.5, 0.30 },
    { "white-blue sky, distinct corona", -1.0, -0.55, 10.0, -3.0, 0.45 },
    { "CIE Standard Clear Sky, low turbidity", -1.0, -0.32, 10.0, -3.0, 0.45 },
    { "CIE Standard Clear Sky, polluted atmosphere", -1.0, -0.32, 16.0, -3.0, 0.30 },
    { "cloudless, turbid, broad corona", -1.0, -0.15, 16.0, -3.0, 0.30 },
    { "white-blue, turbid, broad corona", -1.0, -0.15, 24.0, -2.8, 0.15 },
    { "CIE Traditional Overcast Sky", 2.0, 0.0, 0.0, -1.0, 0.0 },
};

void cie_pattern(int type, struct sky_pattern *out)
{
    const double c = cie_table[type - 1].c, d = cie_table[type - 1].d;

    /* f(g) = 1 + c (exp(d g) - exp(d pi/2)) + e cos^2 g */
    *out = (struct sky_pattern){ .a = cie_table[type - 1].a,
                                 .b = cie_table[type - 1].b,
                                 .base = 1.0 - c * exp(d * 0.5 * PI),
                                 .c = c,
                                 .d = d,
                                 .e = cie_table[type - 1].e };
    if (type == CIE_SKIES)
        out->b = INFINITY; /* the sign of the other gradation */
}

const char *cie_name(int type)
{
    return cie_table[type - 1].name;
}

/* ---- Values ---- */

double pattern_gradation(const struct sky_pattern *p, double cos_z)
{
    if (isinf(p->b))
        return 1.0 + p->a * cos_z;
    return positive(1.0 + p->a * exp(p->b / fmax(cos_z, p->b > 0.0 ? LOWEST_COS : 1e-4)));
}

double pattern_indicatrix(const struct sky_pattern *p, double angle)
{
    const double c = cos(angle);
    return positive(p->base + p->c * exp(p->d * angle) + p->e * c * c);
}
