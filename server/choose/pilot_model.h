/* server/choose/pilot_model.h */
/* Predicts error and time of one way to make a part of the picture from its count n (samples or paths per point, units
 * of particles). Readings are few, noisy and grow old. Plain data; zeroed memory knows nothing. Any thread. */
#ifndef CHOOSE_PILOT_MODEL_H
#define CHOOSE_PILOT_MODEL_H

#include <stdbool.h>
#include <stdint.h>

struct reading {
    double n, error, energy; /* relMSE at n; relMSE of leaving the part out */
};

struct model {
    double variance;               /* error = variance / n */
    double energy, energy_most;    /* as read; and with one standard error more */
    double weight, light, scatter; /* running means of n^2, n^2 energy, and the squared deviation of the latter */
    double begin_s, unit_s;        /* seconds of a whole picture = begin_s + unit_s n */
    uint32_t count;                /* readings that `variance` is the mean of */
    uint32_t fresh;                /* readings since the sky changed */
    bool known, timed;             /* the error is known, perhaps from another sky; the times are */
    bool ran;                      /* a whole picture has corrected the times */
};

/* Adds a reading; the latest twelve count most. */
void model_read(struct model *m, const struct reading *r);

/* Adds a measured run: begin_s once, `seconds` for n on a share 0..1 of the picture's samples. */
void model_time(struct model *m, double begin_s, double n, double seconds, double share);
/* Adds the time of a whole picture. */
void model_ran(struct model *m, double n, double seconds);

/* Multiplies all errors: the samples are distributed differently. */
void model_scale_errors(struct model *m, double factor);
/* Errors are measured against another picture: older readings count as one. */
void model_doubt(struct model *m);
/* The sky has changed: what is known serves until the first new reading replaces it. */
void model_age(struct model *m);

double model_error(const struct model *m, double n);   /* relMSE at n */
double model_seconds(const struct model *m, double n); /* of a whole picture at n */

#endif
