#include "unit.h"

#include "sky.h"
#include "sky_model.h"
#include "source.h"
#include "vec.h"

#include <math.h>
#include <omp.h>

#define DEGREE (PI / 180.0)

/* The frames here are small: threads that wait for each other cost more than they bring. */
static struct sky_desc parse(const char *text)
{
    struct sky_desc d;
    struct reason why = { "" };

    omp_set_num_threads(1);
    if (sky_parse(text, &d, &why))
        fail_msg("%s: %s", text, why.text);
    return d;
}

static double luminance(const double rgb[3])
{
    return 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
}

/* Illuminance in lux out of an irradiance in output units. */
static double lux(const struct sky_desc *d, const double irradiance[3])
{
    return luminance(irradiance) * SKY_EFFICACY / d->scale;
}

static float *render(const struct sky_desc *d, const struct sky_state *s)
{
    float *rgb = test_malloc((size_t)3 * d->width * d->height * sizeof(float));

    sky_render(d, s, rgb);
    return rgb;
}

static double texel_solid_angle(const struct sky_desc *d, uint32_t y)
{
    return 2.0 * PI / d->width * (cos(PI * y / d->height) - cos(PI * (y + 1.0) / d->height));
}

static void texel_direction(const struct sky_desc *d, uint32_t x, uint32_t y, double w[3])
{
    const double phi = PI - 2.0 * PI * (x + 0.5) / d->width, theta = PI * (y + 0.5) / d->height;

    w[0] = sin(theta) * sin(phi);
    w[1] = cos(theta);
    w[2] = sin(theta) * cos(phi);
}

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

/* ---- The picture ---- */

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

/* Sum of the disc's energy in the picture, W m^-2 of one channel: picture with it minus picture without. */
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
        { 45.0, 90.0 },  { 45.0, 180.0 },                                   /* column border, and the picture's seam */
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

/* ---- Where the sun stands ---- */

static double elevation_at(const char *spec)
{
    const struct sky_desc d = parse(spec);
    struct sky_state s;

    sky_state_at(&d, 0, &s);
    return s.sun_elevation / DEGREE;
}

static void noon_elevations_are_the_almanacs(void **state)
{
    (void)state;
    assert_true(fabs(elevation_at("latitude=45,date=06-21,hour=12") - (90.0 - 45.0 + 23.44)) < 0.1);
    assert_true(fabs(elevation_at("latitude=45,date=12-21,hour=12") - (90.0 - 45.0 - 23.44)) < 0.1);
    assert_true(fabs(elevation_at("latitude=-33.9,date=12-21,hour=12") - (90.0 - 33.9 + 23.44)) < 0.1);
    assert_true(fabs(elevation_at("latitude=0,date=03-20,hour=12") - 90.0) < 0.6); /* the equinox is in the evening */
    assert_true(fabs(elevation_at("latitude=90,date=06-21,hour=3") - 23.44) < 0.1);
}

/* The centre on the horizon, without refraction: cos(azimuth) = sin(declination) / cos(latitude). At the
 * equinox a day is 0.4 degrees of declination, and its date moves by a day from year to year. */
static void sun_rises_where_the_almanac_says(void **state)
{
    static const struct {
        const char *spec;
        double azimuth, within;
    } known[] = {
        { "latitude=45,date=06-21,hour=3,speed=1", 55.8, 0.5 },
        { "latitude=45,date=12-21,hour=3,speed=1", 124.2, 0.5 },
        { "latitude=60,date=06-21,hour=1,speed=1", 37.3, 0.5 },
        { "latitude=45,date=03-20,hour=3,speed=1", 90.0, 1.2 },
    };

    (void)state;
    for (size_t k = 0; k < sizeof(known) / sizeof(known[0]); k++) {
        const struct sky_desc d = parse(known[k].spec);
        struct sky_state s;
        uint64_t frame = 0;
        do
            sky_state_at(&d, frame++, &s);
        while (s.sun_elevation < 0.0 && frame < 10000);
        const double azimuth = atan2(-s.sun_direction[0], s.sun_direction[2]) / DEGREE; /* north +Z, east -X */
        printf("%s: azimuth %.2f, almanac %.1f\n", known[k].spec, azimuth, known[k].azimuth);
        assert_true(fabs(azimuth - known[k].azimuth) < known[k].within);
    }
}

static void morning_sun_stands_in_the_east(void **state)
{
    struct sky_desc d = parse("hour=8,size=256x128");
    struct sky_state s;
    size_t brightest = 0;

    (void)state;
    sky_state_at(&d, 0, &s);
    assert_true(s.sun_direction[0] < -0.5); /* east is -X */
    float *rgb = render(&d, &s);
    for (size_t i = 0; i < (size_t)d.width * d.height; i++)
        brightest = rgb[3 * i] > rgb[3 * brightest] ? i : brightest;
    test_free(rgb);
    /* Looking north, +Z, at the picture's centre: +X is a quarter to the left, so east is to the right. */
    assert_in_range(brightest % d.width, d.width * 5 / 8, d.width * 7 / 8);
    d.hour = 12.0;
    sky_state_at(&d, 0, &s);
    assert_true(s.sun_direction[2] < 0.0 && fabs(s.sun_direction[0]) < 1e-9); /* south */
    d.latitude_degrees = -45.0;
    sky_state_at(&d, 0, &s);
    assert_true(s.sun_direction[2] > 0.0); /* north, south of the tropics */
    d.hour = 16.0;
    sky_state_at(&d, 0, &s);
    assert_true(s.sun_direction[0] > 0.5); /* west */
}

static void frames_advance_the_sun(void **state)
{
    const struct sky_desc d = parse("hour=10,speed=30"), later = parse("hour=15"), still = parse("hour=10,speed=0");
    struct sky_state a, b;

    (void)state;
    sky_state_at(&d, 10, &a);
    sky_state_at(&later, 0, &b);
    assert_true(fabs(a.sun_elevation - b.sun_elevation) < 1e-9);
    sky_state_at(&d, 48 * 30 + 10, &a); /* the same hour 30 days on: the sun stands lower */
    assert_true(a.sun_elevation < b.sun_elevation - 1.0 * DEGREE && a.sun_elevation > b.sun_elevation - 5.0 * DEGREE);
    sky_state_at(&still, 0, &a);
    sky_state_at(&still, UINT64_MAX, &b);
    assert_true(a.sun_elevation == b.sun_elevation);
}

static void default_morning_has_a_low_sun(void **state)
{
    const double elevation = elevation_at("");

    (void)state;
    assert_true(elevation > 15.0 && elevation < 20.0);
}

/* ---- As a source ---- */

static void source_numbers_the_frames_of_its_range(void **state)
{
    const struct source_desc desc = { .spec = "sky:size=64x32,speed=60", .has_range = true, .first = 3, .last = 5 };
    struct source *s = NULL;
    struct reason why;
    struct frame f = { .kind = FRAME_NONE };

    (void)state;
    assert_int_equal(source_open(&desc, &s, &why), ERR_OK);
    assert_int_equal(source_count(s), 3);
    const struct sky_desc d = parse("size=64x32,speed=60");
    for (uint64_t i = 3; i <= 5; i++) {
        struct sky_state at;
        assert_int_equal(source_next(s, &f, &why), ERR_OK);
        assert_int_equal(f.kind, FRAME_TEXELS);
        assert_int_equal(f.number, i);
        assert_int_equal(f.width, 64);
        sky_state_at(&d, i, &at);
        float *rgb = render(&d, &at);
        assert_memory_equal(rgb, f.rgb, (size_t)3 * 64 * 32 * sizeof(float));
        test_free(rgb);
    }
    assert_int_equal(source_next(s, &f, &why), ERR_END);
    assert_int_equal(source_next(s, &f, &why), ERR_END);
    source_close(s);
    frame_finish(&f);
}

static void source_goes_on_without_a_range(void **state)
{
    struct source *s = NULL;
    struct reason why;
    struct frame f = { .kind = FRAME_NONE };

    (void)state;
    assert_int_equal(source_open(&(struct source_desc){ .spec = "sky:size=16x8" }, &s, &why), ERR_OK);
    assert_int_equal(source_count(s), 0);
    for (uint64_t i = 0; i < 100; i++) {
        assert_int_equal(source_next(s, &f, &why), ERR_OK);
        assert_int_equal(f.number, i);
    }
    source_close(s);
    frame_finish(&f);
    assert_int_equal(source_open(&(struct source_desc){ .spec = "sky:haze=3" }, &s, &why), ERR_USAGE);
    assert_null(s);
}

/* ---- Keys ---- */

static void parse_reads_every_key(void **state)
{
    const struct sky_desc d =
        parse("latitude=-12.5,longitude=100,date=2024-02-29,time=18:30,speed=2,turbidity=4,ground=0.5,"
              "sun_ratio=7,night=0.1,scale=2,size=64x32");
    const struct sky_desc plain = parse(""), late = parse("hour=24");

    (void)state;
    assert_true(d.latitude_degrees == -12.5 && d.longitude_degrees == 100.0 && d.month == 2 && d.day == 29);
    assert_true(d.hour == 18.5 && fabs(d.speed_hours - 2.0 / 60.0) < 1e-15 && d.turbidity == 4.0);
    assert_true(d.ground_albedo == 0.5 && d.sun_ratio == 7.0 && d.night_lux == 0.1 && d.scale == 2.0);
    assert_true(d.width == 64 && d.height == 32);
    assert_true(plain.latitude_degrees == 45.0 && plain.month == 6 && plain.day == 21 && plain.width == 1024);
    assert_true(late.hour == 24.0);
}

/* 13:00 UTC at 15 degrees east is 14:00 mean time; on 3 November the sun is 16.4 minutes ahead of it. */
static void utc_becomes_solar_time(void **state)
{
    const struct sky_desc d = parse("utc=13:00,date=11-03,longitude=15"), behind = parse("utc=01:00,longitude=-30");

    (void)state;
    assert_true(fabs(d.hour - (14.0 + 16.4 / 60.0)) < 1.0 / 60.0);
    assert_true(fabs(behind.hour - (23.0 - 1.8 / 60.0)) < 1.0 / 60.0); /* 21 June: 1.8 minutes behind; a day earlier */
}

static void parse_errors_name_the_key(void **state)
{
    static const struct {
        const char *text, *named;
    } bad[] = {
        { "haze=3", "'haze'" },
        { "turbidity", "'turbidity' has no value" },
        { "turbidity=", "turbidity=" },
        { "turbidity=1", "turbidity=1 is not a number from 1.7 to 10" },
        { "turbidity=11", "turbidity=11" },
        { "turbidity=nan", "turbidity=nan" },
        { "turbidity=3x", "turbidity=3x" },
        { "latitude=90.1", "latitude=90.1" },
        { "longitude=-181", "longitude=-181" },
        { "hour=25", "hour=25" },
        { "time=24:01", "time=24:01" },
        { "time=7", "time=7" },
        { "utc=07:60", "utc=07:60" },
        { "speed=-1", "speed=-1" },
        { "date=13-01", "date=13-01" },
        { "date=02-30", "date=02-30" },
        { "date=00-10", "date=00-10" },
        { "date=today", "date=today" },
        { "date=2024-6-21", "date=2024-6-21" },
        { "ground=1.5", "ground=1.5" },
        { "sun_ratio=-1", "sun_ratio=-1" },
        { "night=-1", "night=-1" },
        { "scale=0", "scale=0" },
        { "size=100x100", "size=100x100" },
        { "size=6x3", "size=6x3" },
        { "size=32768x16384", "size=32768x16384" },
        { "size=0x0", "size=0x0" },
        { "size=1024", "size=1024" },
        { "latitude=45,,hour=3", "'' has no value" },
    };

    (void)state;
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        struct sky_desc d;
        struct reason why = { "" };
        assert_int_equal(sky_parse(bad[i].text, &d, &why), ERR_USAGE);
        if (!strstr(why.text, bad[i].named))
            fail_msg("%s: '%s' does not name %s", bad[i].text, why.text, bad[i].named);
    }
    char endless[400];
    struct sky_desc d;
    struct reason why;
    memset(endless, 'a', sizeof(endless));
    endless[sizeof(endless) - 1] = '\0';
    assert_int_equal(sky_parse(endless, &d, &why), ERR_USAGE);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(sky_is_finite_and_not_negative_at_every_tenth_of_a_degree),
    cmocka_unit_test(nothing_jumps_between_tenths_of_a_degree),
    cmocka_unit_test(planted_jump_is_caught),
    cmocka_unit_test(finer_steps_are_smaller),
    cmocka_unit_test(share_of_the_sky_in_a_clear_day_is_plausible),
    cmocka_unit_test(level_follows_the_published_illuminances),
    cmocka_unit_test(night_has_the_illuminance_asked_for),
    cmocka_unit_test(default_noon_fits_a_half_float),
    cmocka_unit_test(sun_ratio_sets_the_disc_over_the_skys_mean),
    cmocka_unit_test(ground_is_lit_by_sky_and_sun),
    cmocka_unit_test(irradiance_of_the_disc_is_radiance_times_cosine),
    cmocka_unit_test(render_agrees_with_the_exact_radiance),
    cmocka_unit_test(render_is_the_same_at_any_number_of_threads),
    cmocka_unit_test(disc_arrives_whole_wherever_it_stands),
    cmocka_unit_test(disc_below_the_horizon_sends_nothing),
    cmocka_unit_test(disc_covers_texels_by_their_share),
    cmocka_unit_test(disc_moves_without_steps),
    cmocka_unit_test(noon_elevations_are_the_almanacs),
    cmocka_unit_test(sun_rises_where_the_almanac_says),
    cmocka_unit_test(morning_sun_stands_in_the_east),
    cmocka_unit_test(frames_advance_the_sun),
    cmocka_unit_test(default_morning_has_a_low_sun),
    cmocka_unit_test(source_numbers_the_frames_of_its_range),
    cmocka_unit_test(source_goes_on_without_a_range),
    cmocka_unit_test(parse_reads_every_key),
    cmocka_unit_test(utc_becomes_solar_time),
    cmocka_unit_test(parse_errors_name_the_key),
};

UNIT_MAIN(tests)
