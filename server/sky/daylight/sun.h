/* Where the sun is. Y up, north +Z, east -X. Thread: any. */
#pragma once

#include <stdbool.h>

#define SUN_RADIUS 0.0046513 /* radians: half of the disc's 0.533 degrees */

/* Unit direction of the sun. latitude: radians; hours: local solar time since midnight of day 1 (1 January = 1) of a
 * 365-day year [Spencer 1971]. */
void sky_sun_place(double latitude, int day, double hours, double w[3]);

/* The equation of time: solar minus mean time, minutes [Spencer 1971]. */
double sky_equation_of_time(int day, double hours);

/* A day at a place, by a clock. */
struct sun_day {
    double latitude; /* radians */
    int day;         /* of the year, from 1 */
    bool solar;      /* the clock shows solar time, else mean time, */
    double ahead;    /* of which local mean time is so many hours ahead */
    double turn;     /* radians about +Y, right-handed: from north at +Z to north in the scene */
};

/* Unit direction of the sun, in the scene. clock: hours, from -24 on; beyond 24 the next day's. */
void sun_day_at(const struct sun_day *d, double clock, double w[3]);

/* The sun's irradiance outside the atmosphere over its mean of the year, by the distance from the sun [Spencer 1971].
 */
double sun_eccentricity(int day);

/* 1 January is 1 of 365; 29 February counts as 1 March. month 1..12, day 1..31. */
int day_of_year(int month, int day);
