/* Predicts error and time of a part of the image from its count n (samples or paths per point, units of particles).
 * Readings are few, noisy and grow old. Plain data; zeroed memory means no readings. Thread: any. */
#pragma once

#include <stdbool.h>
#include <stdint.h>

struct model {
    double variance; /* error = variance / n; scaled when the distribution of samples changes */
    double unit_s;   /* seconds of a whole image = unit_s n; 0: unknown */
    uint32_t count;  /* readings averaged in `variance` */
    uint32_t fresh;  /* readings since the sky changed */
    bool known;      /* the error is known, perhaps from an earlier sky */
};

/* Adds a reading, a relMSE at n; the latest twelve have the most weight. */
void model_read(struct model *m, double n, double error);
/* Adds the time of a whole image. */
void model_ran(struct model *m, double n, double seconds);

/* The sky has changed: old readings serve until the first new one replaces them. */
void model_age(struct model *m);

double model_error(const struct model *m, double n);   /* relMSE at n; 0: unknown */
double model_seconds(const struct model *m, double n); /* of a whole image at n */
