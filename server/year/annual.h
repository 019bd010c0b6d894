/* A year of light: lights a scene and its sensors for every daylit hour of a weather file, and writes to a folder
 *     hours.csv, illuminance.csv   a row for each lit hour (ledger.c)
 *     sensors.csv                  a row for each sensor: its measures
 *     summary.json                 the measures of all sensors, and what year.py needs for its maps and page
 *     picture-MMDD-HHMM.*          chosen hours: .png as seen, .hdr, and -falsecolour.png: 1 to 10 000 cd/m2
 * As a job, the ranks take hours from one counter, compute the cache together, and write the images of their hours;
 * rank 0 writes everything else, with the bits of one process. All need the same folder.
 * One thread of control; light runs on all OpenMP threads. */
#pragma once

#include "base/digest.h"
#include "base/err.h"
#include "base/luminance.h"
#include "base/progress.h"
#include "image/codec/frame.h"
#include "job/ranks/ranks.h"
#include "job/team/team.h"
#include "relightd/settings/settings.h"
#include "scene/geometry/view.h"
#include "sky/daylight/measures.h"
#include "sky/daylight/sky.h"
#include "year/points.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

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

/* Data and functions that the files of this room share. Private. One thread. */

/* ---- Tables ---- */

/* The tables of a year: hours.csv, a row for each lit moment, and illuminance.csv, the same rows with a column for each
 * sensor. Each row is appended as soon as it is computed, so that a killed run leaves whole rows. Thread: one. */

/* Columns of hours.csv. */
enum ledger_column {
    LEDGER_NUMBER, /* of the moment within the year: the frame's number */
    LEDGER_MONTH,
    LEDGER_DAY,
    LEDGER_CLOCK,         /* local standard time of the middle, hours */
    LEDGER_ALTITUDE,      /* of the sun, degrees */
    LEDGER_AZIMUTH,       /* from north over east, degrees */
    LEDGER_DIRECT_NORMAL, /* W m^-2 */
    LEDGER_DIFFUSE,       /* W m^-2 */
    LEDGER_OPEN_LUX,      /* horizontal in the open, of the weather (of what only= leaves), */
    LEDGER_RENDERED_LUX,  /* and of the sky that lit the scene */
    LEDGER_MEAN_LUX,      /* of the sensors */
    LEDGER_LEAST_LUX,
    LEDGER_MOST_LUX,
    LEDGER_MEAN_CDM2, /* luminance of the image */
    LEDGER_DGP,       /* of a fisheye view; NAN: none */
    LEDGER_EYE_LUX,   /* vertical illuminance at its eye; NAN: none */
    LEDGER_COLUMNS
};

struct ledger_row {
    double value[LEDGER_COLUMNS];
};

struct ledger {
    char folder[4096];
    struct ledger_row *rows; /* in the order of time */
    size_t count, capacity;
    size_t sensors;
    FILE *hours, *lux;
};

/* Takes a row that an earlier run left. lux: [sensors]; the very values that it had. */
typedef void ledger_replay(void *self, const struct ledger_row *row, const float *lux);

/* Opens the tables in a folder that exists. resume: keeps the rows of an earlier run with the same key and replays
 * them; without, the tables begin anew. ERR_USAGE: the earlier run had another key; ERR_IO, ERR_NOMEM. ledger_close
 * frees what it holds, also after an error. */
MUST_CHECK enum err ledger_open(struct ledger *l, const char *folder, const struct digest *key, size_t sensors,
                                bool resume, ledger_replay *replay, void *self, struct reason *why);

/* Appends a row to both tables; on return it is with the system. ERR_IO, ERR_NOMEM. */
MUST_CHECK enum err ledger_add(struct ledger *l, const struct ledger_row *row, const float *lux, struct reason *why);
void ledger_close(struct ledger *l); /* zeroed memory is allowed */

/* "folder/name" into out[4096 + 64]. */
void ledger_path(const char *folder, const char *name, char *out);
#define LEDGER_PATH (4096 + 64) /* PATH_MAX of Linux and a name */

#define IMAGES_MAX 64 /* bounds a table */

struct annual_image { /* one requested image */
    int month, day;
    double clock; /* hours */
    bool done;    /* written in this run */
};

struct annual {
    struct annual_desc desc;
    struct daylight *weather;
    struct prepared_scene *set;
    struct relighter *relighter;
    struct environment *environment;
    double *weights; /* of irradiance_upward */
    struct points points;
    uint32_t first_packet;    /* of the sensors */
    struct glare_view *glare; /* NULL: no fisheye view */
    struct ledger ledger;
    struct sensor_year *sensors; /* [points.count], at least 1 */
    float *lux, *sun_lux;        /* likewise, of a moment */
    float *factor;               /* daylight factors, likewise */
    double occupied;             /* hours that were counted */
    float *rgb;                  /* [height][width][3] */
    float *cdm2;                 /* [height][width] */
    struct frame frame;
    struct relight_desc light;
    struct annual_image images[IMAGES_MAX];
    int image_count;
    size_t resumed;           /* rows of an earlier run: those of the first moments */
    struct cache_share share; /* with the other ranks of a job */
    struct lit_moment **lit;  /* [weather->count]: those that came before their turn; rank 0's */
    size_t next;              /* the moment whose row comes next; rank 0's */
};

/* annual.c. Counts a moment for the sensors' measures; without lux it is dark. */
void annual_count(struct annual *a, const struct moment *m, const float *lux, const float *sun_lux);

/* order.c: rows in the order of time, whichever rank has lit the moments. annual_order_begin, on rank 0 or without a
 * job: ERR_NOMEM. annual_order_add takes moment i as a->lux and a->sun_lux have it; on other ranks it sends these to
 * rank 0. annual_order_end, on all ranks at the end: rank 0 waits for the others' moments; after an error of its own in
 * vain. Errors of ledger_add; ERR_RANGE; ERR_NOMEM. */
MUST_CHECK enum err annual_order_begin(struct annual *a, struct reason *why);
MUST_CHECK enum err annual_order_add(struct annual *a, size_t i, const struct ledger_row *row, struct reason *why);
MUST_CHECK enum err annual_order_end(struct annual *a, enum err own, struct reason *why);
void annual_order_finish(struct annual *a);

/* report.c: the sensors' measures and the summary. Errors of file_store. */
MUST_CHECK enum err annual_report(struct annual *a, struct reason *why);

/* images.c. annual_images_read: desc.images; ERR_USAGE. annual_image_of: the image requested for a moment;
 * NULL: none. annual_image_write: the files of a moment, from a->rgb. false_colour_write: false_colour_map (film.h) as
 * a PNG file. */
MUST_CHECK enum err annual_images_read(struct annual *a, struct reason *why);
struct annual_image *annual_image_of(struct annual *a, const struct moment *m);
MUST_CHECK enum err annual_image_write(struct annual *a, const struct moment *m, struct reason *why);
MUST_CHECK enum err false_colour_write(const float *values, uint32_t width, uint32_t height, double most, int steps,
                                       const char *path, struct reason *why);
void annual_image_name(const struct annual_image *p, char *out, size_t size); /* "picture-0321-0930" */

/* ---- Glare ---- */

/* The daylight glare probability of a fisheye view's images. Thread: one per object. */

struct glare_view;

/* *out is NULL for a view that is no fisheye: it does not see all that reaches the eye. ERR_NOMEM. */
MUST_CHECK enum err glare_view_create(const struct view *v, struct glare_view **out);
void glare_view_destroy(struct glare_view *g); /* NULL is allowed */

/* cdm2: [height][width]. ERR_NOMEM. */
MUST_CHECK enum err glare_view_measure(const struct glare_view *g, const float *cdm2, struct glare *out);
