/* The tables of a year: hours.csv, a row for each lit moment, and illuminance.csv, the same rows with a column for each
 * sensor. Each row is appended as soon as it is computed, so that a killed run leaves whole rows. Thread: one. */
#pragma once

#include "base/digest.h"
#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

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
