/* A year of light: lights a scene and its sensors for every daylit hour of a weather file, and writes to a folder
 *     hours.csv, illuminance.csv   a row for each lit hour (ledger.c)
 *     sensors.csv                  a row for each sensor: its measures
 *     summary.json                 the measures of all sensors, and what year.py needs for its maps and page
 *     picture-MMDD-HHMM.*          chosen hours: .png as seen, .hdr, and -falsecolour.png: 1 to 10 000 cd/m2
 * As a job, the ranks take hours from one counter, compute the cache together, and write the images of their hours;
 * rank 0 writes everything else, with the bits of one process. All need the same folder.
 * One thread of control; light runs on all OpenMP threads. */
#pragma once

#include "base/err.h"
#include "base/luminance.h"
#include "job/ranks/ranks.h"
#include "relightd/settings/settings.h"
#include "sky/daylight/measures.h"

#include <stdbool.h>

struct annual_desc {
    struct setup setup;  /* METHOD_AUTO: the cache. Caustics are left out: the sensors do not get them */
    const char *folder;  /* made if it is missing */
    const char *sensors; /* of points_read; NULL: none */
    const char *images;  /* MM-DDTHH:MM, several with commas between; "seasons": three hours of four days; "none" */
    struct measures_desc measures;
    enum luminance_weights weights; /* of illuminances and luminances */
    bool resume;                    /* keep the rows of an earlier run with the same settings */
    struct ranks *ranks;            /* NULL: one process. Otherwise annual_run is collective */
};

/* Errors are those of daylight_open, points_read, set_create, relighter_run and ledger_open. ERR_USAGE: the source is
 * no weather file, or an image's hour is not among its lit hours. An error of one rank ends all (ranks_agree). */
MUST_CHECK enum err annual_run(const struct annual_desc *desc, struct reason *why);
