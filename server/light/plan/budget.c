#include "light/plan/pilot_measure.h"

#include <assert.h>
#include <math.h>

#define FACTOR_LOG 70.0 /* k lies between exp(-this) and exp(this) */
#define STEPS 60        /* of the bisection of log k */

static void spend(const struct budget_part *parts, uint32_t count, double factor, struct budget *b)
{
    b->error = b->seconds = 0.0;
    for (uint32_t i = 0; i < count; i++) {
        const struct budget_part *p = &parts[i];
        const double best = p->variance > 0.0 ? factor * sqrt(p->variance / p->unit_s) : p->least;
        const double n = b->n[i] = fmin(p->most, fmax(p->least, best));
        b->error += n > 0.0 ? p->variance / n : 0.0;
        b->seconds += p->unit_s * n;
    }
}

/* The largest k within the time or, with of_error, the smallest within the error. */
static void bisect(const struct budget_part *parts, uint32_t count, double limit, bool of_error, struct budget *out)
{
    double low = -FACTOR_LOG, high = FACTOR_LOG;

    spend(parts, count, exp(of_error ? high : low), out);
    out->met = (of_error ? out->error : out->seconds) <= limit;
    for (int step = 0; step < STEPS && out->met; step++) {
        struct budget b = { .met = true };
        const double middle = 0.5 * (low + high);
        spend(parts, count, exp(middle), &b);
        const bool met = (of_error ? b.error : b.seconds) <= limit;
        *(met == of_error ? &high : &low) = middle;
        if (met)
            *out = b;
    }
}

void budget_spend(const struct budget_part *parts, uint32_t count, const struct budget_target *target,
                  struct budget *out)
{
    assert(count <= BUDGET_PARTS_MAX);
    if (target->error > 0.0)
        bisect(parts, count, target->error, true, out);
    if (!(target->error > 0.0) || (target->seconds > 0.0 && out->seconds > target->seconds))
        bisect(parts, count, target->seconds, false, out);
}
