/* Daylight measures of a year at points of measurement (sensors), from their illuminances. Thread: one per object. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

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

/* ---- Glare ---- */

/* Daylight glare probability [Wienold and Christoffersen 2006]:
 *     DGP = 5.87e-5 Ev + 9.18e-2 log10(1 + sum over sources  Ls^2 ws / (Ev^1.87 P^2)) + 0.16
 * with the vertical illuminance Ev at the eye, and the luminance Ls, solid angle ws and position index P of each source
 * of glare: connected pixels above a luminance. Thread: any, on separate outputs. */

#define GLARE_THRESHOLD 2000.0 /* cd/m^2, evalglare's default */

struct glare_desc {
    uint32_t width, height;
    const float *luminance;      /* [height][width], cd/m^2 */
    const float *solid_angle;    /* [height][width], sr; 0 outside the view */
    const float (*direction)[3]; /* [height][width], unit, from the eye */
    double ahead[3], up[3];      /* unit: the line of sight, and up, perpendicular to it */
};

struct glare {
    double vertical_lux; /* Ev, from what the image shows */
    double dgp;
    uint32_t sources;
    double source_sr;  /* solid angle of all sources */
    double source_lum; /* their mean luminance, cd/m^2 */
};

/* ERR_NOMEM. */
MUST_CHECK enum err glare_measure(const struct glare_desc *d, struct glare *out);

/* The position index of a direction: Guth's above the line of sight, Iwata's below [Wienold and Christoffersen 2006].
 * At least 1 and at most 16. */
double glare_position_index(const double w[3], const double ahead[3], const double up[3]);

/* The formula, without its sum: of sources that add up to `sum`. */
double glare_probability(double vertical_lux, double sum);
