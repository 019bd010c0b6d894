#include "sky/daylight/sun.h"

#include "base/vec.h"

#include <math.h>

/* The time of year as an angle, from noon of 1 January. */
static double day_angle(int day, double hours)
{
    return 2.0 * PI * (day - 1 + (hours - 12.0) / 24.0) / 365.0;
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
    /* Declination [Spencer 1971]: within 0.03 degrees of the almanac at the solstices and 0.5 at the equinoxes, whose
     * date varies by a day from year to year. */
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
