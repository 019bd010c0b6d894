/* The patterns of the sky against the published tables, worked out apart from this code, and against closed forms. */
#include "sky/daylight/pattern.h"
#include "support/unit.h"

#include <math.h>

#define PI 3.14159265358979323846

/* Parameters a to e of Perez et al. 1993 by hand from Table 1 and Eq. 6 to 8, for zenith angles 1.0, 0.8 and 0.7 rad.
 */
static void perez_parameters_are_the_papers(void **state)
{
    static const struct {
        double zenith, clearness, brightness, want[5];
    } cases[] = {
        { 1.0, 1.03, 0.30, { 0.583220, -0.421270, 1.786978, -1.060900, 0.037600 } }, /* overcast: Eq. 7 and 8 */
        { 0.8, 1.70, 0.25, { -1.005180, -0.668480, 13.552020, -3.190555, 0.173740 } },
        { 0.7, 8.00, 0.12, { -0.948494, -0.150498, 20.030224, -5.293334, 1.320290 } }, /* clear */
    };

    (void)state;
    for (size_t k = 0; k < 3; k++) {
        struct sky_pattern p;
        perez_pattern(cases[k].zenith, cases[k].clearness, cases[k].brightness, &p);
        const double have[5] = { p.a, p.b, p.c, p.d, p.e };
        for (int i = 0; i < 5; i++)
            if (fabs(have[i] - cases[k].want[i]) > 2e-6)
                fail_msg("case %zu: parameter %d is %.6f, expected %.6f", k, i, have[i], cases[k].want[i]);
        assert_true(p.base == 1.0);
    }
}

/* All eight categories of clearness, at a zenith angle of 0.9 rad and a brightness of 0.25: worked out apart from this
 * code from Table 1 of [Perez et al. 1993] with its erratum, and from Table 4 of [Perez et al. 1990] at a dew point of
 * 11 degrees. */
static void every_category_is_the_papers(void **state)
{
    static const struct {
        double clearness, want[5];
    } patterns[] = {
        { 1.03, { 0.730175, -0.475762, 1.225766, -0.796466, 0.004115 } },
        { 1.15, { -1.316040, -0.944560, 8.718707, -2.458090, 0.171717 } },
        { 1.40, { -1.099040, -0.745145, 11.363675, -3.239245, 0.107960 } },
        { 1.70, { -1.053928, -0.664927, 13.023972, -3.187740, 0.139957 } },
        { 2.30, { -1.022815, -0.667622, 12.944380, -3.198580, 0.026625 } },
        { 3.50, { -0.777803, -0.395145, 13.012992, -3.412475, 0.260675 } },
        { 5.00, { -0.970563, -0.318577, 14.381335, -3.821640, 0.422715 } },
        { 8.00, { -0.836715, -0.025873, 18.943175, -3.388935, 1.512570 } },
    };
    static const struct {
        double clearness, diffuse, direct; /* lm/W */
    } efficacies[] = {
        { 1.03, 116.129496, 73.876537 }, { 1.15, 115.366878, 93.736472 },  { 1.40, 119.621277, 95.808633 },
        { 1.70, 124.188766, 95.170048 }, { 2.30, 131.381033, 94.817783 },  { 3.50, 131.589872, 96.236170 },
        { 5.00, 132.042242, 97.208662 }, { 8.00, 135.853644, 100.986365 },
    };

    (void)state;
    for (size_t k = 0; k < 8; k++) {
        struct sky_pattern p;
        perez_pattern(0.9, patterns[k].clearness, 0.25, &p);
        const double have[5] = { p.a, p.b, p.c, p.d, p.e };
        for (int i = 0; i < 5; i++)
            if (fabs(have[i] - patterns[k].want[i]) > 2e-6)
                fail_msg("category %zu: parameter %d is %.6f, expected %.6f", k, i, have[i], patterns[k].want[i]);
        const double diffuse = perez_diffuse_efficacy(0.9, efficacies[k].clearness, 0.25, 11.0),
                     direct = perez_direct_efficacy(0.9, efficacies[k].clearness, 0.25, 11.0);
        if (fabs(diffuse - efficacies[k].diffuse) > 2e-6 || fabs(direct - efficacies[k].direct) > 2e-6)
            fail_msg("category %zu: %.6f and %.6f lm/W", k, diffuse, direct);
    }
}

static void clearness_and_brightness_are_the_papers(void **state)
{
    (void)state;
    /* ((100 + 600) / 100 + 1.041 0.7^3) / (1 + 1.041 0.7^3) */
    assert_true(fabs(perez_clearness(0.7, 600.0, 100.0) - 5.421313) < 1e-5);
    assert_true(fabs(perez_clearness(1.2, 0.0, 200.0) - 1.0) < 1e-12);
    /* An air mass of 1.9928 at 60 degrees; 1 January, when the sun is near: 1.0350 of the constant. */
    assert_true(fabs(perez_brightness(PI / 3.0, 100.0, 1) - 100.0 * 1.992764 / (1367.0 * 1.03505)) < 1e-6);
    static const double bounds[8] = { 1.0, 1.065, 1.23, 1.5, 1.95, 2.8, 4.5, 6.2 };
    for (int k = 0; k < 8; k++)
        assert_int_equal(perez_category(bounds[k]), k);
    assert_int_equal(perez_category(40.0), 7);
}

/* Table 4 of Perez et al. 1990 at a dew point of 11 degrees, zenith 0.7 rad, category 8, brightness 0.12. */
static void efficacies_are_the_papers(void **state)
{
    (void)state;
    assert_true(fabs(perez_diffuse_efficacy(0.7, 8.0, 0.12, 11.0) - 135.226595) < 1e-5);
    assert_true(fabs(perez_direct_efficacy(0.7, 8.0, 0.12, 11.0) - 102.941917) < 1e-5);
    assert_true(perez_direct_efficacy(1.55, 1.02, 0.001, 11.0) == 0.0); /* the formula is negative */
}

/* Horizontal illuminance over zenith luminance, by quadrature over the dome. */
static double illuminance(const struct sky_pattern *p, double sun_zenith)
{
    enum { N = 400 };
    double sum = 0.0;

    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) {
            const double z = 0.5 * PI * (i + 0.5) / N, turn = 2.0 * PI * (j + 0.5) / N;
            const double c = cos(z) * cos(sun_zenith) + sin(z) * sin(sun_zenith) * cos(turn);
            sum += pattern_gradation(p, cos(z)) * pattern_indicatrix(p, acos(fmin(1.0, c))) * cos(z) * sin(z);
        }
    const double zenith = pattern_gradation(p, 1.0) * pattern_indicatrix(p, sun_zenith);
    return sum * (0.5 * PI / N) * (2.0 * PI / N) / zenith;
}

/* The standard's skies: closed forms where there are any, and its two normalisations: gradation relative to the zenith,
 * indicatrix 1 at right angles to the sun. */
static void cie_skies_have_the_standards_normalisations(void **state)
{
    struct sky_pattern p;

    (void)state;
    for (int type = 1; type <= 15; type++) {
        cie_pattern(type, &p);
        assert_true(fabs(pattern_indicatrix(&p, 0.5 * PI) - 1.0) < 1e-12);
        assert_true(pattern_gradation(&p, 1.0) > 0.0);
    }
    cie_pattern(5, &p); /* uniform */
    assert_true(fabs(illuminance(&p, 0.7) - PI) < 1e-3);
    cie_pattern(16, &p); /* (1 + 2 cos z) / 3: the zenith is three times as bright as the horizon, E = 7 pi / 9 */
    assert_true(fabs(illuminance(&p, 0.7) - 7.0 * PI / 9.0) < 1e-3);
    assert_true(fabs(pattern_gradation(&p, 1.0) / pattern_gradation(&p, 0.0) - 3.0) < 1e-12);
    cie_pattern(1, &p); /* by the standard nearly the same: the horizon has 1 / (1 + 4 exp(-0.7)) of the zenith */
    assert_true(fabs(pattern_gradation(&p, 1.0) - (1.0 + 4.0 * exp(-0.7))) < 1e-12);
    assert_true(fabs(illuminance(&p, 0.7) / (7.0 * PI / 9.0) - 1.0) < 0.02);
    cie_pattern(12, &p); /* the clear sky: f(0) = 1 + 10 (1 - exp(-3 pi/2)) + 0.45, and brighter towards the horizon */
    assert_true(fabs(pattern_indicatrix(&p, 0.0) - (11.45 - 10.0 * exp(-1.5 * PI))) < 1e-12);
    assert_true(pattern_gradation(&p, 0.1) > 2.0 * pattern_gradation(&p, 1.0));
}

static void patterns_are_finite_and_never_negative(void **state)
{
    (void)state;
    for (int k = 0; k < 2000; k++) {
        const double zenith = 1.57 * (k % 20) / 19.0, clearness = 1.0 + 0.15 * (k / 20 % 100);
        struct sky_pattern p;
        perez_pattern(zenith, clearness, 0.6 * (k % 7) / 6.0, &p);
        for (int i = 0; i <= 20; i++) {
            const double g = pattern_gradation(&p, i / 20.0), f = pattern_indicatrix(&p, PI * i / 20.0);
            assert_true(g >= 0.0 && isfinite(g) && f >= 0.0 && isfinite(f));
        }
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(perez_parameters_are_the_papers),
    cmocka_unit_test(every_category_is_the_papers),
    cmocka_unit_test(clearness_and_brightness_are_the_papers),
    cmocka_unit_test(efficacies_are_the_papers),
    cmocka_unit_test(cie_skies_have_the_standards_normalisations),
    cmocka_unit_test(patterns_are_finite_and_never_negative),
};

UNIT_MAIN(tests)
