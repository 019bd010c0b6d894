#include "sky/daylight/sky_pictures.h"

/* ---- Every 0.1 degree of elevation ---- */

#define STEPS 1801 /* -90 to 90 degrees */
#define WATCHED 7

/* What is watched for jumps: luminances that must not leap. */
static void watched_values(const struct sky_state *s, double out[WATCHED])
{
    static const double w[4][3] = { { 0, 1, 0 }, { 0, 0, 1 }, { 1, 0, 0 }, { 0, 0, -1 } }; /* the sun stands north */
    double rgb[3], total[3];

    for (int c = 0; c < 3; c++)
        total[c] = s->sky_irradiance[c] + s->sun_irradiance[c];
    out[0] = luminance(s->sky_irradiance);
    out[1] = luminance(total);
    out[2] = luminance(s->dome.ground);
    for (int i = 0; i < 4; i++) {
        sky_radiance(s, w[i], rgb);
        out[3 + i] = luminance(rgb);
    }
}

/* The largest step between neighbours, over the larger of the two. */
static double largest_step(double (*values)[WATCHED])
{
    double most = 0.0;

    for (int i = 1; i < STEPS; i++) {
        for (int k = 0; k < WATCHED; k++) {
            const double a = values[i - 1][k], b = values[i][k], step = fabs(a - b) / fmax(a, b);
            most = step > most ? step : most;
        }
    }
    return most;
}

static void sweep(const struct sky_desc *d, double (*values)[WATCHED])
{
    for (int i = 0; i < STEPS; i++) {
        struct sky_state s;
        sky_state_for_sun(d, (i - 900) * 0.1 * DEGREE, 0.0, &s);
        watched_values(&s, values[i]);
    }
}

static void check_values(const double *v, int count)
{
    for (int i = 0; i < count; i++)
        assert_true(isfinite(v[i]) && v[i] >= 0.0);
}

/* At night there is light, too: nothing that is looked at is 0. */
static void sky_is_finite_and_not_negative_at_every_tenth_of_a_degree(void **state)
{
    static const char *const specs[] = { "turbidity=1.7,night=0", "turbidity=3", "turbidity=10,sun_ratio=100000" };

    (void)state;
    for (size_t k = 0; k < sizeof(specs) / sizeof(specs[0]); k++) {
        const struct sky_desc d = parse(specs[k]);
        for (int i = 0; i < STEPS; i++) {
            struct sky_state s;
            sky_state_for_sun(&d, (i - 900) * 0.1 * DEGREE, 1.0, &s);
            check_values(s.sun_radiance, 3);
            check_values(s.sun_irradiance, 3);
            check_values(s.sky_irradiance, 3);
            check_values(s.sky_mean, 3);
            check_values(s.dome.ground, 3);
            assert_true(s.sun_visible >= 0.0 && s.sun_visible <= 1.0);
            for (int j = 0; j < 64; j++) { /* a spiral from the zenith to the horizon, then the sun itself */
                const double up = 1.0 - j / 63.0, out = sqrt(1.0 - up * up);
                const double w[3] = { out * sin(2.4 * j), up, out * cos(2.4 * j) };
                double rgb[3];
                sky_radiance(&s, w, rgb);
                check_values(rgb, 3);
                assert_true(luminance(rgb) > 0.0);
                if (j == 0 && s.sun_direction[1] >= 0.0) {
                    sky_radiance(&s, s.sun_direction, rgb);
                    check_values(rgb, 3);
                }
            }
        }
    }
}

/* The steepest place of the twilight law is 12 % per 0.1 degree; the sun that rises adds less than that. */
#define STEP_BOUND 0.13

static void nothing_jumps_between_tenths_of_a_degree(void **state)
{
    static const char *const specs[] = { "turbidity=1.7", "turbidity=3", "turbidity=10", "sun_ratio=100000" };
    static double values[STEPS][WATCHED];

    (void)state;
    for (size_t k = 0; k < sizeof(specs) / sizeof(specs[0]); k++) {
        const struct sky_desc d = parse(specs[k]);
        sweep(&d, values);
        const double most = largest_step(values);
        printf("%s: largest step %.4f\n", specs[k], most);
        assert_true(most < STEP_BOUND);
    }
}

static void planted_jump_is_caught(void **state)
{
    static double values[STEPS][WATCHED];
    const struct sky_desc d = parse("");

    (void)state;
    sweep(&d, values);
    for (int i = 901; i < STEPS; i++)
        values[i][3] *= 1.0 + 2.0 * STEP_BOUND;
    assert_true(largest_step(values) > STEP_BOUND);
}

/* Between 0.1-degree steps as between finer ones: a jump would stay as high, a slope shrinks with the step. */
static void finer_steps_are_smaller(void **state)
{
    static const double joints[] = {
        -18.0, -12.0, -9.0, -6.0, -5.0, -2.0, -0.8, -0.2665, 0.0, 0.2665, 5.0, 20.0, 90.0
    };
    const struct sky_desc d = parse("");

    (void)state;
    for (size_t k = 0; k < sizeof(joints) / sizeof(joints[0]); k++) {
        struct sky_state below, above;
        double a[WATCHED], b[WATCHED];
        sky_state_for_sun(&d, (joints[k] - 1e-6) * DEGREE, 0.0, &below);
        sky_state_for_sun(&d, fmin(joints[k] + 1e-6, 90.0) * DEGREE, 0.0, &above);
        watched_values(&below, a);
        watched_values(&above, b);
        for (int i = 0; i < WATCHED; i++)
            assert_true(fabs(a[i] - b[i]) <= 1e-5 * a[i]);
    }
}

/* Follows, in each tenth of a degree, the half that changes more, down to 1e-7 degrees: even a small jump is found,
 * wherever it is. */
static void illuminance_has_no_small_jumps(void **state)
{
    (void)state;
    for (double t = 1.7; t <= 10.0; t += 8.3 / 4) {
        for (int i = -900; i < 900; i++) {
            double low = 0.1 * i * DEGREE, high = 0.1 * (i + 1) * DEGREE;
            double a = sky_illuminance(low, t), b = sky_illuminance(high, t);
            for (int k = 0; k < 20; k++) {
                const double middle = 0.5 * (low + high), m = sky_illuminance(middle, t);
                if (fabs(m - a) > fabs(b - m)) {
                    high = middle;
                    b = m;
                } else {
                    low = middle;
                    a = m;
                }
            }
            assert_true(fabs(a - b) < 1e-6 * a);
        }
    }
}

/* ---- Its level ---- */

static void share_of_the_sky_in_a_clear_day_is_plausible(void **state)
{
    const struct sky_desc d = parse("turbidity=3");
    struct sky_state s;

    (void)state;
    sky_state_for_sun(&d, 60.0 * DEGREE, 0.0, &s);
    const double sky = lux(&d, s.sky_irradiance), sun = lux(&d, s.sun_irradiance);
    printf("sky %.0f lx, sun %.0f lx, share of the sky %.3f\n", sky, sun, sky / (sky + sun));
    assert_true(sky / (sky + sun) > 0.10 && sky / (sky + sun) < 0.25);
    assert_true(sky + sun > 80e3 && sky + sun < 115e3);
    double before = 0.0; /* haze takes from the sun and gives to the sky */
    for (double t = 1.7; t < 10.0; t += 0.5) {
        struct sky_desc hazy = d;
        hazy.turbidity = t;
        sky_state_for_sun(&hazy, 60.0 * DEGREE, 0.0, &s);
        const double share = lux(&d, s.sky_irradiance) / (lux(&d, s.sky_irradiance) + lux(&d, s.sun_irradiance));
        assert_true(share > before);
        before = share;
    }
}

/* [Janiczek and DeYoung 1987]: sun and sky together, by day within 25 % (their air is no turbidity of ours), in
 * twilight, where it is our law, to 2 %. */
static void level_follows_the_published_illuminances(void **state)
{
    static const struct {
        double degrees, lux, within;
    } known[] = {
        { 90.0, 128.8e3, 0.25 }, { 60.0, 103e3, 0.25 }, { 30.0, 46.3e3, 0.25 },  { 10.0, 10.7e3, 0.25 },
        { 0.0, 759.0, 0.02 },    { -6.0, 3.41, 0.02 },  { -12.0, 0.0081, 0.02 }, { -18.0, 6.5e-4, 0.02 },
    };
    const struct sky_desc d = parse("turbidity=3,night=0");

    (void)state;
    for (size_t i = 0; i < sizeof(known) / sizeof(known[0]); i++) {
        struct sky_state s;
        sky_state_for_sun(&d, known[i].degrees * DEGREE, 0.0, &s);
        const double have = lux(&d, s.sky_irradiance) + lux(&d, s.sun_irradiance);
        printf("%5.1f degrees: %.4g lx, published %.4g lx\n", known[i].degrees, have, known[i].lux);
        assert_true(fabs(have / known[i].lux - 1.0) < known[i].within);
    }
}

static void night_has_the_illuminance_asked_for(void **state)
{
    const struct sky_desc d = parse("night=0.25"), none = parse("night=0");
    struct sky_state s, dark;

    (void)state;
    sky_state_for_sun(&d, -40.0 * DEGREE, 0.0, &s);
    sky_state_for_sun(&none, -40.0 * DEGREE, 0.0, &dark);
    assert_true(fabs(lux(&d, s.sky_irradiance) - lux(&d, dark.sky_irradiance) - 0.25) < 1e-3 * 0.25);
}

static void default_noon_fits_a_half_float(void **state)
{
    (void)state;
    for (double t = 1.7; t <= 10.0; t += 0.83) {
        struct sky_desc d = parse("size=2048x1024"); /* fine enough for texels wholly inside the disc */
        struct sky_state s;
        double most = 0.0;
        d.turbidity = t;
        sky_state_for_sun(&d, 80.0 * DEGREE, PI, &s);
        float *rgb = render(&d, &s);
        for (size_t i = 0; i < (size_t)3 * d.width * d.height / 4; i++)
            most = fmax(most, (double)rgb[i]);
        test_free(rgb);
        printf("turbidity %.2f: brightest %.0f, mean of the sky %.3f\n", t, most, luminance(s.sky_mean));
        assert_true(most < 65504.0 && most > 0.9 * s.sun_radiance[0]);
        assert_true(luminance(s.sky_mean) > 0.05 && luminance(s.sky_mean) < 1.0);
    }
}

static void sun_ratio_sets_the_disc_over_the_skys_mean(void **state)
{
    (void)state;
    for (double elevation = 1.0; elevation < 90.0; elevation += 11.0) {
        const struct sky_desc d = parse("sun_ratio=5000,size=512x256");
        struct sky_state s;
        double mean[3] = { 0.0 };
        sky_state_for_sun(&d, elevation * DEGREE, 2.0, &s);
        assert_true(fabs(luminance(s.sun_radiance) / luminance(s.sky_mean) / 5000.0 - 1.0) < 1e-9);
        s.sun_visible = 0.0; /* the sky alone */
        float *rgb = render(&d, &s);
        for (uint32_t y = 0; y < d.height / 2; y++)
            for (uint32_t x = 0; x < d.width; x++)
                for (int c = 0; c < 3; c++)
                    mean[c] += texel_solid_angle(&d, y) / (2.0 * PI) * (double)rgb[3 * ((size_t)y * d.width + x) + c];
        test_free(rgb);
        assert_true(fabs(luminance(mean) / luminance(s.sky_mean) - 1.0) < 0.005);
    }
}

static void ground_is_lit_by_sky_and_sun(void **state)
{
    (void)state;
    for (double elevation = -8.0; elevation < 90.0; elevation += 7.0) {
        const struct sky_desc d = parse("ground=0.3,size=512x256");
        struct sky_state s;
        double lit[3] = { 0.0 };
        sky_state_for_sun(&d, elevation * DEGREE, 0.7, &s);
        float *rgb = render(&d, &s);
        for (uint32_t y = 0; y < d.height / 2; y++)
            for (uint32_t x = 0; x < d.width; x++)
                for (int c = 0; c < 3; c++)
                    lit[c] += texel_solid_angle(&d, y) * cos(PI * (y + 0.5) / d.height) *
                              (double)rgb[3 * ((size_t)y * d.width + x) + c];
        const float *ground = rgb + (size_t)3 * (d.height - 1) * d.width;
        for (int c = 0; c < 3; c++) {
            /* Low suns lie in one row, whose centre is not theirs: compare with the disc's own sum. */
            const double want = 0.3 / PI * (elevation > 20.0 ? lit[c] : s.sky_irradiance[c] + s.sun_irradiance[c]);
            assert_true(fabs((double)ground[c] - want) <= 0.01 * want);
        }
        for (size_t i = 0; i < (size_t)d.height / 2 * d.width; i++) /* uniform */
            assert_memory_equal(rgb + 3 * ((size_t)d.height / 2 * d.width + i), ground, 3 * sizeof(float));
        test_free(rgb);
    }
}

static void irradiance_of_the_disc_is_radiance_times_cosine(void **state)
{
    const struct sky_desc d = parse("");

    (void)state;
    for (double elevation = 0.3; elevation < 90.0; elevation += 0.7) {
        struct sky_state s;
        sky_state_for_sun(&d, elevation * DEGREE, 0.0, &s);
        for (int c = 0; c < 3; c++) {
            const double want = s.sun_radiance[c] * s.sun_solid_angle * sin(elevation * DEGREE);
            assert_true(fabs(s.sun_irradiance[c] - want) <= 1e-4 * want);
        }
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(sky_is_finite_and_not_negative_at_every_tenth_of_a_degree),
    cmocka_unit_test(nothing_jumps_between_tenths_of_a_degree),
    cmocka_unit_test(planted_jump_is_caught),
    cmocka_unit_test(finer_steps_are_smaller),
    cmocka_unit_test(illuminance_has_no_small_jumps),
    cmocka_unit_test(share_of_the_sky_in_a_clear_day_is_plausible),
    cmocka_unit_test(level_follows_the_published_illuminances),
    cmocka_unit_test(night_has_the_illuminance_asked_for),
    cmocka_unit_test(default_noon_fits_a_half_float),
    cmocka_unit_test(sun_ratio_sets_the_disc_over_the_skys_mean),
    cmocka_unit_test(ground_is_lit_by_sky_and_sun),
    cmocka_unit_test(irradiance_of_the_disc_is_radiance_times_cosine),
};

UNIT_MAIN(tests)
