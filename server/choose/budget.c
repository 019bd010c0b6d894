#include "choose/budget.h"

#include <assert.h>
#include <math.h>

#define PRICE_LEAST 1e-30 /* relMSE a second, of the bisection */
#define PRICE_MOST 1e30
#define STEPS 60 /* of the bisection: the price's logarithm to 1e-16 of where it began */

struct target {
    double limit;
    bool of_error; /* else of time */
};

double budget_error(const struct budget_way *w, double n)
{
    return w->bias + (n > 0.0 && w->variance > 0.0 ? w->variance / n : 0.0);
}

double budget_seconds(const struct budget_way *w, double n)
{
    return w->begin_s + w->unit_s * n;
}

/* n at a price: where the derivative of E + price x t is 0, held to what is allowed. */
static double answer(const struct budget_way *w, double price)
{
    if (!(w->variance > 0.0))
        return w->least;
    return fmin(w->most, fmax(w->least, sqrt(w->variance / (w->unit_s * price))));
}

/* All parts' answers to a price; `fixed`: by the ways that they have. */
static void answer_all(const struct budget_part *parts, uint32_t count, double price, bool fixed, struct budget *b)
{
    b->error = b->seconds = 0.0;
    for (uint32_t p = 0; p < count; p++) {
        double best = INFINITY;
        const uint32_t given = b->part[p].way;
        for (uint32_t k = 0; k < parts[p].count; k++) {
            const struct budget_way *w = &parts[p].ways[k];
            const double n = answer(w, price), value = budget_error(w, n) + price * budget_seconds(w, n);
            if ((!fixed || k == given) && value < best) {
                best = value;
                b->part[p] = (struct budget_share){ k, n };
            }
        }
        const struct budget_way *w = &parts[p].ways[b->part[p].way];
        b->error += budget_error(w, b->part[p].n);
        b->seconds += budget_seconds(w, b->part[p].n);
    }
}

static bool meets(const struct budget *b, const struct target *t)
{
    return (t->of_error ? b->error : b->seconds) <= t->limit;
}

/* Two answers next to each other in price: the last that meets the target, if any does, and the first that does not. */
static void bisect(const struct budget_part *parts, uint32_t count, const struct target *t, bool fixed,
                   struct budget *inside, struct budget *outside)
{
    /* Dear seconds make short times, cheap ones small errors. */
    double in = log(t->of_error ? PRICE_LEAST : PRICE_MOST), out = log(t->of_error ? PRICE_MOST : PRICE_LEAST);

    answer_all(parts, count, exp(in), fixed, inside);
    answer_all(parts, count, exp(out), fixed, outside);
    for (int step = 0; step < STEPS && meets(inside, t) && !meets(outside, t); step++) {
        struct budget b = *inside;
        const double middle = 0.5 * (in + out);
        answer_all(parts, count, exp(middle), fixed, &b);
        *(meets(&b, t) ? &in : &out) = middle;
        *(meets(&b, t) ? inside : outside) = b;
    }
    if (meets(outside, t))
        *inside = *outside;
}

/* Better: meets the target where the other does not; where neither does, comes nearer; where both do, less of the rest.
 */
static bool better(const struct budget *a, const struct budget *b, const struct target *t)
{
    if (meets(a, t) != meets(b, t))
        return meets(a, t);
    return t->of_error == meets(a, t) ? a->seconds < b->seconds : a->error < b->error;
}

static void solve(const struct budget_part *parts, uint32_t count, const struct target *t, struct budget *out)
{
    struct budget inside = { .met = false }, outside = { .met = false };

    assert(count <= BUDGET_PARTS_MAX);
    bisect(parts, count, t, false, &inside, &outside);
    *out = inside;
    for (int k = 0; k < 2; k++) {
        struct budget b = k ? outside : inside, rest = b;
        bisect(parts, count, t, true, &b, &rest);
        if (better(&b, out, t))
            *out = b;
    }
    out->met = meets(out, t);
}

void budget_for_time(const struct budget_part *parts, uint32_t count, double seconds, struct budget *out)
{
    solve(parts, count, &(struct target){ seconds, false }, out);
}

void budget_for_error(const struct budget_part *parts, uint32_t count, double error, struct budget *out)
{
    solve(parts, count, &(struct target){ error, true }, out);
}
