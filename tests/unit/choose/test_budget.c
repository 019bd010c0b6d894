/* The division of a frame's time, held to closed forms and to trying everything. */
#include "choose/budget.h"

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
    const struct budget_way a = { .variance = 4.0, .unit_s = 1.0, .least = 1.0, .most = 1e9 };
    const struct budget_way b = { .variance = 1.0, .unit_s = 1.0, .least = 1.0, .most = 1e9 };
    const struct budget_way c = { .variance = 1.0, .unit_s = 4.0, .least = 1.0, .most = 1e9 };
    struct budget out;
    (void)state;

    budget_for_time((const struct budget_part[]){ { &a, 1 }, { &b, 1 } }, 2, 3000.0, &out);
    assert_true(out.met);
    assert_near(out.part[0].n, 2000.0, 1e-3);
    assert_near(out.part[1].n, 1000.0, 1e-3);
    assert_near(out.error, 4.0 / 2000.0 + 1.0 / 1000.0, 1e-3);
    budget_for_time((const struct budget_part[]){ { &b, 1 }, { &c, 1 } }, 2, 3000.0, &out);
    assert_near(out.part[0].n / out.part[1].n, 2.0, 5e-3);
}

/* E = V / n alone: everything goes to it, and the error of a wish is met with the least n. */
static void one_part_takes_all_and_no_more_than_it_needs(void **state)
{
    const struct budget_way w = { .variance = 2.0, .begin_s = 5.0, .unit_s = 0.5, .least = 1.0, .most = 1e6 };
    struct budget out;
    (void)state;

    budget_for_time(&(const struct budget_part){ &w, 1 }, 1, 105.0, &out);
    assert_near(out.part[0].n, 200.0, 1e-9);
    assert_near(out.seconds, 105.0, 1e-9);
    budget_for_error(&(const struct budget_part){ &w, 1 }, 1, 1e-4, &out);
    assert_true(out.met && out.error <= 1e-4);
    assert_near(out.part[0].n, 2.0 / 1e-4, 1e-9);
}

/* A part is left out exactly while that is less harm than taking time from the others. */
static void a_part_is_left_out_where_it_costs_more_than_it_brings(void **state)
{
    const struct budget_way direct = { .variance = 1.0, .unit_s = 1e-3, .least = 1.0, .most = 1e6 };
    struct budget_way rest[2] = { { .bias = 1e-4 }, { .variance = 1e-2, .unit_s = 0.02, .least = 1.0, .most = 1e6 } };
    const struct budget_part parts[] = { { &direct, 1 }, { rest, 2 } };
    struct budget out;
    (void)state;

    budget_for_time(parts, 2, 0.033, &out); /* 33 samples: 0.030 or, with one path, 13: 0.077 and 0.01 */
    assert_int_equal(out.part[1].way, 0);
    assert_near(out.part[0].n, 33.0, 1e-9);
    rest[0].bias = 0.1;
    budget_for_time(parts, 2, 0.033, &out);
    assert_int_equal(out.part[1].way, 1);
    assert_near(out.part[1].n, 1.0, 1e-9);
    rest[0].bias = 1e-4;
    budget_for_time(parts, 2, 1e4, &out); /* time enough */
    assert_int_equal(out.part[1].way, 1);
    budget_for_error(parts, 2, 1e-5, &out); /* and an error that nothing else reaches */
    assert_true(out.met);
    assert_int_equal(out.part[1].way, 1);
}

static void what_cannot_be_had_is_said_and_approached(void **state)
{
    const struct budget_way ways[2] = {
        { .variance = 1.0, .begin_s = 2.0, .unit_s = 1.0, .least = 1.0, .most = 8.0 },
        { .variance = 5.0, .begin_s = 1.0, .unit_s = 1.0, .least = 1.0, .most = 8.0 },
    };
    const struct budget_part part = { ways, 2 };
    struct budget out;
    (void)state;

    budget_for_time(&part, 1, 0.5, &out);
    assert_false(out.met);
    assert_int_equal(out.part[0].way, 1); /* the least time */
    assert_near(out.seconds, 2.0, 1e-9);
    budget_for_error(&part, 1, 1e-3, &out);
    assert_false(out.met);
    assert_int_equal(out.part[0].way, 0); /* the least error */
    assert_near(out.part[0].n, 8.0, 1e-9);
}

enum { PARTS = 3, WAYS = 3, MOST = 40 };

static void random_ways(struct rng *r, struct budget_way ways[PARTS][WAYS])
{
    for (int p = 0; p < PARTS; p++)
        for (int k = 0; k < WAYS; k++) {
            ways[p][k] = (struct budget_way){ .bias = k == 2 ? 0.02 * rng_next(r) : 0.0,
                                              .variance = exp(4.0 * rng_next(r) - 2.0),
                                              .begin_s = 2.0 * rng_next(r),
                                              .unit_s = exp(2.0 * rng_next(r) - 1.0),
                                              .least = 1.0,
                                              .most = MOST };
            if (p > 0 && k == 0) /* left out */
                ways[p][k] = (struct budget_way){ .bias = 0.5 * rng_next(r) };
        }
}

/* The least of the rest over all ways and whole counts that meet the limit. */
static double by_trying(struct budget_way ways[PARTS][WAYS], double limit, bool of_error)
{
    static double error[PARTS][WAYS * (MOST + 1)], seconds[PARTS][WAYS * (MOST + 1)];
    int count[PARTS] = { 0 };
    double best = INFINITY;

    for (int p = 0; p < PARTS; p++)
        for (int k = 0; k < WAYS; k++)
            for (double n = ways[p][k].least; n <= ways[p][k].most; n += 1.0) {
                error[p][count[p]] = budget_error(&ways[p][k], n);
                seconds[p][count[p]++] = budget_seconds(&ways[p][k], n);
            }
    for (int a = 0; a < count[0]; a++)
        for (int b = 0; b < count[1]; b++)
            for (int c = 0; c < count[2]; c++) {
                const double e = error[0][a] + error[1][b] + error[2][c];
                const double t = seconds[0][a] + seconds[1][b] + seconds[2][c];
                if ((of_error ? e : t) <= limit)
                    best = fmin(best, of_error ? t : e);
            }
    return best;
}

/* 60 draws of three parts with three ways each: real counts against trying all whole ones. */
static void nothing_that_was_tried_is_much_better(void **state)
{
    struct rng r = { 5 };
    double worst = 0.0, sum = 0.0;
    (void)state;

    for (int draw = 0; draw < 60; draw++) {
        struct budget_way ways[PARTS][WAYS];
        struct budget_part parts[PARTS];
        struct budget out;
        random_ways(&r, ways);
        for (int p = 0; p < PARTS; p++)
            parts[p] = (struct budget_part){ ways[p], WAYS };
        const bool of_error = draw % 2;
        const double limit = of_error ? 0.1 + 0.4 * rng_next(&r) : 10.0 + 60.0 * rng_next(&r);
        (of_error ? budget_for_error : budget_for_time)(parts, PARTS, limit, &out);
        const double best = by_trying(ways, limit, of_error);
        assert_true(isfinite(best) == out.met);
        if (!out.met)
            continue;
        const double got = of_error ? out.seconds : out.error;
        assert_true((of_error ? out.error : out.seconds) <= limit);
        worst = fmax(worst, got / best - 1.0);
        sum += (got / best - 1.0) / 60.0;
    }
    printf("above the best of all: %.2f %% in the mean, %.1f %% at most\n", 100.0 * sum, 100.0 * worst);
    assert_true(sum < 0.01 && worst < 0.08);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(counts_go_by_the_root_of_variance_over_time),
    cmocka_unit_test(one_part_takes_all_and_no_more_than_it_needs),
    cmocka_unit_test(a_part_is_left_out_where_it_costs_more_than_it_brings),
    cmocka_unit_test(what_cannot_be_had_is_said_and_approached),
    cmocka_unit_test(nothing_that_was_tried_is_much_better),
};
UNIT_MAIN(tests)
