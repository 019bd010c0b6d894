#include "sky/daylight/sky_pictures.h"

/* ---- The image ---- */

static void render_agrees_with_the_exact_radiance(void **state)
{
    static const double elevations[] = { 75.0, 20.0, 1.0, -4.0, -10.0, -60.0 };
    static const char *const specs[] = { "size=256x128", "size=256x128,turbidity=2", "size=256x128,turbidity=8" };

    (void)state;
    for (size_t k = 0; k < 18; k++) {
        const struct sky_desc d = parse(specs[k / 6]);
        struct sky_state s;
        sky_state_for_sun(&d, elevations[k % 6] * DEGREE, 2.5, &s);
        s.sun_visible = 0.0; /* the sky alone */
        float *rgb = render(&d, &s);
        for (uint32_t y = 0; y < d.height; y++) {
            for (uint32_t x = 0; x < d.width; x++) {
                double w[3], want[3];
                texel_direction(&d, x, y, w);
                sky_radiance(&s, w, want);
                /* The formula has a cusp opposite the sun, which the tables round off. */
                const double *sun = s.sun_direction, cosine = w[0] * sun[0] + w[1] * sun[1] + w[2] * sun[2];
                const double within = cosine < -0.98 ? 1e-3 : 5e-5;
                for (int c = 0; c < 3; c++) {
                    const double have = (double)rgb[3 * ((size_t)y * d.width + x) + c];
                    assert_true(fabs(have - want[c]) <= within * luminance(want));
                }
            }
        }
        test_free(rgb);
    }
}

static void render_is_the_same_at_any_number_of_threads(void **state)
{
    const struct sky_desc d = parse("size=512x256");
    const size_t bytes = (size_t)3 * d.width * d.height * sizeof(float);
    struct sky_state s;

    (void)state;
    sky_state_at(&d, 100, &s);
    omp_set_num_threads(1);
    float *one = render(&d, &s);
    for (int threads = 2; threads <= 5; threads++) {
        omp_set_num_threads(threads);
        float *more = render(&d, &s);
        assert_memory_equal(one, more, bytes);
        test_free(more);
    }
    test_free(one);
}

/* ---- The sun ---- */

/* Sum of the disc's energy in the image, W m^-2 of one channel: image with it minus image without. */
static double disc_energy(const struct sky_desc *d, const struct sky_state *s, int channel, double *shares)
{
    struct sky_state without = *s;
    double sum = 0.0;

    without.sun_visible = 0.0;
    float *with = render(d, s), *rest = render(d, &without);
    for (uint32_t y = 0; y < d->height; y++) {
        for (uint32_t x = 0; x < d->width; x++) {
            const size_t i = (size_t)y * d->width + x;
            const double e = ((double)with[3 * i + channel] - (double)rest[3 * i + channel]) * texel_solid_angle(d, y);
            assert_true(e >= 0.0);
            sum += e;
            if (shares)
                shares[i] = e;
        }
    }
    test_free(with);
    test_free(rest);
    return sum;
}

static void disc_arrives_whole_wherever_it_stands(void **state)
{
    static const struct {
        double elevation, azimuth;
    } at[] = {
        { 45.0, 90.0 },  { 45.0, 180.0 },                                   /* column border, and the image's seam */
        { 45.0, 179.9 }, { 45.0, -179.9 },  { 45.0, 0.0 },   { 90.0, 0.0 }, /* the pole */
        { 89.9, 30.0 },  { 89.7335, 30.0 }, { 89.5, 200.0 }, { 33.3, 12.3 },   { 0.3, 77.0 },
        { 0.2, 77.0 },   { 0.0, 77.0 },     { -0.2, 180.0 }, { 5.625, 5.625 }, /* a corner of 64x32 */
    };
    static const char *const specs[] = { "size=64x32,sun_ratio=1e6", "size=500x250,sun_ratio=1e6",
                                         "size=2048x1024,sun_ratio=1e6" };

    (void)state;
    for (size_t k = 0; k < 3; k++) {
        const struct sky_desc d = parse(specs[k]);
        for (size_t i = 0; i < sizeof(at) / sizeof(at[0]); i++) {
            struct sky_state s;
            sky_state_for_sun(&d, at[i].elevation * DEGREE, at[i].azimuth * DEGREE, &s);
            const double want = s.sun_radiance[0] * s.sun_solid_angle * s.sun_visible;
            const double have = disc_energy(&d, &s, 0, NULL);
            assert_true(want > 0.0);
            assert_true(fabs(have - want) <= 1e-6 * want);
        }
    }
}

static void disc_below_the_horizon_sends_nothing(void **state)
{
    const struct sky_desc d = parse("size=256x128");
    struct sky_state s;

    (void)state;
    sky_state_for_sun(&d, -0.267 * DEGREE, 1.0, &s);
    assert_true(s.sun_visible == 0.0);
    assert_true(disc_energy(&d, &s, 0, NULL) == 0.0);
    sky_state_for_sun(&d, 0.0, 1.0, &s);
    assert_true(fabs(s.sun_visible - 0.5) < 1e-9); /* half of it stands above */
    sky_state_for_sun(&d, 0.267 * DEGREE, 1.0, &s);
    assert_true(s.sun_visible == 1.0);
}

/* By a dense set of directions in the disc, each put where it falls. */
static void disc_covers_texels_by_their_share(void **state)
{
    static const double at[][2] = { { 45.0, 90.0 }, { 45.1, 90.1 }, { 20.33, 10.0 }, { 89.9, 70.0 }, { 0.1, 179.95 } };
    const struct sky_desc d = parse("size=1024x512,sun_ratio=1e6");
    const size_t count = (size_t)d.width * d.height;
    double *have = test_malloc(count * sizeof(double)), *want = test_malloc(count * sizeof(double));

    (void)state;
    for (size_t k = 0; k < sizeof(at) / sizeof(at[0]); k++) {
        struct sky_state s;
        double sum = 0.0;
        sky_state_for_sun(&d, at[k][0] * DEGREE, at[k][1] * DEGREE, &s);
        const double all = disc_energy(&d, &s, 1, have);
        const double az = at[k][1] * DEGREE, el = at[k][0] * DEGREE;
        const double right[3] = { -cos(az), 0.0, -sin(az) };
        const double up[3] = { sin(az) * sin(el), cos(el), -cos(az) * sin(el) };
        memset(want, 0, count * sizeof(double));
        for (int i = 0; i < 700; i++) {
            for (int j = 0; j < 700; j++) { /* equal areas of the disc, flat to 1e-5 */
                const double r = tan(SKY_SUN_RADIUS) * sqrt((i + 0.5) / 700.0), a = 2.0 * PI * (j + 0.5) / 700.0;
                double w[3];
                for (int c = 0; c < 3; c++)
                    w[c] = s.sun_direction[c] + r * (cos(a) * right[c] + sin(a) * up[c]);
                if (w[1] < 0.0)
                    continue;
                const double theta = atan2(sqrt(w[0] * w[0] + w[2] * w[2]), w[1]), phi = atan2(w[0], w[2]);
                const uint32_t x = (uint32_t)((PI - phi) / (2.0 * PI) * d.width) % d.width;
                want[(size_t)(uint32_t)(theta / PI * d.height) * d.width + x] += 1.0;
                sum += 1.0;
            }
        }
        for (size_t i = 0; i < count; i++)
            assert_true(fabs(have[i] / all - want[i] / sum) < 2e-3);
    }
    test_free(have);
    test_free(want);
}

/* A disc of diameter 0.533 that moves by 0.002 degrees uncovers 0.48 % of its area at most. */
static void disc_moves_without_steps(void **state)
{
    const struct sky_desc d = parse("size=128x64,sun_ratio=1e6");
    const size_t count = (size_t)d.width * d.height;
    double *now = test_malloc(count * sizeof(double)), *before = test_malloc(count * sizeof(double));
    double most = 0.0;

    (void)state;
    for (int k = 0; k < 2; k++) { /* across a column's border, then a row's: texels are 2.8 degrees wide */
        for (int i = 0; i < 250; i++) {
            struct sky_state s;
            const double t = -0.25 + 0.002 * i, el = k ? 28.125 + t : 30.0,
                         az = k ? 100.0 : 28.125 + t / cos(30.0 * DEGREE);
            sky_state_for_sun(&d, el * DEGREE, az * DEGREE, &s);
            const double all = disc_energy(&d, &s, 1, now);
            for (size_t j = 0; j < count; j++) {
                now[j] /= all;
                if (i > 0)
                    most = fmax(most, fabs(now[j] - before[j]));
            }
            memcpy(before, now, count * sizeof(double));
        }
    }
    printf("largest change of a texel's share: %.5f\n", most);
    assert_true(most < 0.0052 && most > 0.0040);
    test_free(now);
    test_free(before);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(render_agrees_with_the_exact_radiance),
    cmocka_unit_test(render_is_the_same_at_any_number_of_threads),
    cmocka_unit_test(disc_arrives_whole_wherever_it_stands),
    cmocka_unit_test(disc_below_the_horizon_sends_nothing),
    cmocka_unit_test(disc_covers_texels_by_their_share),
    cmocka_unit_test(disc_moves_without_steps),
};

UNIT_MAIN(tests)
