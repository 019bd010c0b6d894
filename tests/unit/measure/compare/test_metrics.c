#include "measure/compare/metrics.h"

#include "base/rng.h"
#include "light/frame/near.h"
#include "support/unit.h"

#include <math.h>
#include <omp.h>

#define WIDTH 20
#define HEIGHT 10
#define COUNT (WIDTH * HEIGHT)

struct sent_image {
    float rgb[COUNT][3];
};

static void fill(struct sent_image *p, float r, float g, float b)
{
    for (size_t i = 0; i < COUNT; i++) {
        p->rgb[i][0] = r;
        p->rgb[i][1] = g;
        p->rgb[i][2] = b;
    }
}

static void scatter(struct sent_image *p, uint64_t seed)
{
    struct rng r = { seed };
    for (size_t i = 0; i < COUNT; i++)
        for (int k = 0; k < 3; k++)
            p->rgb[i][k] = (float)(0.05 + rng_next(&r));
}

static struct metrics compare(const struct sent_image *x, const struct sent_image *r, const uint8_t *mask, double trim,
                              float *map)
{
    struct metrics m;
    assert_true(metrics_compare(&x->rgb[0][0], &r->rgb[0][0], mask, WIDTH, HEIGHT, trim, map, &m));
    return m;
}

static void equal_images_differ_by_nothing(void **state)
{
    static struct sent_image r;
    (void)state;

    scatter(&r, 1);
    const struct metrics m = compare(&r, &r, NULL, 0.02, NULL);
    assert_near(m.mean_ratio, 1.0, 0.0);
    assert_near(m.rel_mse, 0.0, 0.0);
    assert_near(m.rel_mse_trimmed, 0.0, 0.0);
    assert_near(m.delta_e, 0.0, 0.0);
    assert_int_equal(m.pixels, COUNT);
}

/* r = 2, x = 2.2: 0.04 / (4 + 0.01 * 4). */
static void relmse_is_the_formula_on_constants(void **state)
{
    static struct sent_image x, r;
    (void)state;

    fill(&x, 2.2f, 2.2f, 2.2f);
    fill(&r, 2.0f, 2.0f, 2.0f);
    const struct metrics m = compare(&x, &r, NULL, 0.0, NULL);
    assert_near(m.mean_ratio, 1.1, 1e-6);
    assert_near(m.rel_mse, 0.04 / 4.04, 1e-6);
    assert_near(m.rel_mse_trimmed, m.rel_mse, 0.0);
}

/* The softening term takes the mean over all channels, (3 + 0 + 0) / 3 = 1, and each channel counts a third. */
static void relmse_takes_one_mean_over_all_channels(void **state)
{
    static struct sent_image x, r;
    (void)state;

    fill(&x, 3.0f, 0.1f, 0.0f);
    fill(&r, 3.0f, 0.0f, 0.0f);
    assert_near(compare(&x, &r, NULL, 0.0, NULL).rel_mse, 0.01 / 0.01 / 3.0, 1e-6);
}

static void trim_leaves_out_the_worst_pixels_only(void **state)
{
    static struct sent_image x, r;
    (void)state;

    scatter(&r, 2);
    x = r;
    x.rgb[57][1] += 1000.0f;
    x.rgb[58][2] += 0.01f;
    const struct metrics none = compare(&x, &r, NULL, 0.0, NULL);
    const struct metrics one = compare(&x, &r, NULL, 1.0 / COUNT, NULL);
    const struct metrics two = compare(&x, &r, NULL, 2.0 / COUNT, NULL);
    const struct metrics all = compare(&x, &r, NULL, 1.0, NULL);
    assert_true(none.rel_mse_trimmed > 100.0);
    assert_true(one.rel_mse_trimmed > 0.0 && one.rel_mse_trimmed < 1e-4);
    assert_near(one.rel_mse, none.rel_mse, 0.0);
    assert_near(two.rel_mse_trimmed, 0.0, 0.0);
    assert_near(all.rel_mse_trimmed, 0.0, 0.0);
}

static void masked_pixels_count_nowhere(void **state)
{
    static struct sent_image x, r, small_x, small_r;
    static uint8_t mask[COUNT];
    static float map[COUNT];
    (void)state;

    /* the left half is what `small` holds everywhere; the right half is nonsense and masked */
    fill(&small_x, 0.5f, 0.4f, 0.3f);
    fill(&small_r, 0.6f, 0.4f, 0.2f);
    x = small_x;
    r = small_r;
    for (size_t i = 0; i < COUNT; i++) {
        mask[i] = i % WIDTH < WIDTH / 2;
        for (int k = 0; k < 3 && !mask[i]; k++) {
            x.rgb[i][k] = NAN;
            r.rgb[i][k] = 1e6f;
        }
    }
    const struct metrics got = compare(&x, &r, mask, 0.02, map);
    const struct metrics want = compare(&small_x, &small_r, NULL, 0.02, NULL);
    assert_int_equal(got.pixels, COUNT / 2);
    assert_near(got.mean_ratio, want.mean_ratio, 1e-9);
    assert_near(got.rel_mse, want.rel_mse, 1e-9);
    assert_near(got.delta_e, want.delta_e, 1e-9);
    assert_near((double)map[WIDTH - 1], 0.0, 0.0);
    memset(mask, 0, sizeof(mask));
    struct metrics m;
    assert_false(metrics_compare(&x.rgb[0][0], &r.rgb[0][0], mask, WIDTH, HEIGHT, 0.0, NULL, &m));
}

static void error_map_averages_to_relmse(void **state)
{
    static struct sent_image x, r;
    static float map[COUNT];
    double sum = 0.0;
    (void)state;

    scatter(&x, 4);
    scatter(&r, 5);
    const struct metrics m = compare(&x, &r, NULL, 0.02, map);
    for (size_t i = 0; i < COUNT; i++)
        sum += (double)map[i];
    assert_near(sum / COUNT, m.rel_mse, 1e-6 * m.rel_mse);
}

/* A constant reference is shown at 0.18, whose lightness is 49.496; black is 0 and white 100. */
static void delta_e_of_greys_is_their_lightness(void **state)
{
    static struct sent_image x, r;
    (void)state;

    fill(&r, 7.0f, 7.0f, 7.0f);
    assert_near(compare(&x, &r, NULL, 0.0, NULL).delta_e, 49.496, 0.02);
    fill(&x, 7e4f, 7e4f, 7e4f);
    assert_near(compare(&x, &r, NULL, 0.0, NULL).delta_e, 100.0 - 49.496, 0.02);
}

/* sRGB's red is L*a*b* (53.24, 80.09, 67.20), its green (87.73, -86.18, 83.18), its blue (32.30, 79.19, -107.86). */
static void delta_e_of_pure_colours_is_that_of_the_tables(void **state)
{
    static const double lab[3][3] = { { 53.24, 80.09, 67.20 }, { 87.73, -86.18, 83.18 }, { 32.30, 79.19, -107.86 } };
    static struct sent_image x, black;
    (void)state;

    for (int k = 0; k < 3; k++) {
        fill(&x, k == 0 ? 1e3f : 0.0f, k == 1 ? 1e3f : 0.0f, k == 2 ? 1e3f : 0.0f);
        const double want = sqrt(lab[k][0] * lab[k][0] + lab[k][1] * lab[k][1] + lab[k][2] * lab[k][2]);
        assert_near(compare(&x, &black, NULL, 0.0, NULL).delta_e, want, 0.05);
    }
}

static void black_reference_and_no_numbers_are_infinitely_wrong(void **state)
{
    static struct sent_image x, r, black;
    static float map[COUNT];
    (void)state;

    assert_near(compare(&black, &black, NULL, 0.0, NULL).rel_mse, 0.0, 0.0);
    assert_near(compare(&black, &black, NULL, 0.0, NULL).mean_ratio, 1.0, 0.0);
    x.rgb[3][0] = 1.0f;
    assert_true(isinf(compare(&x, &black, NULL, 0.0, NULL).rel_mse));
    scatter(&r, 6);
    x = r;
    x.rgb[9][2] = NAN;
    const struct metrics m = compare(&x, &r, NULL, 1.0 / COUNT, map);
    assert_true(isinf(m.rel_mse));
    assert_true(isinf(map[9]));
    assert_near(m.rel_mse_trimmed, 0.0, 0.0);
}

static void numbers_have_the_same_bits_at_any_thread_count(void **state)
{
    static struct sent_image x, r;
    (void)state;

    scatter(&x, 8);
    scatter(&r, 9);
    omp_set_num_threads(1);
    const struct metrics want = compare(&x, &r, NULL, 0.02, NULL);
    for (int n = 2; n <= 5; n++) {
        omp_set_num_threads(n);
        const struct metrics got = compare(&x, &r, NULL, 0.02, NULL);
        assert_memory_equal(&got, &want, sizeof(got));
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(equal_images_differ_by_nothing),
    cmocka_unit_test(relmse_is_the_formula_on_constants),
    cmocka_unit_test(relmse_takes_one_mean_over_all_channels),
    cmocka_unit_test(trim_leaves_out_the_worst_pixels_only),
    cmocka_unit_test(masked_pixels_count_nowhere),
    cmocka_unit_test(error_map_averages_to_relmse),
    cmocka_unit_test(delta_e_of_greys_is_their_lightness),
    cmocka_unit_test(delta_e_of_pure_colours_is_that_of_the_tables),
    cmocka_unit_test(black_reference_and_no_numbers_are_infinitely_wrong),
    cmocka_unit_test(numbers_have_the_same_bits_at_any_thread_count),
};

UNIT_MAIN(tests)
