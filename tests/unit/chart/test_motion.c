/* Moving pictures against a truth that moves in a known way: 30 x 20 pixels, of which the left 20 columns stand still
 * and the others grow by a tenth of their first value in every frame. References are noisy; noise is even, of a stated
 * standard deviation, independent in every channel. */
#include "motion.h"

#include "rng.h"
#include "unit.h"

#include <math.h>

enum { WIDTH = 30, HEIGHT = 20, STILL_COLUMNS = 20, PIXELS = WIDTH * HEIGHT, VALUES = 3 * PIXELS, FRAMES = 12 };

/* Weights are 1 / (r^2 + 0.01 mean(r)^2): of a truth of 1 everywhere 1 / 1.01. */
#define WEIGHT (1.0 / 1.01)

struct scene {
    float truth[FRAMES][VALUES], a[FRAMES][VALUES], b[FRAMES][VALUES], x[FRAMES][VALUES];
    struct judge judges[FRAMES];
    const float *pictures[FRAMES];
};
static uint8_t everything[PIXELS];

static double noise(struct rng *r, double sigma)
{
    return sigma * sqrt(12.0) * (rng_next(r) - 0.5);
}

/* moves: whether the right columns grow. sigma: of the references. */
static struct scene *make_scene(bool moves, double sigma)
{
    static struct scene s;
    struct rng r = { 11 };

    memset(everything, 1, sizeof(everything));
    for (int t = 0; t < FRAMES; t++) {
        for (int v = 0; v < VALUES; v++) {
            const bool right = v / 3 % WIDTH >= STILL_COLUMNS;
            s.truth[t][v] = moves && right ? 1.0f + 0.1f * (float)t : 1.0f;
            s.a[t][v] = (float)((double)s.truth[t][v] + noise(&r, sigma));
            s.b[t][v] = (float)((double)s.truth[t][v] + noise(&r, sigma));
        }
        assert_int_equal(judge_init(&s.judges[t], s.a[t], s.b[t], everything, WIDTH, HEIGHT, NULL), ERR_OK);
        s.pictures[t] = s.x[t];
    }
    return &s;
}

static void finish_scene(struct scene *s, struct motion *m)
{
    for (int t = 0; t < FRAMES; t++)
        judge_finish(&s->judges[t]);
    motion_finish(m);
}

/* Of the truth, with noise of its own in every frame, or with that of the first in all. */
static void make_pictures(struct scene *s, double sigma, bool fresh)
{
    for (int t = 0; t < FRAMES; t++) {
        struct rng r = { fresh ? rng_mix(3, (uint64_t)t) : 3 };
        for (int v = 0; v < VALUES; v++)
            s->x[t][v] = (float)((double)s->truth[t][v] + noise(&r, sigma));
    }
}

static struct motion judge_motion(struct scene *s)
{
    struct motion m;
    assert_int_equal(motion_init(&m, s->judges, FRAMES, 0.05, NULL), ERR_OK);
    return m;
}

static void assert_within(double got, double want, double share)
{
    if (fabs(got - want) <= share * fabs(want))
        return;
    print_error("%.9g is not %.9g within %g of it\n", got, want, share);
    fail();
}

static void what_moves_is_told_from_what_stands_still(void **state)
{
    struct scene *s = make_scene(true, 0.001);
    struct motion m = judge_motion(s);
    (void)state;

    assert_int_equal(m.still_pixels, STILL_COLUMNS * HEIGHT);
    assert_within(m.still_share, (double)STILL_COLUMNS / WIDTH, 1e-12);
    for (int i = 0; i < PIXELS; i++)
        assert_int_equal(m.still[i], i % WIDTH < STILL_COLUMNS);
    motion_finish(&m);
    /* the columns that grow are furthest from their mean at first: 0.55 of 1 and a little */
    assert_int_equal(motion_init(&m, s->judges, FRAMES, 0.5, NULL), ERR_OK);
    assert_int_equal(m.still_pixels, STILL_COLUMNS * HEIGHT);
    motion_finish(&m);
    assert_int_equal(motion_init(&m, s->judges, FRAMES, 0.56, NULL), ERR_OK);
    assert_int_equal(m.still_pixels, PIXELS);
    finish_scene(s, &m);
}

/* 1800 values over 12 frames: the standard deviation of a variance of even noise is sqrt(0.8 / 19800) of it, 0.6 %; its
 * root is known to 0.3 %, the limit is 2 %, for four tests. References as noisy as the pictures do not add to it: taken
 * as the truth, their mean would make it sqrt(1.5) times as large. */
static void flicker_is_the_noise_that_is_new_in_each_frame(void **state)
{
    static const double sigmas[2] = { 0.0, 0.04 };
    (void)state;

    for (int k = 0; k < 2; k++) {
        struct scene *s = make_scene(false, sigmas[k]);
        struct motion m;
        assert_int_equal(motion_init(&m, s->judges, FRAMES, 1.0, NULL), ERR_OK);
        make_pictures(s, 0.04, true);
        assert_within(motion_flicker(&m, s->pictures, NULL), 0.04 * sqrt(WEIGHT), 0.02);
        make_pictures(s, 0.08, true);
        assert_within(motion_flicker(&m, s->pictures, NULL), 0.08 * sqrt(WEIGHT), 0.02);
        finish_scene(s, &m);
    }
}

static void noise_that_stands_still_does_not_flicker(void **state)
{
    struct scene *s = make_scene(false, 0.0);
    struct motion m = judge_motion(s);
    (void)state;

    make_pictures(s, 0.1, false);
    assert_within(judge_error(&s->judges[0], s->x[0]), 0.01 * WEIGHT, 0.1);
    assert_true(motion_flicker(&m, s->pictures, NULL) < 1e-7);
    assert_true(fabs(motion_change(&m, s->pictures)) < 1e-14);
    finish_scene(s, &m);
}

/* A lamp that swings by 3 % about what is right: a sine over whole periods has a standard deviation of 1 / sqrt(2) of
 * its height, with n - 1 in place of n. Seen where it stands, and nowhere else. */
static void flicker_is_found_where_it_is(void **state)
{
    static float map[PIXELS];
    struct scene *s = make_scene(true, 0.0);
    struct motion m = judge_motion(s);
    const double want = 0.03 * sqrt(0.5 * FRAMES / (FRAMES - 1.0));
    (void)state;

    make_pictures(s, 0.0, false);
    for (int t = 0; t < FRAMES; t++)
        for (int v = 0; v < VALUES; v++)
            if (v / 3 % WIDTH < 5)
                s->x[t][v] += 0.03f * (float)sin(6.28318530718 * t / (FRAMES / 2));
    const double all = motion_flicker(&m, s->pictures, map);
    const double weight = (double)map[0] / want; /* the mean of the truth is not 1 in these frames */
    assert_true(weight > 0.98 && weight <= 1.0);
    assert_within(all, weight * want * sqrt(5.0 / STILL_COLUMNS), 1e-5);
    for (int i = 0; i < PIXELS; i++) {
        if (i % WIDTH >= STILL_COLUMNS)
            assert_true(isnan(map[i]));
        else
            assert_true(i % WIDTH < 5 ? fabs((double)map[i] - weight * want) < 1e-5 : map[i] < 1e-5f);
    }
    finish_scene(s, &m);
}

/* Errors of frame differences: twice the variance where noise is new in each frame, whatever the references' own. The
 * mean of 1800 x 11 products; with references as noisy as the pictures it is known to about 2 %. */
static void change_is_twice_the_noise_that_is_new(void **state)
{
    struct scene *s = make_scene(false, 0.04);
    struct motion m = judge_motion(s);
    (void)state;

    make_pictures(s, 0.04, true);
    assert_within(motion_change(&m, s->pictures), 2.0 * 0.0016 * WEIGHT, 0.08);
    finish_scene(s, &m);
}

/* A picture that comes a frame late: its differences are right from the second on while the truth grows evenly, and
 * what is missing is the first step, 0.1 on a third of the pixels. */
static void change_forgives_no_lag_at_a_start(void **state)
{
    struct scene *s = make_scene(true, 0.0);
    struct motion m = judge_motion(s);
    double want = 0.0, mean = 1.0 + 0.1 / 3.0;
    (void)state;

    for (int t = 0; t < FRAMES; t++)
        memcpy(s->x[t], s->truth[t ? t - 1 : 0], sizeof(s->x[t]));
    want = 0.01 / (1.1 * 1.1 + 0.01 * mean * mean) / 3.0 / (FRAMES - 1);
    assert_within(motion_change(&m, s->pictures), want, 1e-4);
    assert_true(motion_flicker(&m, s->pictures, NULL) < 1e-6); /* where nothing moves nothing comes late */
    finish_scene(s, &m);
}

/* A mean over time that takes a share of 0.2 of each new frame: its error falls by 0.8^2 a frame, and is at a hundredth
 * after 11 of them, ln(0.1) / ln(0.8) = 10.3. */
static void a_lag_is_told_in_frames(void **state)
{
    double errors[30];
    (void)state;

    for (int k = 0; k < 30; k++)
        errors[k] = pow(0.8, 2 * k);
    assert_int_equal(motion_settled(errors, 30, 0.01), 11);
    assert_int_equal(motion_settled(errors, 30, 1.0), 0);
    assert_int_equal(motion_settled(errors, 30, 1e-9), 30);
    errors[25] = 0.5; /* settled is what stays so */
    assert_int_equal(motion_settled(errors, 30, 0.01), 26);
    errors[29] = NAN;
    assert_int_equal(motion_settled(errors, 30, 0.01), 30);
}

static void masked_pixels_do_not_count(void **state)
{
    struct scene *s = make_scene(false, 0.0);
    struct motion m;
    (void)state;

    for (int i = 0; i < PIXELS; i++)
        everything[i] = i % WIDTH < 10;
    for (int t = 0; t < FRAMES; t++) {
        judge_finish(&s->judges[t]);
        assert_int_equal(judge_init(&s->judges[t], s->a[t], s->b[t], everything, WIDTH, HEIGHT, NULL), ERR_OK);
    }
    m = judge_motion(s);
    assert_int_equal(m.still_pixels, 10 * HEIGHT);
    make_pictures(s, 0.0, false);
    for (int t = 0; t < FRAMES; t++)
        for (int v = 0; v < VALUES; v++)
            if (v / 3 % WIDTH >= 10)
                s->x[t][v] = t % 2 ? NAN : 5.0f;
    assert_true(motion_flicker(&m, s->pictures, NULL) < 1e-9);
    assert_true(fabs(motion_change(&m, s->pictures)) < 1e-12);
    finish_scene(s, &m);
}

static void what_is_no_number_is_infinitely_wrong(void **state)
{
    struct scene *s = make_scene(false, 0.0);
    struct motion m = judge_motion(s);
    (void)state;

    make_pictures(s, 0.0, false);
    s->x[4][100] = NAN;
    assert_true(isinf(motion_flicker(&m, s->pictures, NULL)));
    assert_true(isinf(motion_change(&m, s->pictures)));
    finish_scene(s, &m);
}

/* The right columns alone are looked at. */
static void where_everything_moves_flicker_is_unknown(void **state)
{
    struct scene *s = make_scene(true, 0.0);
    struct motion m;
    (void)state;

    for (int i = 0; i < PIXELS; i++)
        everything[i] = i % WIDTH >= STILL_COLUMNS;
    for (int t = 0; t < FRAMES; t++) {
        judge_finish(&s->judges[t]);
        assert_int_equal(judge_init(&s->judges[t], s->a[t], s->b[t], everything, WIDTH, HEIGHT, NULL), ERR_OK);
    }
    m = judge_motion(s);
    make_pictures(s, 0.1, true);
    assert_int_equal(m.still_pixels, 0);
    assert_true(isnan(motion_flicker(&m, s->pictures, NULL)));
    finish_scene(s, &m);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(what_moves_is_told_from_what_stands_still),
    cmocka_unit_test(flicker_is_the_noise_that_is_new_in_each_frame),
    cmocka_unit_test(noise_that_stands_still_does_not_flicker),
    cmocka_unit_test(flicker_is_found_where_it_is),
    cmocka_unit_test(change_is_twice_the_noise_that_is_new),
    cmocka_unit_test(change_forgives_no_lag_at_a_start),
    cmocka_unit_test(a_lag_is_told_in_frames),
    cmocka_unit_test(masked_pixels_do_not_count),
    cmocka_unit_test(what_is_no_number_is_infinitely_wrong),
    cmocka_unit_test(where_everything_moves_flicker_is_unknown),
};

UNIT_MAIN(tests)
