/* The moments of a year that a weather file describes: sun, irradiance and illuminance of each. Thread: any. */
#pragma once

#include "sky/daylight/epw.h"
#include "sky/daylight/pattern.h"

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
