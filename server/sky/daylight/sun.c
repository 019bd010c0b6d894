#include "sky/daylight/sun.h"

#include "base/vec.h"

#include <math.h>

/* Days by which the series of [Spencer 1971] is behind the seasons of 2017 to 2032, of which the almanac's declinations
 * are nearest so (root mean square). */
#define SEASON 1.15

/* The time of year as an angle, from noon of 1 January. */
static double day_angle(int day, double hours)
{
    return 2.0 * PI * (day - 1 + SEASON + (hours - 12.0) / 24.0) / 365.0;
}

double sky_equation_of_time(int day, double hours)
{
    const double g = day_angle(day, hours);
    return 229.18 *
           (0.000075 + 0.001868 * cos(g) - 0.032077 * sin(g) - 0.014615 * cos(2.0 * g) - 0.04089 * sin(2.0 * g));
}

void sky_sun_place(double latitude, int day, double hours, double w[3])
{
    const double g = day_angle(day, hours);
    /* Declination [Spencer 1971] */
    const double decl = 0.006918 - 0.399912 * cos(g) + 0.070257 * sin(g) - 0.006758 * cos(2.0 * g) +
                        0.000907 * sin(2.0 * g) - 0.002697 * cos(3.0 * g) + 0.00148 * sin(3.0 * g);
    const double turn = (fmod(hours, 24.0) - 12.0) * PI / 12.0; /* hour angle, negative in the morning */
    const double east = -cos(decl) * sin(turn);
    const double north = sin(decl) * cos(latitude) - cos(decl) * cos(turn) * sin(latitude);

    w[0] = -east;
    w[1] = sin(latitude) * sin(decl) + cos(latitude) * cos(decl) * cos(turn);
    w[2] = north;
    const double length = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    for (int i = 0; i < 3; i++)
        w[i] /= length;
}

void sun_day_at(const struct sun_day *d, double clock, double w[3])
{
    const double local = clock + d->ahead,
                 solar = d->solar ? local : local + sky_equation_of_time(d->day, local) / 60.0, c = cos(d->turn),
                 s = sin(d->turn);
    double north[3];

    sky_sun_place(d->latitude, d->day - 2, solar + 48.0, north); /* the same moment: hours must not be negative */
    w[0] = c * north[0] + s * north[2];
    w[1] = north[1];
    w[2] = c * north[2] - s * north[0];
}

double sun_eccentricity(int day)
{
    const double g = 2.0 * PI * (day - 1) / 365.0;
    return 1.00011 + 0.034221 * cos(g) + 0.00128 * sin(g) + 0.000719 * cos(2.0 * g) + 0.000077 * sin(2.0 * g);
}

int day_of_year(int month, int day)
{
    static const int before[12] = { 0, 31, 59, 90, 120, 151, 181, 212, 243, 273, 304, 334 };

    return before[month - 1] + day; /* 29 February and 1 March are both the 60th */
}
