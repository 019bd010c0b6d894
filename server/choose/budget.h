/* server/choose/budget.h */
/* Divides a frame's time among its parts so that the error is least. Pure functions; any thread.
 *
 * The parts' errors are independent, so their relative squared errors add up. A part is made with n units (samples,
 * paths, particles):
 *     error  E = B + V / n            B a bias that no n removes, V the variance of one unit
 *     time   t = a + b n              a once, b per unit
 * with n in least..most. A part that is left out has V = a = b = n = 0, and B is the mean square of the light that is
 * missing, relative as the error is.
 *
 * For a time T the sum of E is least where a further second lowers the error of every part alike [Everett 1963]:
 *     n = k sqrt(V / b), with one k for all parts [Cochran 1977, section 5.5].
 * Time rises and error falls with k, so bisection finds it. */
#ifndef CHOOSE_BUDGET_H
#define CHOOSE_BUDGET_H

#include <stdbool.h>
#include <stdint.h>

#define BUDGET_PARTS_MAX 8

struct budget_part {
    double bias;            /* B >= 0 */
    double variance;        /* V >= 0 */
    double begin_s, unit_s; /* a >= 0, b >= 0; b > 0 where V is */
    double least, most;     /* n; both 0: the part is left out */
};

struct budget_target { /* one of the two is above 0; with both, the error is lowered within the time only */
    double seconds, error;
};

struct budget {
    double n[BUDGET_PARTS_MAX];
    double error, seconds; /* sums over the parts */
    bool met;              /* the target is met; else this is as near as the parts come to it */
};

/* The least error within target->seconds, or the least time for target->error. count <= BUDGET_PARTS_MAX. */
void budget_spend(const struct budget_part *parts, uint32_t count, const struct budget_target *target,
                  struct budget *out);

/* True when a serves the target better than b. */
bool budget_better(const struct budget *a, const struct budget *b, const struct budget_target *target);

#endif
