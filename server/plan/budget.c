#include "budget.h"

#include <assert.h>
#include <math.h>

#define PRICE_LEAST 1e-30 /* relMSE a second, of the bisection */
#define PRICE_MOST 1e30
#define STEPS 200 /* of the bisection at most: the price's logarithm to 1e-6 */
#define ROUNDS 8  /* of trying other ways; three have been seen */

double budget_error(const struct budget_way *w, double n)
{
    return w->bias + (n > 0.0 && w->variance > 0.0 ? w->variance * pow(n, -w->order) : 0.0);
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
    const double n = pow(w->order * w->variance / (w->unit_s * price), 1.0 / (w->order + 1.0));
    return fmin(w->most, fmax(w->least, n));
}

static void add_up(const struct budget_part *parts, uint32_t count, struct budget *b)
{
    b->error = b->seconds = 0.0;
    for (uint32_t p = 0; p < count; p++) {
        const struct budget_way *w = &parts[p].ways[b->part[p].way];
        b->error += budget_error(w, b->part[p].n);
        b->seconds += budget_seconds(w, b->part[p].n);
    }
}

/* All parts' answers to a price; `free`: their ways too. */
static void answer_all(const struct budget_part *parts, uint32_t count, double price, bool free, struct budget *b)
{
    for (uint32_t p = 0; p < count; p++) {
        double best = INFINITY;
        for (uint32_t k = 0; k < parts[p].count; k++) {
            const struct budget_way *w = &parts[p].ways[k];
            if (!free && k != b->part[p].way)
                continue;
            const double n = answer(w, price), value = budget_error(w, n) + price * budget_seconds(w, n);
            if (value < best) {
                best = value;
                b->part[p] = (struct budget_share){ k, n };
            }
        }
    }
    add_up(parts, count, b);
}

struct wish {
    double limit;
    bool of_error; /* else of time */
};

static bool meets(const struct budget *b, const struct wish *w)
{
    return (w->of_error ? b->error : b->seconds) <= w->limit;
}

/* What is to be small once the wish is met. */
static double rest(const struct budget *b, const struct wish *w)
{
    return w->of_error ? b->seconds : b->error;
}

/* Better: meets the wish where the other does not; where neither does, comes nearer; where both do, less of the rest.
 */
static bool better(const struct budget *a, const struct budget *b, const struct wish *w)
{
    if (meets(a, w) != meets(b, w))
        return meets(a, w);
    if (meets(a, w))
        return rest(a, w) < rest(b, w);
    return w->of_error ? a->error < b->error : a->seconds < b->seconds;
}

/* Two answers next to each other in price: the last that meets the wish, if any does, and the first that does not. */
static void bisect(const struct budget_part *parts, uint32_t count, const struct wish *w, bool free,
                   struct budget *inside, struct budget *outside)
{
    /* Dear seconds make short times, cheap ones small errors. */
    double in = log(w->of_error ? PRICE_LEAST : PRICE_MOST), out = log(w->of_error ? PRICE_MOST : PRICE_LEAST);

    answer_all(parts, count, exp(in), free, inside);
    answer_all(parts, count, exp(out), free, outside);
    if (!meets(inside, w) || meets(outside, w))
        return;
    for (int step = 0; step < STEPS && fabs(in - out) > 1e-3; step++) {
        struct budget b = *inside;
        const double middle = 0.5 * (in + out);
        answer_all(parts, count, exp(middle), free, &b);
        if (meets(&b, w)) {
            in = middle;
            *inside = b;
        } else {
            out = middle;
            *outside = b;
        }
    }
}

/* One more unit at a time for whoever makes the most of it (but `except`; count: nobody), while the wish allows (of
 * time) or still asks (of error). */
static void fill(const struct budget_part *parts, uint32_t count, const struct wish *w, uint32_t except,
                 struct budget *b)
{
    for (uint32_t step = 0; step < 4 * count; step++) {
        struct budget best = *b;
        double most = 0.0;
        if (w->of_error && meets(b, w))
            return;
        for (uint32_t p = 0; p < count; p++) {
            const struct budget_way *way = &parts[p].ways[b->part[p].way];
            struct budget other = *b;
            other.part[p].n += 1.0;
            if (p == except || other.part[p].n > way->most || !(way->variance > 0.0))
                continue;
            add_up(parts, count, &other);
            const double gain = (b->error - other.error) / (other.seconds - b->seconds);
            if ((w->of_error || meets(&other, w)) && gain > most) {
                most = gain;
                best = other;
            }
        }
        if (!(most > 0.0))
            return;
        *b = best;
    }
}

/* Whole numbers: all rounded down, and what that leaves is given out again; then, part by part, one unit less of it and
 * what the others make of that. */
static void round_off(const struct budget_part *parts, uint32_t count, const struct wish *w, struct budget *b)
{
    for (uint32_t p = 0; p < count; p++)
        b->part[p].n = fmax(ceil(parts[p].ways[b->part[p].way].least), floor(b->part[p].n * (1.0 + 1e-9)));
    add_up(parts, count, b);
    fill(parts, count, w, count, b);
    for (uint32_t p = 0; p < count; p++) {
        struct budget other = *b;
        other.part[p].n -= 1.0;
        if (other.part[p].n < parts[p].ways[b->part[p].way].least)
            continue;
        add_up(parts, count, &other);
        fill(parts, count, w, p, &other);
        if (better(&other, b, w))
            *b = other;
    }
}

/* The best whole counts for the ways that *b has. */
static void settle(const struct budget_part *parts, uint32_t count, const struct wish *w, struct budget *b)
{
    struct budget outside = *b;

    bisect(parts, count, w, false, b, &outside);
    round_off(parts, count, w, b);
    round_off(parts, count, w, &outside);
    if (better(&outside, b, w))
        *b = outside;
}

/* Other ways, part by part, the counts of all answering anew. */
static void try_others(const struct budget_part *parts, uint32_t count, const struct wish *w, struct budget *b)
{
    bool changed = true;

    for (int round = 0; round < ROUNDS && changed; round++) {
        changed = false;
        for (uint32_t p = 0; p < count; p++)
            for (uint32_t k = 0; k < parts[p].count; k++) {
                struct budget other = *b;
                if (k == b->part[p].way)
                    continue;
                other.part[p].way = k;
                settle(parts, count, w, &other);
                if (better(&other, b, w)) {
                    *b = other;
                    changed = true;
                }
            }
    }
}

static void solve(const struct budget_part *parts, uint32_t count, const struct wish *w, struct budget *out)
{
    struct budget inside = { 0 }, outside = { 0 };

    assert(count <= BUDGET_PARTS_MAX);
    bisect(parts, count, w, true, &inside, &outside);
    /* Both sides of the price are good places to begin. */
    settle(parts, count, w, &inside);
    settle(parts, count, w, &outside);
    *out = better(&outside, &inside, w) ? outside : inside;
    try_others(parts, count, w, out);
    out->met = meets(out, w);
}

void budget_for_time(const struct budget_part *parts, uint32_t count, double seconds, struct budget *out)
{
    solve(parts, count, &(struct wish){ seconds, false }, out);
}

void budget_for_error(const struct budget_part *parts, uint32_t count, double error, struct budget *out)
{
    solve(parts, count, &(struct wish){ error, true }, out);
}
