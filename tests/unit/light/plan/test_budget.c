/* The division of a frame's time against closed forms and exhaustive search. */
#include "light/plan/pilot_measure.h"

#include "base/rng.h"
#include "support/unit.h"

#include <math.h>

static void assert_near(double got, double want, double share)
{
    if (fabs(got - want) > share * fabs(want)) {
        printf("%.9g where %.9g was expected\n", got, want);
        fail();
    }
}

/* n in proportion to sqrt(V / b): with V = 4 and 1, b = 1 and 1 the first gets twice as much. */
static void counts_go_by_the_root_of_variance_over_time(void **state)
{
    const struct budget_part a = { .variance = 4.0, .unit_s = 1.0, .least = 1.0, .most = 1e9 };
    const struct budget_part b = { .variance = 1.0, .unit_s = 1.0, .least = 1.0, .most = 1e9 };
    const struct budget_part c = { .variance = 1.0, .unit_s = 4.0, .least = 1.0, .most = 1e9 };
    const struct budget_target target = { .seconds = 3000.0 };
    struct budget out;
    (void)state;

    budget_spend((const struct budget_part[]){ a, b }, 2, &target, &out);
    assert_true(out.met);
    assert_near(out.n[0], 2000.0, 1e-9);
    assert_near(out.n[1], 1000.0, 1e-9);
    assert_near(out.error, 4.0 / 2000.0 + 1.0 / 1000.0, 1e-9);
    budget_spend((const struct budget_part[]){ b, c }, 2, &target, &out);
    assert_near(out.n[0] / out.n[1], 2.0, 1e-9);
}

/* E = V / n alone: everything goes to it, and a target error is met with the least n. */
static void one_part_takes_all_and_no_more_than_it_needs(void **state)
{
    const struct budget_part p = { .variance = 2.0, .unit_s = 0.5, .least = 1.0, .most = 1e6 };
    struct budget out;
    (void)state;

    budget_spend(&p, 1, &(struct budget_target){ .seconds = 100.0 }, &out);
    assert_near(out.n[0], 200.0, 1e-9);
    assert_near(out.seconds, 100.0, 1e-9);
    budget_spend(&p, 1, &(struct budget_target){ .error = 1e-4 }, &out);
    assert_true(out.met && out.error <= 1e-4);
    assert_near(out.n[0], 2.0 / 1e-4, 1e-9);
    budget_spend(&p, 1, &(struct budget_target){ .seconds = 100.0, .error = 1e-4 }, &out); /* within the time */
    assert_near(out.n[0], 200.0, 1e-9);
    budget_spend(&p, 1, &(struct budget_target){ .seconds = 100.0, .error = 0.1 }, &out); /* in less than the time */
    assert_near(out.n[0], 20.0, 1e-9);
}

static void what_cannot_be_met_is_approached(void **state)
{
    const struct budget_part p = { .variance = 1.0, .unit_s = 1.0, .least = 1.0, .most = 8.0 };
    struct budget out;
    (void)state;

    budget_spend(&p, 1, &(struct budget_target){ .seconds = 0.5 }, &out);
    assert_false(out.met);
    assert_near(out.seconds, 1.0, 1e-9); /* the least time */
    budget_spend(&p, 1, &(struct budget_target){ .error = 1e-3 }, &out);
    assert_false(out.met);
    assert_near(out.n[0], 8.0, 1e-9); /* the least error */
}

enum { PARTS = 3, MOST = 40 };

static void random_parts(struct rng *r, struct budget_part parts[PARTS])
{
    for (int p = 0; p < PARTS; p++)
        parts[p] = (struct budget_part){
            .variance = exp(4.0 * rng_next(r) - 2.0), .unit_s = exp(2.0 * rng_next(r) - 1.0), .least = 1.0, .most = MOST
        };
    if (rng_next(r) < 0.3) /* not there */
        parts[2] = (struct budget_part){ .variance = 0.0 };
}

/* The least of the other figure over all whole counts that meet the limit. */
static double by_trying(const struct budget_part parts[PARTS], double limit, bool of_error)
{
    double best = INFINITY;

    for (int a = 1; a <= MOST; a++)
        for (int b = 1; b <= MOST; b++)
            for (int c = (int)parts[2].least; c <= (int)parts[2].most; c++) {
                const int n[PARTS] = { a, b, c };
                double e = 0.0, t = 0.0;
                for (int p = 0; p < PARTS; p++) {
                    e += n[p] ? parts[p].variance / n[p] : 0.0;
                    t += parts[p].unit_s * n[p];
                }
                if ((of_error ? e : t) <= limit)
                    best = fmin(best, of_error ? t : e);
            }
    return best;
}

/* 60 draws of three parts: real counts against all whole ones. */
static void no_whole_counts_are_better(void **state)
{
    struct rng r = { 5 };
    double worst = 0.0;
    (void)state;

    for (int draw = 0; draw < 60; draw++) {
        struct budget_part parts[PARTS];
        struct budget out;
        random_parts(&r, parts);
        const bool of_error = draw % 2;
        const double limit = of_error ? 0.1 + 0.4 * rng_next(&r) : 10.0 + 60.0 * rng_next(&r);
        const struct budget_target target = { of_error ? 0.0 : limit, of_error ? limit : 0.0 };
        budget_spend(parts, PARTS, &target, &out);
        const double best = by_trying(parts, limit, of_error);
        assert_true(out.met || !isfinite(best));
        if (!isfinite(best))
            continue;
        assert_true((of_error ? out.error : out.seconds) <= limit);
        worst = fmax(worst, (of_error ? out.seconds : out.error) / best - 1.0);
    }
    printf("above the best of all: %.2g at most\n", worst);
    assert_true(worst < 1e-9);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(counts_go_by_the_root_of_variance_over_time),
    cmocka_unit_test(one_part_takes_all_and_no_more_than_it_needs),
    cmocka_unit_test(what_cannot_be_met_is_approached),
    cmocka_unit_test(no_whole_counts_are_better),
};
UNIT_MAIN(tests)
