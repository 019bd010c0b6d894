/* Errors against a truth that is known only through two noisy references. Here the truth is known: an image of 40 x 30
 * pixels with values of 0.2 to 1.2; noise is even, of a stated standard deviation, independent in every channel. */
#include "measure/chart/judge.h"

#include "base/rng.h"
#include "support/unit.h"

#include <math.h>

enum { WIDTH = 40, HEIGHT = 30, PIXELS = WIDTH * HEIGHT, VALUES = 3 * PIXELS, SEEDS = 16 };

static float truth[VALUES];
static uint8_t everything[PIXELS];

/* truth * scale + noise, seed by seed. */
static void make_image(float *out, uint64_t seed, double scale, double sigma)
{
    struct rng r = { rng_mix(seed, 77) };
    for (int v = 0; v < VALUES; v++)
        out[v] = (float)((double)truth[v] * scale + sigma * sqrt(12.0) * (rng_next(&r) - 0.5));
}

static void make_truth(void)
{
    struct rng r = { 5 };
    for (int v = 0; v < VALUES; v++)
        truth[v] = (float)(0.2 + rng_next(&r));
    memset(everything, 1, sizeof(everything));
}

static struct judge make_judge(float *a, float *b, uint64_t seed, double sigma)
{
    struct judge j;
    make_image(a, rng_mix(seed, 1), 1.0, sigma);
    make_image(b, rng_mix(seed, 2), 1.0, sigma);
    assert_int_equal(judge_init(&j, a, b, everything, WIDTH, HEIGHT, NULL), ERR_OK);
    return j;
}

/* relMSE by its definition, r being the truth. */
static double error_by_definition(const float *x)
{
    double mean = 0.0, sum = 0.0;
    for (int v = 0; v < VALUES; v++)
        mean += (double)truth[v] / VALUES;
    for (int v = 0; v < VALUES; v++) {
        const double d = (double)x[v] - (double)truth[v], r = (double)truth[v];
        sum += d * d / (r * r + 1e-2 * mean * mean) / VALUES;
    }
    return sum;
}

/* An image of noise 0.02 against 400 pairs of references that are as noisy as itself. The mean of its errors is that
 * of the definition within 4 standard errors, which are asserted to be below 0.5 % of it. What stays is the noise in
 * the weights, which is of the order sigma^2 / r^2: 1 % is granted to it. Squares of differences from the mean
 * reference are half as large again, which the last line shows. */
static void error_is_right_in_the_mean_though_references_are_noisy(void **state)
{
    static float x[VALUES], a[VALUES], b[VALUES], r[VALUES];
    const int pairs = 400;
    const double sigma = 0.02;
    double sum = 0.0, square = 0.0, naive = 0.0;
    (void)state;

    make_truth();
    make_image(x, 1, 1.0, sigma);
    const double want = error_by_definition(x);
    for (int k = 0; k < pairs; k++) {
        struct judge j = make_judge(a, b, 100 + (uint64_t)k, sigma);
        const double e = judge_error(&j, x);
        sum += e / pairs;
        square += e * e / pairs;
        memcpy(r, j.mean, sizeof(r));
        for (int v = 0; v < VALUES; v++)
            naive += (double)j.weight[v] * ((double)x[v] - (double)r[v]) * ((double)x[v] - (double)r[v]) / pairs;
        judge_finish(&j);
    }
    const double doubt = sqrt((square - sum * sum) / pairs);
    print_message("error %.6f, by definition %.6f, standard error %.6f, against the mean reference %.6f\n", sum, want,
                  doubt, naive);
    assert_true(doubt < 0.005 * want);
    assert_true(fabs(sum - want) < 4.0 * doubt + 0.01 * want);
    assert_true(naive > 1.4 * want);
}

/* `doubt` is the standard deviation of a perfect image's error, and its mean is 0: over 400 pairs the standard
 * deviation is known to 3.5 %, so that a factor of 1.2 either way is told. */
static void doubt_is_how_a_perfect_images_error_scatters(void **state)
{
    static float a[VALUES], b[VALUES];
    const int pairs = 400;
    double sum = 0.0, square = 0.0, doubt = 0.0, noise = 0.0;
    (void)state;

    make_truth();
    for (int k = 0; k < pairs; k++) {
        struct judge j = make_judge(a, b, 1000 + (uint64_t)k, 0.02);
        const double e = judge_error(&j, truth);
        sum += e / pairs;
        square += e * e / pairs;
        doubt += j.doubt / pairs;
        noise += j.noise / pairs;
        judge_finish(&j);
    }
    const double spread = sqrt(square - sum * sum);
    print_message("mean %.2e, spread %.2e, stated %.2e, noise %.2e\n", sum, spread, doubt, noise);
    assert_true(fabs(sum) < 4.0 * spread / sqrt(pairs) + 0.01 * noise); /* of the noise in the weights */
    /* Three channels with noise of their own scatter less than the one that they are taken for: by sqrt(5 / 9). */
    assert_true(doubt > 1.0 * spread && doubt < 1.7 * spread);
}

struct floors { /* over trials */
    double bias, variance, z, z2, least_z, worst_z;
};

static struct floors judge_trials(int trials, double scale, double sigma)
{
    static float a[VALUES], b[VALUES], x[SEEDS][VALUES];
    struct floors all = { .least_z = INFINITY };

    for (int k = 0; k < trials; k++) {
        struct judge j = make_judge(a, b, 5000 + (uint64_t)k, 0.01);
        const float *images[SEEDS];
        double pairs[SEEDS * SEEDS], energy[SEEDS];
        struct judge_floor f;
        for (int s = 0; s < SEEDS; s++) {
            make_image(x[s], rng_mix(9000 + (uint64_t)k, (uint64_t)s), scale, sigma);
            images[s] = x[s];
            energy[s] = judge_energy(&j, x[s]);
        }
        judge_pairs(&j, images, SEEDS, pairs);
        judge_floor(&j, pairs, energy, SEEDS, &f);
        all.bias += f.bias / trials;
        all.variance += f.variance / trials;
        all.z += f.z / trials;
        all.z2 += f.z * f.z / trials;
        all.least_z = fmin(all.least_z, f.z);
        all.worst_z = fmax(all.worst_z, f.z);
        assert_true(fabs(f.energy - scale) < 5.0 * f.energy_doubt + 1e-3);
        judge_finish(&j);
    }
    return all;
}

/* Images of noise 0.1 that are 3 % too bright: bias squared is 9e-4, a fortieth of the variance. It is found in each
 * of 40 trials with z above 3, while of 40 without it none exceeds 3.5 (of 40 normal numbers one does once in a hundred
 * runs; the seeds are fixed) and the mean square of z, 1 for a normal number, is below 1.9, four of its standard errors
 * above. */
static void planted_bias_is_told_from_variance(void **state)
{
    (void)state;
    make_truth();
    const struct floors clean = judge_trials(40, 1.0, 0.1), planted = judge_trials(40, 1.03, 0.1);
    print_message("clean: bias %.2e, z %.2f, its square %.2f, worst %.2f; planted: bias %.2e, z %.2f; variance %.3e\n",
                  clean.bias, clean.z, clean.z2, clean.worst_z, planted.bias, planted.z, planted.variance);
    assert_true(fabs(clean.z) < 4.0 / sqrt(40.0));
    assert_true(clean.worst_z < 3.5 && clean.z2 < 1.9);
    assert_true(planted.least_z > 3.0);
    assert_true(fabs(planted.bias - 9e-4) < 0.1 * 9e-4); /* of r^2 / (r^2 + soft): a little less */
    assert_true(fabs(planted.variance / clean.variance - 1.0) < 0.02);
}

/* Noise alone knows neither bias nor references: it agrees with the variance, at 1 % and at 100 % too bright. */
static void noise_alone_is_the_variance(void **state)
{
    static float a[VALUES], b[VALUES], x[SEEDS][VALUES];
    const float *images[SEEDS];
    double pairs[SEEDS * SEEDS], energy[SEEDS], errors[ERROR_KINDS * SEEDS], sum = 0.0;
    struct judge_floor f;
    (void)state;

    make_truth();
    struct judge j = make_judge(a, b, 3, 0.01);
    for (int s = 0; s < SEEDS; s++) {
        make_image(x[s], rng_mix(4, (uint64_t)s), 2.0, 0.1);
        images[s] = x[s];
        energy[s] = 2.0;
    }
    judge_pairs(&j, images, SEEDS, pairs);
    judge_floor(&j, pairs, energy, SEEDS, &f);
    assert_int_equal(errors_of(&j, everything, images, pairs, SEEDS, errors), ERR_OK);
    for (int s = 0; s < SEEDS; s++)
        sum += errors[ERROR_NOISE * SEEDS + s] / SEEDS;
    assert_true(fabs(sum / f.variance - 1.0) < 1e-9);
    assert_true(f.bias > 0.8 && errors[ERROR_REL_MSE * SEEDS] > 0.8 && errors[ERROR_DELTA_E * SEEDS] > 1.0);
    assert_true(errors[ERROR_FLIP * SEEDS] > 0.1 && errors[ERROR_FLIP * SEEDS] < 1.0);
    judge_finish(&j);
}

static void what_is_no_number_is_infinitely_wrong(void **state)
{
    static float a[VALUES], b[VALUES], x[VALUES];
    (void)state;

    make_truth();
    struct judge j = make_judge(a, b, 3, 0.01);
    make_image(x, 1, 1.0, 0.1);
    x[500] = NAN;
    assert_true(isinf(judge_error(&j, x)));
    x[500] = INFINITY;
    assert_true(isinf(judge_error(&j, x)));
    judge_finish(&j);
}

static void pixels_that_are_left_out_do_not_count(void **state)
{
    static float a[VALUES], b[VALUES], x[VALUES], map[PIXELS];
    static uint8_t mask[PIXELS];
    struct judge j;
    (void)state;

    make_truth();
    make_image(x, 1, 1.0, 0.1);
    memset(mask, 1, sizeof(mask));
    mask[7] = 0;
    assert_int_equal(judge_init(&j, truth, truth, mask, WIDTH, HEIGHT, NULL), ERR_OK);
    const double e = judge_error(&j, x);
    x[3 * 7] = NAN;
    assert_true(judge_error(&j, x) == e && j.pixels == PIXELS - 1 && j.noise == 0.0);
    judge_map(&j, x, map);
    double sum = 0.0;
    for (int i = 0; i < PIXELS; i++)
        sum += (double)map[i] / (PIXELS - 1);
    assert_true(map[7] == 0.0f && fabs(sum / e - 1.0) < 1e-5);
    judge_finish(&j);
    memset(mask, 0, sizeof(mask));
    assert_int_equal(judge_init(&j, truth, truth, mask, WIDTH, HEIGHT, NULL), ERR_RANGE);
    memset(a, 0, sizeof(a));
    memset(b, 0, sizeof(b));
    assert_int_equal(judge_init(&j, a, b, everything, WIDTH, HEIGHT, NULL), ERR_RANGE);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(error_is_right_in_the_mean_though_references_are_noisy),
    cmocka_unit_test(doubt_is_how_a_perfect_images_error_scatters),
    cmocka_unit_test(planted_bias_is_told_from_variance),
    cmocka_unit_test(noise_alone_is_the_variance),
    cmocka_unit_test(what_is_no_number_is_infinitely_wrong),
    cmocka_unit_test(pixels_that_are_left_out_do_not_count),
};
UNIT_MAIN(tests)
