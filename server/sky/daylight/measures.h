/* Daylight measures of a year at points of measurement (sensors), from their illuminances. Thread: one per object. */
#pragma once

#include <stdbool.h>
#include <stddef.h>

/* Bounds of useful daylight illuminance, lx [Mardaljevic et al. 2012]. */
#define UDI_FELL_SHORT 100.0
#define UDI_SUPPLEMENTARY 300.0
#define UDI_EXCEEDED 3000.0

struct measures_desc {
    double first_hour, last_hour; /* of occupancy, clock hours; LM-83: 8 and 18 */
    double autonomy_lux;          /* LM-83: 300 */
    double autonomy_share;        /* of the occupied time; LM-83: 0.5 */
    double sun_lux;               /* of the sun's disc alone; LM-83: 1000 */
    double sun_hours;             /* a year; LM-83: 250 */
};

/* Those of IES LM-83. */
extern const struct measures_desc measures_lm83;

struct sensor_year {
    double autonomous; /* occupied hours with at least autonomy_lux */
    double udi[4];     /* occupied hours below 100 lx, 100 to 300, 300 to 3000, above 3000 */
    double sunlit;     /* occupied hours with at least sun_lux from the sun's disc alone */
    double lux_hours;  /* of all hours */
    double lux_max;
};

/* Counts a moment. lux, sun_lux: [count], lx; NULL: the dark. */
void measures_add(const struct measures_desc *d, double clock, double span, const float *lux, const float *sun_lux,
                  size_t count, struct sensor_year *sensors);

/* Whether a moment counts as occupied: its middle lies within the hours. */
bool measures_occupied(const struct measures_desc *d, double clock);

struct measures_summary { /* shares are 0..1 */
    double sda;           /* spatial daylight autonomy: of sensors that are autonomous for the share of the time */
    double ase;           /* annual sunlight exposure: of sensors that are sunlit for more than the hours */
    double udi[4];        /* mean over sensors of the shares of time */
    double autonomy;      /* mean over sensors of the share of time */
    double lux_hours;     /* mean over sensors */
};

/* occupied: hours of the year that were counted, > 0; a partial year's sun_hours are in proportion to
 * occupied / 3650. */
void measures_summarise(const struct measures_desc *d, const struct sensor_year *sensors, size_t count, double occupied,
                        struct measures_summary *out);
