#include "image/film/film.h"

#include "base/rng.h"
#include "light/frame/near.h"
#include "support/unit.h"

#include <float.h>
#include <math.h>
#include <omp.h>

#define WIDTH 97
#define HEIGHT 71 /* more than the bands that sums are split into, and no multiple */
#define COUNT (WIDTH * HEIGHT)

struct sent_image {
    float rgb[COUNT][3];
};

static void set(struct sent_image *p, size_t i, float grey)
{
    p->rgb[i][0] = p->rgb[i][1] = p->rgb[i][2] = grey;
}

static void fill(struct sent_image *p, float grey)
{
    for (size_t i = 0; i < COUNT; i++)
        set(p, i, grey);
}

/* Grey pixels spread evenly over `stops` stops around 1. */
static void scatter(struct sent_image *p, double stops)
{
    struct rng r = { 7 };
    for (size_t i = 0; i < COUNT; i++)
        set(p, i, (float)exp2(stops * (rng_next(&r) - 0.5)));
}

static double log2_mean(const struct sent_image *p)
{
    double mean = NAN;
    assert_true(exposure_log2_mean(&p->rgb[0][0], NULL, WIDTH, HEIGHT, &mean));
    return mean;
}

static double step(struct exposure *e, const struct sent_image *p)
{
    return exposure_step(e, &p->rgb[0][0], WIDTH, HEIGHT, 1);
}

static void log_average_of_a_constant_is_the_constant(void **state)
{
    static const float greys[] = { 1e-6f, 0.013f, 0.5f, 1.0f, 3.7f, 1e5f };
    static struct sent_image p;
    (void)state;

    for (size_t i = 0; i < sizeof(greys) / sizeof(greys[0]); i++) {
        fill(&p, greys[i]);
        assert_near(log2_mean(&p), log2((double)greys[i]), 1e-6);
    }
}

static void log_average_is_the_geometric_mean(void **state)
{
    static struct sent_image p;
    double want = 0.0;
    (void)state;

    scatter(&p, 12.0);
    for (size_t i = 0; i < COUNT; i++)
        want += log2((double)p.rgb[i][0]);
    assert_near(log2_mean(&p), want / COUNT, 1e-6);
}

/* 1 and 4096: half of two pixels are below 2, the upper end of the bin of 1. The other counts as 2 times 2^8: stops 0
 * and 9. Of 1, 4 and 4096 the middle is half way through the bin of 4: 2.5 stops, and 10.5 at most. */
static void outliers_count_as_eight_stops_from_the_median(void **state)
{
    static const float two[] = { 1, 1, 1, 4096, 4096, 4096 }, three[] = { 1, 1, 1, 4, 4, 4, 4096, 4096, 4096 };
    double mean = NAN;
    (void)state;
    assert_true(exposure_log2_mean(two, NULL, 2, 1, &mean));
    assert_near(mean, 4.5, 1e-5);
    assert_true(exposure_log2_mean(three, NULL, 3, 1, &mean));
    assert_near(mean, (0.0 + 2.0 + 10.5) / 3.0, 1e-5);
}

static void black_and_no_numbers_do_not_count(void **state)
{
    static const float odd[] = { 0.0f, -1.0f, NAN, -INFINITY };
    static struct sent_image p;
    (void)state;

    fill(&p, 0.25f);
    for (size_t i = 0; i < COUNT; i += 3)
        set(&p, i, odd[i % 4]);
    assert_near(log2_mean(&p), -2.0, 1e-6);
}

static void masked_pixels_do_not_count(void **state)
{
    static struct sent_image p;
    static uint8_t mask[COUNT];
    double mean = NAN;
    (void)state;

    for (size_t i = 0; i < COUNT; i++) {
        set(&p, i, i % 5 ? 8.0f : 0.5f);
        mask[i] = i % 5 == 0;
    }
    assert_true(exposure_log2_mean(&p.rgb[0][0], mask, WIDTH, HEIGHT, &mean));
    assert_near(mean, -1.0, 1e-6);
    memset(mask, 0, sizeof(mask));
    assert_false(exposure_log2_mean(&p.rgb[0][0], mask, WIDTH, HEIGHT, &mean));
}

/* A third of the image at 1e-30 would pull a plain log-average down by 33 stops. */
static void near_black_pulls_no_further_than_eight_stops(void **state)
{
    static struct sent_image p;
    (void)state;

    for (size_t i = 0; i < COUNT; i++)
        set(&p, i, i % 3 ? 1.0f : 1e-30f);
    /* the median of pixels in [1, 2) is known to a stop only */
    assert_true(log2_mean(&p) > -8.0 / 3.0 - 0.01);
    assert_true(log2_mean(&p) < 0.0);
}

static void one_sun_hardly_moves_the_average(void **state)
{
    static struct sent_image p;
    static const float suns[] = { 1e9f, FLT_MAX, INFINITY };
    (void)state;

    for (size_t i = 0; i < sizeof(suns) / sizeof(suns[0]); i++) {
        fill(&p, 0.18f);
        set(&p, COUNT / 2, suns[i]);
        assert_near(log2_mean(&p), log2(0.18), 10.0 / COUNT);
    }
}

/* A sky that brightens by 1 % a frame must not make the gain jump when the median passes a power of two. */
static void gain_follows_brightness_without_steps(void **state)
{
    static struct sent_image p;
    double last = 0.0;
    (void)state;

    for (int k = 0; k < 150; k++) {
        const double scale = pow(1.01, k);
        scatter(&p, 24.0);
        for (size_t i = 0; i < COUNT; i++)
            set(&p, i, p.rgb[i][0] * (float)scale);
        const double mean = log2_mean(&p) - log2(scale);
        if (k > 0)
            assert_near(mean, last, 0.01);
        last = mean;
    }
}

static void first_frame_is_taken_at_once(void **state)
{
    static struct sent_image p;
    struct exposure e;
    (void)state;

    exposure_init(&e);
    fill(&p, 36.0f);
    assert_near(step(&e, &p), 0.18 / 36.0, 1e-8);
}

static void black_frames_keep_the_gain(void **state)
{
    static struct sent_image p, black;
    struct exposure e;
    (void)state;

    exposure_init(&e);
    assert_near(step(&e, &black), 1.0, 0.0);
    fill(&p, 2.0f);
    const double gain = step(&e, &p);
    assert_near(gain, 0.09, 1e-8); /* a black frame before is no first frame */
    for (int i = 0; i < 5; i++)
        assert_near(step(&e, &black), gain, 0.0);
}

/* Seventeen stops within one frame, both ways: every step comes nearer, none passes the goal. */
static void dawn_to_night_approaches_without_overshoot(void **state)
{
    static const float ends[][2] = { { 1e4f, 0.1f }, { 0.1f, 1e4f } };
    static struct sent_image p;
    (void)state;

    for (int way = 0; way < 2; way++) {
        struct exposure e;
        exposure_init(&e);
        fill(&p, ends[way][0]);
        double last = log2(step(&e, &p));
        fill(&p, ends[way][1]);
        const double goal = log2(0.18 / (double)ends[way][1]);
        for (int i = 0; i < 60; i++) {
            const double now = log2(step(&e, &p));
            assert_true(fabs(goal - now) <= fabs(goal - last) + 1e-9);
            assert_true((goal - now) * (goal - last) >= -1e-9);
            last = now;
        }
        assert_near(last, goal, 0.01);
    }
}

static void adapt_one_takes_every_frame_at_once(void **state)
{
    static struct sent_image p;
    struct exposure e;
    (void)state;

    exposure_init(&e);
    e.adapt = 1.0;
    for (int i = 0; i < 4; i++) {
        const float grey = ldexpf(3.0f, 5 * (i % 2 ? i : -i));
        fill(&p, grey);
        assert_near(step(&e, &p) * (double)grey, 0.18, 1e-7);
    }
}

static void extreme_images_give_a_usable_gain(void **state)
{
    static const float greys[] = { 0x1p-149f, FLT_MIN, FLT_MAX, INFINITY };
    static struct sent_image p;
    (void)state;

    for (size_t i = 0; i < sizeof(greys) / sizeof(greys[0]); i++) {
        struct exposure e;
        exposure_init(&e);
        fill(&p, greys[i]);
        const double gain = step(&e, &p);
        assert_true(isfinite(gain) && gain > 0.0);
    }
}

static void average_has_the_same_bits_at_any_thread_count(void **state)
{
    static struct sent_image p;
    (void)state;

    scatter(&p, 30.0);
    omp_set_num_threads(1);
    const double want = log2_mean(&p);
    for (int n = 2; n <= 7; n++) {
        omp_set_num_threads(n);
        const double got = log2_mean(&p);
        assert_memory_equal(&got, &want, sizeof(got));
    }
}

/* A stream that dropped six of seven frames adapts as far as a script that saw all seven. */
static void seven_steps_and_one_step_by_seven_end_alike(void **state)
{
    (void)state;
    static struct sent_image bright, dim;
    struct exposure a, b;
    fill(&bright, 10.0f);
    fill(&dim, 0.01f);
    exposure_init(&a);
    exposure_init(&b);
    step(&a, &bright);
    step(&b, &bright);
    double gain = 0.0;
    for (int i = 0; i < 7; i++)
        gain = step(&a, &dim);
    assert_true(fabs(exposure_step(&b, &dim.rgb[0][0], WIDTH, HEIGHT, 7) / gain - 1.0) < 1e-9);
    assert_true(gain > 1.1 * exp2(log2(0.18 / 10.0)));
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(log_average_of_a_constant_is_the_constant),
    cmocka_unit_test(log_average_is_the_geometric_mean),
    cmocka_unit_test(black_and_no_numbers_do_not_count),
    cmocka_unit_test(outliers_count_as_eight_stops_from_the_median),
    cmocka_unit_test(masked_pixels_do_not_count),
    cmocka_unit_test(near_black_pulls_no_further_than_eight_stops),
    cmocka_unit_test(one_sun_hardly_moves_the_average),
    cmocka_unit_test(gain_follows_brightness_without_steps),
    cmocka_unit_test(first_frame_is_taken_at_once),
    cmocka_unit_test(black_frames_keep_the_gain),
    cmocka_unit_test(dawn_to_night_approaches_without_overshoot),
    cmocka_unit_test(adapt_one_takes_every_frame_at_once),
    cmocka_unit_test(extreme_images_give_a_usable_gain),
    cmocka_unit_test(average_has_the_same_bits_at_any_thread_count),
    cmocka_unit_test(seven_steps_and_one_step_by_seven_end_alike),
};

UNIT_MAIN(tests)
