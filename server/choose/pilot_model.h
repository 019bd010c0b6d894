/* server/choose/pilot_model.h */
/* What is known of one way to make a part of the picture: error and time against its count n (samples or paths a point,
 * units of particles). Readings are few, noisy and grow old. Plain data; zeroed memory knows nothing. Any thread. */
#ifndef CHOOSE_PILOT_MODEL_H
#define CHOOSE_PILOT_MODEL_H

#include <stdbool.h>
#include <stdint.h>

#define MODEL_READINGS 32

struct reading {
    double n, error, energy; /* relMSE at n; relMSE of leaving the part out */
};

struct model {
    struct reading reading[MODEL_READINGS]; /* a ring: the newest take the places of the oldest */
    uint32_t count, next;                   /* in the ring; where the next goes */
    uint32_t fresh;                         /* readings since the sky changed */
    double variance;                        /* error = variance / n */
    double energy, energy_most;             /* as read; and with one standard error more */
    double begin_s, unit_s;                 /* seconds of a whole picture = begin_s + unit_s n */
    bool known, timed;                      /* the error is, be it from another sky; the times are */
    bool ran;                               /* a whole picture has corrected the times */
};

void model_read(struct model *m, const struct reading *r);

/* A measured run: begin_s once, `seconds` for n on a share 0..1 of the picture's samples. */
void model_time(struct model *m, double begin_s, double n, double seconds, double share);
/* A whole picture's. */
void model_ran(struct model *m, double n, double seconds);

/* All errors change alike: samples are shared out otherwise. */
void model_scale_errors(struct model *m, double times);
/* The sky is another: what is known goes on being used until the first new reading takes its place. */
void model_age(struct model *m);

double model_error(const struct model *m, double n);   /* relMSE at n */
double model_seconds(const struct model *m, double n); /* of a whole picture at n */

#endif
