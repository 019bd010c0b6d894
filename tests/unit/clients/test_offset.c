#include "support/unit.h"

#include "clients/common/message.h"

static void no_ping_is_no_estimate(void **state)
{
    struct offset o = { 0 };
    int64_t ahead, uncertain;

    (void)state;
    assert_false(offset_get(&o, &ahead, &uncertain));
    offset_add(&o, 1000, 900, 5000); /* our clock stepped back */
    assert_false(offset_get(&o, &ahead, &uncertain));
}

/* Whatever share of the trip was on the way there, the truth lies within the uncertainty. */
static void the_truth_lies_within_the_uncertainty(void **state)
{
    const int64_t truth = -123456789;

    (void)state;
    for (int64_t there = 0; there <= 3001; there += 7) {
        struct offset o = { 0 };
        int64_t ahead, uncertain;
        offset_add(&o, 50000, 50000 + 3001, 50000 + there + truth);
        assert_true(offset_get(&o, &ahead, &uncertain));
        assert_int_equal(uncertain, 1501);
        assert_true(llabs(ahead - truth) <= uncertain);
    }
}

static void the_shortest_of_the_last_twenty_counts(void **state)
{
    struct offset o = { 0 };
    int64_t ahead, uncertain;

    (void)state;
    offset_add(&o, 0, 10, 5 + 111); /* the best, but it will be the twenty-first */
    for (int i = 0; i < 19; i++)
        offset_add(&o, 0, 1000 + i, (1000 + i) / 2 + 222 + i);
    assert_true(offset_get(&o, &ahead, &uncertain));
    assert_int_equal(ahead, 111);
    assert_int_equal(uncertain, 5);
    offset_add(&o, 0, 5000, 2500 + 999);
    assert_true(offset_get(&o, &ahead, &uncertain));
    assert_int_equal(ahead, 222);
    assert_int_equal(uncertain, 500);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(no_ping_is_no_estimate),
    cmocka_unit_test(the_truth_lies_within_the_uncertainty),
    cmocka_unit_test(the_shortest_of_the_last_twenty_counts),
};

UNIT_MAIN(tests)
