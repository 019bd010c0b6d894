/* server/film/pilot_model.h */
/* What is known of one way to make a part of the picture: error and time against its count. Readings are few, noisy and
 * grow old. Plain data; zeroed memory knows nothing. */
#ifndef FILM_PILOT_MODEL_H
#define FILM_PILOT_MODEL_H

#include <stdbool.h>
#include <stdint.h>

#define MODEL_READINGS 32

struct reading {
    double n, error, energy; /* relMSE at n; relMSE of leaving the part out */
};

struct model {
    struct reading reading[MODEL_READINGS]; /* a ring: the newest take the places of the oldest */
    uint32_t count, next;                   /* in the ring; where the next goes */
    uint32_t fresh;                         /* readings since the sky changed, */
    uint32_t chosen;                        /* and since the way was chosen, at most as many as the ring holds */
    double variance, order;                 /* error = variance n^-order */
    double energy, energy_most;             /* as read; and what it may well be, with so few readings */
    double begin_s, unit_s;                 /* seconds = begin_s + unit_s n, when the machine's pace is 1 */
    bool known;                             /* the error is, be it from another sky */
    bool timed, ran;                        /* the times are; from a whole picture too */
};

void model_read(struct model *m, double n, double error, double energy);

/* A timed run: begin_s once, run_s for n on a share 0..1 of the points. */
void model_time(struct model *m, double begin_s, double n, double run_s, double share);

/* A whole picture's. */
void model_ran(struct model *m, double n, double seconds);

/* All readings count as one that is to be replaced: the sky is another. */
void model_age(struct model *m);

double model_error(const struct model *m, double n);
/* The same for a report: by what has been read since the way was chosen, since it was chosen for what had been read
 * before, and of several noisy promises the best is better than the truth. */
double model_error_told(const struct model *m, double n);
double model_seconds(const struct model *m, double n);

#endif
