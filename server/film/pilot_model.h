/* server/film/pilot_model.h */
/* What is known of one way to make a part of the picture: error and time against its count. Readings are few, noisy and
 * grow old. Plain data; zeroed memory knows nothing. */
#ifndef FILM_PILOT_MODEL_H
#define FILM_PILOT_MODEL_H

#include <stdbool.h>
#include <stdint.h>

#define MODEL_READINGS 32

struct reading {
    double n, error, energy; /* relMSE at n in some place; relMSE of leaving the part out */
    double hard;             /* the place's error over the whole's, as another way has it; 1: not known */
    bool rough;              /* measured by a first, noisy picture: counts until there are two that are not */
};

struct model {
    struct reading reading[MODEL_READINGS]; /* a ring: the newest take the places of the oldest */
    uint32_t count, next;                   /* in the ring; where the next goes */
    uint32_t fresh;                         /* readings since the sky changed, */
    uint32_t chosen;                        /* and since the way was chosen, at most as many as the ring holds */
    double variance, order;                 /* error = variance n^-order */
    double doubt;                           /* standard error of the variance, relative */
    double energy, energy_most;             /* as read; and what it may well be, with so few readings */
    /* Seconds = tables_s + run_s + base_s + unit_s n, when the machine's pace is 1: for a sky, for a run however small,
     * for all points, for a sample at all points. */
    double tables_s, run_s, base_s, unit_s;
    double ran_n[2], ran_s[2]; /* of the last whole picture, and of the last one before it with another n */
    bool known;                /* the error is, be it from another sky */
    bool timed, sloped, ran;   /* the times are; at two counts; from a whole picture too */
};

void model_read(struct model *m, const struct reading *r);

/* A timed run: tables_s once, `seconds` for n on a share 0..1 of the points. */
void model_time(struct model *m, double tables_s, double n, double seconds, double share);

/* Two of them, n[0] < n[1], on shares of the samples, and what each took on next to no points: that tells run_s, base_s
 * and unit_s apart. A
 * stratum's last sample may count in part and takes a ray all the same, so that few samples take more rays each than
 * many. */
void model_slope(struct model *m, double tables_s, const double n[2], const double seconds[2], const double none[2],
                 const double share[2]);

/* What whole pictures with two counts say of base_s and unit_s over what is known; false where there have not been two.
 */
bool model_whole(const struct model *m, double *base_times, double *unit_times);

/* All times change alike. */
void model_scale(struct model *m, double times);

/* A whole picture's. */
void model_ran(struct model *m, double n, double seconds);

/* All errors change alike: samples are dealt otherwise. */
void model_ease(struct model *m, double times);

/* All readings count as one that is to be replaced: the sky is another. */
void model_age(struct model *m);

/* Nothing but rough readings, or almost. */
bool model_is_rough(const struct model *m);

double model_error(const struct model *m, double n);
/* The same for a report: by what has been read since the way was chosen, since it was chosen for what had been read
 * before, and of several noisy promises the best is better than the truth. */
double model_error_told(const struct model *m, double n);
double model_begin(const struct model *m); /* what no n changes */
double model_seconds(const struct model *m, double n);

#endif
