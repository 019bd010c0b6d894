/* Statistics of curves of error over time: quantiles over seeds, interpolation, the lower envelope of several curves,
 * and with which confidence another stays near it. Pure functions; any thread. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stdint.h>

struct band {                 /* of values over seeds */
    double low, median, high; /* 10 %, 50 %, 90 %, linear between neighbours [Hyndman and Fan 1996, type 7] */
};

/* n >= 1; the values are not changed. NaN counts as INFINITY. ERR_NOMEM. */
MUST_CHECK enum err series_band(const double *values, uint32_t n, struct band *out);

/* A curve as it was measured: `points` budgets, each with `seeds` runs. Borrowed. */
struct curve {
    uint32_t points, seeds;
    const double *seconds; /* [points][seeds] */
    const double *errors;  /* [points][seeds] */
};

/* y at x along a line of points (x[k], y[k]), straight in log-log; x ascending. False outside x[0]..x[n - 1] and
 * where y is not above 0. */
bool series_at(const double *x, const double *y, uint32_t n, double at, double *out);

/* The least x at which y has come down to the goal; x[0] if it begins below: *at_most says so. False if it never
 * does. */
bool series_reach(const double *x, const double *y, uint32_t n, double goal, double *out, bool *at_most);

/* How far above the lower envelope of others a curve is. Medians over the seeds make the curves; the envelope at a time
 * is the least error of those of the others that are defined there; only points of the tested curve where the envelope
 * is are compared. The bootstrap draws the seeds of every point anew, with replacement [Efron and Tibshirani 1993,
 * chapter 6], `rounds` times. The envelope of noisy curves is on the low side: the test errs on the strict side. */
struct envelope_verdict {
    bool known;           /* there was a point to compare */
    double worst;         /* largest ratio of errors, tested over envelope */
    double worst_seconds; /* where */
    double upper;         /* 90 % of the rounds have a largest ratio below this one */
    double confidence;    /* share of the rounds whose largest ratio is within the limit */
    bool within;          /* that share is at least 0.9 */
};

/* ERR_NOMEM. */
MUST_CHECK enum err series_envelope(const struct curve *others, uint32_t count, const struct curve *tested,
                                    double limit, uint32_t rounds, uint64_t seed, struct envelope_verdict *out);

/* Medians of a curve's points, in ascending order of time: seconds[points], errors[points]. ERR_NOMEM. */
MUST_CHECK enum err series_medians(const struct curve *c, double *seconds, double *errors);
