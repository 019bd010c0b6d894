/* server/annual/annual_parts.h */
/* Inside a year: what the files of this room share. Private. One thread. */
#ifndef ANNUAL_ANNUAL_PARTS_H
#define ANNUAL_ANNUAL_PARTS_H

#include "annual/annual.h"
#include "annual/ledger.h"
#include "annual/points.h"
#include "base/progress.h"
#include "codec/frame.h"
#include "source/daylight.h"

#define PICTURES_MAX 64

struct annual_picture { /* that is asked for */
    int month, day;
    double clock; /* hours */
    bool done;    /* written in this run */
};

struct annual {
    struct annual_desc desc;
    struct daylight *weather;
    struct set *set;
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
    struct annual_picture pictures[PICTURES_MAX];
    int picture_count;
    size_t resumed; /* rows of an earlier run */
    size_t next_kept;
};

/* report.c: all files but the tables. Errors of file_store and png_encode. */
MUST_CHECK enum err annual_report(struct annual *a, struct reason *why);

/* pictures.c. annual_pictures_read: desc.pictures; ERR_USAGE. annual_picture_of: the picture of a moment, NULL: none is
 * asked for. annual_picture_write: the files of a moment, from a->rgb. */
MUST_CHECK enum err annual_pictures_read(struct annual *a, struct reason *why);
struct annual_picture *annual_picture_of(struct annual *a, const struct moment *m);
MUST_CHECK enum err annual_picture_write(struct annual *a, const struct moment *m, struct reason *why);
void annual_picture_name(const struct annual_picture *p, char *out, size_t size); /* "picture-0321-0930" */

#endif
