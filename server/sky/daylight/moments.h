/* The moments of a year that a weather file describes: sun, irradiance and illuminance of each. Thread: any. */
#pragma once

#include "base/err.h"
#include "sky/daylight/pattern.h"
#include "sky/daylight/sun.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* ---- Weather files ---- */

/* EnergyPlus weather files (.epw) [EnergyPlus 2024]: a header with the place, then one line for each hour. Only what
 * light needs is read. Thread: any. */

/* The measurements of one record: means over an interval that ends at `end`. Missing ones are NAN. */
struct epw_record {
    int month, day;                        /* 1..12, 1..31 */
    double end;                            /* local standard time, hours, above 0 and at most 24 */
    double direct_normal;                  /* irradiance, W m^-2 */
    double diffuse;                        /* horizontal irradiance, W m^-2 */
    double direct_normal_lux, diffuse_lux; /* illuminance, lx; NAN in files that do not state it */
    double dew_point;                      /* degrees Celsius; NAN: missing */
    uint32_t line;                         /* in the file, from 1 */
};

struct epw {
    char place[100];  /* city and country */
    double latitude;  /* degrees, north positive */
    double longitude; /* degrees, east positive */
    double zone;      /* hours ahead of UTC */
    double interval;  /* hours that a record covers */
    struct epw_record *records;
    size_t count, capacity;
    size_t mended; /* measurements that were blank or negative: a little below 0 became 0, others are missing */
};

/* Reads a file. The caller frees *out with epw_finish. ERR_IO: cannot be read; ERR_FORMAT names line and field;
 * ERR_RANGE: a value that no weather has, or a file above 64 MB; ERR_NOMEM. On an error *out is empty. */
MUST_CHECK enum err epw_read(const char *path, struct epw *out, struct reason *why);
struct sun_day epw_day(const struct epw *w, int day); /* of the year, by local standard time, north at +Z */
void epw_finish(struct epw *w); /* zeroed memory is allowed */

/* The same from memory, which is changed. name: of the file, for messages. */
MUST_CHECK enum err epw_parse(const char *name, char *text, size_t size, struct epw *out, struct reason *why);

/* From irradiance to illuminance. */
enum efficacy_kind {
    EFFICACY_PEREZ, /* [Perez et al. 1990], as Radiance's gendaymtx and gendaylit do */
    EFFICACY_FILE,  /* the file's illuminances; [Perez et al. 1990] in hours where they are missing */
    EFFICACY_FIXED, /* a number */
};

struct moments_desc {
    int first_day, last_day;      /* of the year, 1..365; last before first: over the end of the year */
    bool leap_day;                /* they are 29 February, in place of 1 March */
    double first_hour, last_hour; /* moments whose middle lies between these clock hours, 0..24 */
    double step_minutes;          /* divides a day; 0: the interval of the file's records */
    enum efficacy_kind efficacy;
    double lm_per_w; /* EFFICACY_FIXED */
};

struct moment {
    uint64_t number; /* of the step within the year, from 0 at midnight of 1 January */
    int month, day;
    double clock;                          /* local standard time of the middle, hours */
    double span;                           /* hours that it stands for */
    bool missing;                          /* the file has no irradiance for it */
    bool lit;                              /* neither missing nor dark */
    double direct_normal, diffuse;         /* irradiance, W m^-2; diffuse is horizontal */
    double direct_normal_lux, diffuse_lux; /* illuminance, lx */
    double sun[3];   /* unit, towards the sun: Y up, north +Z, east -X. At sunrise and sunset in the middle of the part
                        of the interval in which it is up */
    double altitude; /* of the sun, radians */
    double clearness, brightness; /* [Perez et al. 1990, Eq. 1 and 2]; 0 in the dark */
};

struct moments {
    struct moment *at;
    size_t count, capacity;
    double step;    /* hours */
    size_t missing; /* of them */
    size_t leap;    /* records of 29 February, which were left out */
};

/* Chooses the moments of a file, ascending, those in the dark and the missing ones included. name: of the file, for
 * messages. The caller frees *out with moments_finish. ERR_FORMAT: the records are not in the order of time; ERR_USAGE:
 * nothing was chosen; ERR_NOMEM. */
MUST_CHECK enum err moments_choose(const struct epw *w, const struct moments_desc *desc, const char *name,
                                   struct moments *out, struct reason *why);
void moments_finish(struct moments *m); /* zeroed memory is allowed */

/* Horizontal illuminance in the open by the sun, the sky, or both, lx. */
double moment_open_lux(const struct moment *m, bool sun, bool sky);

/* "21 March, 9:30" into out. */
void moment_name(const struct moment *m, char *out, size_t size);

/* "3 January, 10:30; 3 January, 11:30 and 17 more" into out: those that are missing. */
void moments_name_missing(const struct moments *m, char *out, size_t size);
