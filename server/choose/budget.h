/* server/choose/budget.h */
/* How to spend a frame's time where it lowers the error most. Pure functions; any thread.
 *
 * A frame has parts whose errors are independent of each other, so that their relative squared errors add up. Each part
 * can be had in several ways, of which one is taken, with n units (samples, paths, particles):
 *     error  E = B + V / n            B a bias that no n removes, V what one unit leaves
 *     time   t = a + b n              a to begin at all, b a unit
 * with n in least..most. A way that leaves the part out has V = a = b = 0, n = 0 and as B the mean square of what the
 * part would bring, relative as the error is.
 *
 * For a time T the sum of E is the least where every part answers to one price l of a second [Everett 1963]: what
 * another second takes from the error is the same everywhere,
 *     V / (b n^2) = l,    n = sqrt(V / (b l)) [Cochran 1977, section 5.5].
 * Times fall as l rises, so that l is found by bisection. The ways are discrete, and a sum of minima at one price need
 * not meet T: at the price where the ways change, both sets of ways get the counts that meet it, and the better stays.
 */
#ifndef CHOOSE_BUDGET_H
#define CHOOSE_BUDGET_H

#include <stdbool.h>
#include <stdint.h>

#define BUDGET_PARTS_MAX 8

struct budget_way {
    double bias;            /* B >= 0 */
    double variance;        /* V >= 0 */
    double begin_s, unit_s; /* a >= 0, b >= 0; b > 0 where V is */
    double least, most;     /* n; both 0: the part is left out */
};

struct budget_part {
    const struct budget_way *ways;
    uint32_t count; /* >= 1 */
};

struct budget_share {
    uint32_t way;
    double n; /* real */
};

struct budget {
    struct budget_share part[BUDGET_PARTS_MAX];
    double error, seconds; /* sums over the parts */
    bool met;              /* the target; else this is as near as the ways come to it */
};

/* The least error within `seconds`; where that is not possible, the least time. count <= BUDGET_PARTS_MAX. */
void budget_for_time(const struct budget_part *parts, uint32_t count, double seconds, struct budget *out);

/* The least time for an error of at most `error`; where that is not possible, the least error. */
void budget_for_error(const struct budget_part *parts, uint32_t count, double error, struct budget *out);

/* E and t of a way at n units. */
double budget_error(const struct budget_way *w, double n);
double budget_seconds(const struct budget_way *w, double n);

#endif
