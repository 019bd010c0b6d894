/* When auto takes the cache of light transport: by counts, and by what frames have cost. */
#include "light/plan/cost_model.h"

#include "support/unit.h"

#include <math.h>

static struct cost_verdict counted(double allowed, uint32_t samples, bool indirect)
{
    struct cost_verdict b;
    cost_by_counts(&(struct cost_facts){ .allowed = allowed, .samples = samples, .indirect = indirect }, &b);
    return b;
}

/* 2048 / (64 - 4) = 34.1 frames, as long as 2048 samples a point take; (2048 + 1250) / 124 with indirect light. */
static void its_break_even_is_stated(void **state)
{
    (void)state;
    assert_true(fabs(counted(1.0, 64, false).break_even - 2048.0 / 60.0) < 1e-12);
    assert_true(fabs(counted(1.0, 64, true).break_even - 3298.0 / 124.0) < 1e-12);
}

/* Unbiased unless a bias as large as the cache's is allowed, however many frames there are. */
static void only_where_its_bias_is_allowed(void **state)
{
    struct cost_facts f = {
        .points = 10000, .sample_s = 1e-7, .error = 1.0, .frame_s = 1.0, .spent_s = 100.0, .made = 1000
    };
    struct cost_verdict b;
    (void)state;

    for (int indirect = 0; indirect < 2; indirect++) {
        const double bias = indirect ? COST_BIAS_INDIRECT : COST_BIAS;
        assert_true(counted(bias, 64, indirect).yes);
        assert_false(counted(0.99 * bias, 64, indirect).yes);
        assert_false(counted(0.0, 64, indirect).yes);
        f.indirect = indirect;
        f.allowed = bias;
        cost_by_clock(&f, &b);
        assert_true(b.yes && cost_allows_cache(&f) && cost_suits_cache(&f));
        f.allowed = 0.99 * bias;
        cost_by_clock(&f, &b);
        assert_false(b.yes || cost_allows_cache(&f) || cost_suits_cache(&f));
    }
}

static void never_for_the_first_frame(void **state)
{
    struct cost_verdict b;
    (void)state;

    const struct cost_facts first = { .allowed = 1.0, .points = 1000, .error = 1.0, .sample_s = 1e-8, .frame_s = 1.0 };
    cost_by_clock(&first, &b);
    assert_false(b.yes); /* none was made yet: it may be the only one */
}

/* 512 samples are 5.9e-4 off, where the cache is 4.5e-4; 1024 are 2.9e-4 off. */
static void not_where_samples_are_better(void **state)
{
    (void)state;
    assert_true(counted(1.0, 512, false).yes);
    assert_false(counted(1.0, 1024, false).yes);
    assert_true(counted(1.0, 256, true).yes);
    assert_false(counted(1.0, 512, true).yes);
    assert_false(counted(1.0, 4, false).yes); /* nor where it takes no less */
}

/* 10000 points of 1e-7 s a sample: 2.048 s to compute, 4 ms a frame. */
static struct cost_verdict clocked(double error, double frame_s, double spent_s, uint64_t left)
{
    const struct cost_facts f = { .allowed = 1.0,
                                 .points = 10000,
                                 .sample_s = 1e-7,
                                 .error = error,
                                 .frame_s = frame_s,
                                 .spent_s = spent_s,
                                 .made = 10,
                                 .frames = left };
    struct cost_verdict b;
    cost_by_clock(&f, &b);
    return b;
}

/* So that it costs at most twice what it would have cost to know beforehand how many frames come. */
static void it_is_computed_when_as_much_has_been_spent(void **state)
{
    (void)state;
    assert_true(fabs(clocked(1e-2, 0.044, 0.0, 0).build_s - 2.048) < 1e-9);
    assert_true(fabs(clocked(1e-2, 0.044, 0.0, 0).break_even - 51.2) < 1e-9);
    assert_false(clocked(1e-2, 0.044, 2.04, 0).yes);
    assert_true(clocked(1e-2, 0.044, 2.05, 0).yes);
    assert_false(clocked(1e-2, 0.004, 100.0, 0).yes); /* a frame from it takes as long */
}

/* Frames in haste take no longer than those of the cache, and are worse: 2048 / 60 of them, and (2048 + 1250) / 124. */
static void haste_does_not_keep_it_away(void **state)
{
    struct cost_facts f = {
        .allowed = 1.0, .points = 10000, .sample_s = 1e-7, .error = 1.0, .frame_s = 1e-3, .made = 34
    };
    struct cost_verdict b;
    (void)state;

    cost_by_clock(&f, &b);
    assert_false(b.yes);
    f.made = 35;
    cost_by_clock(&f, &b);
    assert_true(b.yes);
    f.frames = 1000; /* known to come: by what they save */
    cost_by_clock(&f, &b);
    assert_false(b.yes);
    f.frames = 0;
    f.error = 0.5 * COST_BIAS;
    cost_by_clock(&f, &b);
    assert_false(b.yes);
    f.error = 1.0;
    f.indirect = true;
    f.made = 26;
    cost_by_clock(&f, &b);
    assert_false(b.yes);
    f.made = 27;
    cost_by_clock(&f, &b);
    assert_true(b.yes);
}

static void frames_that_are_known_to_come_are_counted(void **state)
{
    (void)state;
    assert_false(clocked(1e-2, 0.044, 100.0, 51).yes);
    assert_true(clocked(1e-2, 0.044, 0.044, 52).yes);
}

static void not_where_a_better_image_was_asked_for(void **state)
{
    struct cost_facts f = { .allowed = 1.0,
                           .points = 10000,
                           .sample_s = 1e-7,
                           .error = 1e-3,
                           .frame_s = 1.0,
                           .spent_s = 100.0,
                           .made = 10,
                           .indirect = true };
    struct cost_verdict b;
    (void)state;

    assert_true(clocked(COST_BIAS, 1.0, 100.0, 0).yes);
    assert_false(clocked(0.99 * COST_BIAS, 1.0, 100.0, 0).yes);
    assert_false(clocked(0.0, 1.0, 100.0, 0).yes); /* not known */
    cost_by_clock(&f, &b);
    assert_false(b.yes || cost_suits_cache(&f)); /* nor from a file */
    f.error = 1.01 * COST_BIAS_INDIRECT;
    cost_by_clock(&f, &b);
    assert_true(b.yes && cost_suits_cache(&f));
    f.made = COST_MADE - 1;
    cost_by_clock(&f, &b);
    assert_false(b.yes);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(its_break_even_is_stated),
    cmocka_unit_test(only_where_its_bias_is_allowed),
    cmocka_unit_test(never_for_the_first_frame),
    cmocka_unit_test(not_where_samples_are_better),
    cmocka_unit_test(it_is_computed_when_as_much_has_been_spent),
    cmocka_unit_test(haste_does_not_keep_it_away),
    cmocka_unit_test(frames_that_are_known_to_come_are_counted),
    cmocka_unit_test(not_where_a_better_image_was_asked_for),
};
UNIT_MAIN(tests)
