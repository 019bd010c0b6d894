/* How luminance is distributed over the sky. The model of Perez et al. and the skies of ISO 15469 have one form,
 *     L(z, g) / L0 = (1 + a exp(b / cos z)) (base + c exp(d g) + e cos^2 g)
 * with zenith angle z and angle g to the sun: a gradation from zenith to horizon, and an indicatrix around the sun.
 * Thread: any. */
#pragma once

struct sky_pattern {
    double a, b, base, c, d, e;
};

/* Sky clearness and brightness [Perez et al. 1990, Eq. 1 and 2]. zenith: of the sun, radians. Irradiances W m^-2;
 * diffuse > 0. day: of the year. */
double perez_clearness(double zenith, double direct_normal, double diffuse);
double perez_brightness(double zenith, double diffuse, int day);

/* The category of a clearness, 0 (overcast) to 7 (clear) [ibid., Table 1]. */
int perez_category(double clearness);

/* The sky for them [Perez et al. 1993, Eq. 1 to 8 and Table 1]. zenith: radians. Here and below a brightness counts as
 * 0.01 at least and 0.6 at most. */
void perez_pattern(double zenith, double clearness, double brightness, struct sky_pattern *out);

#define CIE_SKIES 16 /* types 1 to 15 of the standard, and 16, the traditional overcast sky (1 + 2 cos z) / 3 */

/* A sky of ISO 15469 [CIE S 011, Table 1]. type: 1..CIE_SKIES. 16, of another form, is marked by an infinite b. */
void cie_pattern(int type, struct sky_pattern *out);
/* What the standard calls it. */
const char *cie_name(int type);

/* The two factors. cos_z: above 0. The gradation is never negative; where it rises without bound towards the horizon
 * (b > 0), it is held below 6 degrees of elevation, the lowest that was measured. */
double pattern_gradation(const struct sky_pattern *p, double cos_z);
double pattern_indicatrix(const struct sky_pattern *p, double angle);

/* Luminous efficacy of daylight, lm/W [Perez et al. 1990, Eq. 7 and 8, Table 4]. zenith: of the sun, radians;
 * dew_point: degrees Celsius. Never negative. */
double perez_diffuse_efficacy(double zenith, double clearness, double brightness, double dew_point);
double perez_direct_efficacy(double zenith, double clearness, double brightness, double dew_point);
