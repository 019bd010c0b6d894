/* Methods that estimate the same light agree in the mean. Points share samples, so pixels are correlated: the
 * replicates are seeds. For each method and sky, the mean over all points is taken per seed; two methods differ when
 * the difference of their means over the seeds exceeds LIMIT standard errors. 22 comparisons are made in all; LIMIT
 * = 4.2 is passed by chance in one run of about 1700 (two-sided 2.7e-5 each). Power: the standard error of each mean is
 * asserted to be below 0.12 %, so a bias of 1 % stands at least 1 % / (sqrt(2) 0.12 %) - 4.2 = 1.6 standard errors
 * beyond the limit (95 % of the time it is caught), and where the errors are smaller, nearly always;
 * planted_bias_is_caught shows it. */
#include "light/estimators/points.h"

#define LIMIT 4.2
#define WORST_ERROR 1.2e-3

enum { PACKETS = 12, SEEDS = 48 };

struct estimate {
    double mean, error; /* relative to nothing: radiance, luminance averaged over the points */
};

static struct estimate measure(const struct environment *e, const struct gbuffer *g, enum method m, uint32_t samples)
{
    static float lo[PACKETS * 3 * PACKET];
    double sum = 0.0, squares = 0.0;
    struct direct *d = direct_create(best_kernels());

    for (uint64_t seed = 0; seed < SEEDS; seed++) {
        double mean = 0.0;
        shade(d, g, e, m, samples, rng_mix(seed, (uint64_t)m), lo);
        for (uint32_t i = 0; i < PACKETS; i++)
            for (int l = 0; l < PACKET; l++) {
                const float *p = lo + (size_t)i * 3 * PACKET + l;
                mean += rgb_luminance(p[0], p[PACKET], p[2 * PACKET]) / (PACKETS * PACKET);
            }
        sum += mean;
        squares += mean * mean;
    }
    direct_destroy(d);
    const double mean = sum / SEEDS;
    return (struct estimate){ mean, sqrt(fmax(0.0, squares / SEEDS - mean * mean) / (SEEDS - 1)) };
}

static double z_score(struct estimate a, struct estimate b)
{
    return fabs(a.mean - b.mean) / (sqrt(a.error * a.error + b.error * b.error) + 1e-7 * fabs(a.mean));
}

static void compare(const char *what, const struct environment *e, const struct gbuffer *g, const enum method *methods,
                    size_t count, uint32_t samples)
{
    const struct estimate want = measure(e, g, METHOD_MIS, samples);

    assert_true(want.mean > 0.0);
    for (size_t k = 0; k < count; k++) {
        const struct estimate got = measure(e, g, methods[k], samples);
        if (z_score(got, want) > LIMIT || got.error > WORST_ERROR * want.mean)
            printf("%s, %s: %.6f +- %.6f, mis %.6f +- %.6f\n", what, method_name(methods[k]), got.mean, got.error,
                   want.mean, want.error);
        assert_true(got.error < WORST_ERROR * want.mean);
        assert_true(z_score(got, want) < LIMIT);
    }
}

static const enum method with_sky[] = { METHOD_UNIFORM, METHOD_BRDF, METHOD_LIGHT, METHOD_FACES_UNIFORM, METHOD_FACES };
static const enum method with_sun[] = { METHOD_LIGHT, METHOD_FACES_UNIFORM, METHOD_FACES };

static void all_methods_agree_under_overcast(void **state)
{
    (void)state;
    struct environment *e = sky_environment(sky_overcast(128, 64), 64, 0.0);
    struct gbuffer lambert = points_make(PACKETS, LOBE_LAMBERT, 0.6f, 0.0f, 0.0f);
    struct gbuffer phong = points_make(PACKETS, LOBE_PHONG, 0.3f, 0.6f, 20.0f);
    points_scatter(&lambert, 21);
    points_scatter(&phong, 22);
    compare("lambert, overcast", e, &lambert, with_sky, 5, 1024);
    compare("phong, overcast", e, &phong, with_sky, 5, 2048);
    points_free(&lambert);
    points_free(&phong);
    environment_destroy(e);
}

static void light_methods_agree_under_the_sun(void **state)
{
    (void)state;
    struct environment *e = sky_environment(sky_with_sun(128, 64, 1e5f), 64, 17.0);
    struct gbuffer lambert = points_make(PACKETS, LOBE_LAMBERT, 0.6f, 0.0f, 0.0f);
    struct gbuffer phong = points_make(PACKETS, LOBE_PHONG, 0.3f, 0.6f, 20.0f);
    points_scatter(&lambert, 31);
    points_scatter(&phong, 32);
    compare("lambert, sun", e, &lambert, with_sun, 3, 1024);
    compare("phong, sun", e, &phong, with_sun, 3, 2048);
    points_free(&lambert);
    points_free(&phong);
    environment_destroy(e);
}

/* Few samples and a fractional N_f at every face: beta of Eq. 5 must not bias. */
static void fractional_sample_counts_do_not_bias(void **state)
{
    static const enum method few[] = { METHOD_FACES, METHOD_FACES_UNIFORM, METHOD_BRDF };
    enum { ROUNDS = 64 };
    static float lo[PACKETS * 3 * PACKET];
    (void)state;
    struct environment *e = sky_environment(sky_overcast(64, 32), 32, 0.0);
    struct gbuffer g = points_make(PACKETS, LOBE_LAMBERT, 0.6f, 0.0f, 0.0f);
    points_scatter(&g, 41);
    const struct estimate want = measure(e, &g, METHOD_MIS, 1024);
    struct direct *d = direct_create(best_kernels());
    for (size_t k = 0; k < 3; k++)
        for (uint32_t n = 1; n <= 5; n += 2) {
            double sum = 0.0, squares = 0.0;
            const uint32_t seeds = ROUNDS * 64;
            for (uint64_t seed = 0; seed < seeds; seed++) {
                double mean = 0.0;
                shade(d, &g, e, few[k], n, rng_mix(seed, 1000 + n), lo);
                for (size_t q = 0; q < PACKETS; q++)
                    for (int l = 0; l < PACKET; l++) {
                        const float *p = lo + q * 3 * PACKET + l;
                        mean += rgb_luminance(p[0], p[PACKET], p[2 * PACKET]) / (PACKETS * PACKET);
                    }
                sum += mean;
                squares += mean * mean;
            }
            const double mean = sum / seeds;
            const struct estimate got = { mean, sqrt((squares / seeds - mean * mean) / (seeds - 1)) };
            if (z_score(got, want) > LIMIT)
                printf("%s, N_s = %u: %.6f +- %.6f, want %.6f\n", method_name(few[k]), n, got.mean, got.error,
                       want.mean);
            assert_true(z_score(got, want) < LIMIT);
            assert_true(got.error < 2.5e-3 * want.mean); /* 1 % stands at 4 standard errors or more */
        }
    direct_destroy(d);
    points_free(&g);
    environment_destroy(e);
}

/* The test's own test: an estimate made 1 % too bright is told apart. */
static void a_planted_bias_of_one_percent_is_caught(void **state)
{
    (void)state;
    struct environment *e = sky_environment(sky_overcast(128, 64), 64, 0.0);
    struct gbuffer honest = points_make(PACKETS, LOBE_LAMBERT, 0.6f, 0.0f, 0.0f);
    struct gbuffer biased = points_make(PACKETS, LOBE_LAMBERT, 0.606f, 0.0f, 0.0f);
    points_scatter(&honest, 21);
    points_scatter(&biased, 21);
    const struct estimate want = measure(e, &honest, METHOD_MIS, 1024);
    for (size_t k = 0; k < 5; k++)
        assert_true(z_score(measure(e, &biased, with_sky[k], 1024), want) > LIMIT);
    points_free(&honest);
    points_free(&biased);
    environment_destroy(e);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(all_methods_agree_under_overcast),
    cmocka_unit_test(light_methods_agree_under_the_sun),
    cmocka_unit_test(fractional_sample_counts_do_not_bias),
    cmocka_unit_test(a_planted_bias_of_one_percent_is_caught),
};
UNIT_MAIN(tests)
