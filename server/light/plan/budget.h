/* Divides a frame's time among its parts so that the error is minimal. Pure functions. Thread: any.
 *
 * The parts' errors are independent, so their relative squared errors add up. A part is made with n units (samples,
 * paths, particles):
 *     error  E = V / n                V the variance of one unit
 *     time   t = b n
 * with n in least..most. A part that is not there has V = b = n = 0.
 *
 * For a time T the sum of E is minimal when an additional second lowers the error of every part equally [Everett 1963]:
 *     n = k sqrt(V / b), with one k for all parts [Cochran 1977, section 5.5].
 * Time increases and error decreases with k, so bisection finds it. */
#pragma once

#include <stdbool.h>
#include <stdint.h>

#define BUDGET_PARTS_MAX 8 /* bounds a table; the pilot has fewer parts */

struct budget_part {
    double variance;    /* V >= 0 */
    double unit_s;      /* b >= 0; b > 0 where V is */
    double least, most; /* n; both 0: the part is not there */
};

struct budget_target { /* at least one is above 0; with both, the error is lowered within the time only */
    double seconds;    /* for an image, including measurements; 0: no limit */
    double error;      /* relMSE; 0: none */
};

struct budget {
    double n[BUDGET_PARTS_MAX];
    double error, seconds; /* sums over the parts */
    bool met;              /* the target is met; else this is the closest that the parts allow */
};

/* The minimum error within target->seconds, or the minimum time for target->error. count <= BUDGET_PARTS_MAX. */
void budget_spend(const struct budget_part *parts, uint32_t count, const struct budget_target *target,
                  struct budget *out);
