/* server/chart/errors.h */
/* The errors that are charted. Another one is a value here, a row in errors.c and a line in errors_of. Any thread. */
#ifndef CHART_ERRORS_H
#define CHART_ERRORS_H

#include "chart/judge.h"

#include <stdint.h>

enum error_kind {
    ERROR_REL_MSE, /* against two references, no pixel left out: judge.h */
    ERROR_NOISE,   /* the part of it that another seed changes: no reference enters */
    ERROR_DELTA_E, /* mean CIE76 after one fixed tone map: film/metrics.h. Not free of the references' own noise */
    ERROR_FLIP,    /* mean FLIP under the same exposure: film/flip.h. Nor is this */
    ERROR_KINDS,
};

struct error_about {
    const char *name;  /* in the CSV and in file names */
    const char *title; /* of an axis */
    double slope;      /* over time in log-log, where more time is more samples and there is no bias */
    const char *plain; /* one sentence for who does not know it */
};
const struct error_about *error_about(enum error_kind kind);

/* Of n pictures of the same from different seeds: out[ERROR_KINDS][n]. mask as judge_init had it; pairs as judge_pairs
 * gives them. ERR_NOMEM. */
MUST_CHECK enum err errors_of(const struct judge *j, const uint8_t *mask, const float *const *x, const double *pairs,
                              uint32_t n, double *out);

#endif
