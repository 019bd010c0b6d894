/* Predicts error and time of one technique for a part of the image from its count n (samples or paths per point,
 * units of particles). Readings are few, noisy and grow old. Plain data; zeroed memory means no readings. Thread:
 * any. */
#pragma once

#include <stdbool.h>
#include <stdint.h>

struct reading {
    double n, error, energy; /* relMSE at n; relMSE of omitting the part */
};

struct model {
    double variance;               /* error = variance / n; scaled when the distribution of samples changes */
    double energy, energy_most;    /* as measured; and one standard error above */
    double weight, light, scatter; /* running means of n^2, n^2 energy, and the squared deviation of the latter */
    double begin_s, unit_s;        /* seconds of a whole picture = begin_s + unit_s n */
    uint32_t count;                /* readings averaged in `variance` */
    uint32_t fresh;                /* readings since the sky changed */
    bool known, timed;             /* the error is known, perhaps from an earlier sky; the times are known */
    bool ran;                      /* a whole picture has corrected the times */
};

/* Adds a reading; the latest twelve have the most weight. */
void model_read(struct model *m, const struct reading *r);

/* Adds a measured run: begin_s once, `seconds` for n on a share 0..1 of the picture's samples. */
void model_time(struct model *m, double begin_s, double n, double seconds, double share);
/* Adds the time of a whole picture. */
void model_ran(struct model *m, double n, double seconds);

/* The sky has changed: old readings serve until the first new one replaces them. */
void model_age(struct model *m);

double model_error(const struct model *m, double n);   /* relMSE at n */
double model_seconds(const struct model *m, double n); /* of a whole picture at n */
