/* The errors that are charted. To add one, add a value here, a name in errors.c, a line in errors_of, and a row in
 * scripts/winners.py. Any thread. */
#pragma once

#include "measure/chart/judge.h"

#include <stdint.h>

enum error_kind {
    ERROR_REL_MSE, /* against two references, of all pixels with surfaces: judge.h */
    ERROR_NOISE,   /* the part of it that changes with the seed; independent of the references */
    ERROR_DELTA_E, /* mean CIE76 after one fixed tone map: measure/compare/metrics.h. Includes the references' noise */
    ERROR_FLIP,    /* mean FLIP under the same exposure: measure/compare/flip.h. Likewise */
    ERROR_KINDS,
};

extern const char *const error_names[ERROR_KINDS]; /* of the script, in the CSV and in file names */

/* The errors out[ERROR_KINDS][n] of n images that differ in their seeds only. mask: as for judge_init; pairs: from
 * judge_pairs. ERR_NOMEM. */
MUST_CHECK enum err errors_of(const struct judge *j, const uint8_t *mask, const float *const *x, const double *pairs,
                              uint32_t n, double *out);
