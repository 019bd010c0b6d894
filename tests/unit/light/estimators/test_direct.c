/* Direct light against closed forms: furnace, one-texel skies, black skies, determinism. */
#include "light/estimators/points.h"

#include <omp.h>

static const enum method all_methods[] = { METHOD_UNIFORM,       METHOD_BRDF,  METHOD_LIGHT,
                                           METHOD_FACES_UNIFORM, METHOD_FACES, METHOD_MIS };
#define METHODS (sizeof(all_methods) / sizeof(all_methods[0]))

/* Lambert points of albedo 1 that see only a sky of 1 are 1. The points share their samples, so the mean over seeds is
 * what is tested: 64 seeds of 256 samples, |z| < 4.5 for each of six methods; the standard error is below 0.1 %, so a
 * factor off by 1 % is at least 10 standard errors away. */
static void a_white_furnace_is_white_at_every_method(void **state)
{
    enum { SEEDS = 64, PACKETS = 8 };
    static float lo[PACKETS * 3 * PACKET];
    (void)state;
    struct environment *e = sky_environment(sky_constant(32, 16, 1.0f), 16, 0.0);
    struct gbuffer g = points_make(PACKETS, LOBE_LAMBERT, 1.0f, 0.0f, 0.0f);
    struct direct *d = direct_create(best_kernels());
    points_scatter(&g, 11);
    for (size_t m = 0; m < METHODS; m++) {
        double sum = 0.0, squares = 0.0;
        for (uint64_t seed = 0; seed < SEEDS; seed++) {
            double mean = 0.0;
            shade(d, &g, e, all_methods[m], 256, seed, lo);
            for (size_t k = 0; k < PACKETS * 3 * PACKET; k++)
                mean += lo[k] / (PACKETS * 3 * PACKET);
            sum += mean;
            squares += mean * mean;
        }
        const double mean = sum / SEEDS;
        const double error = sqrt(fmax(0.0, squares / SEEDS - mean * mean) / (SEEDS - 1)) + 2e-6;
        printf("%s: mean %.6f, standard error %.2e\n", method_name(all_methods[m]), mean, error);
        assert_true(fabs(mean - 1.0) / error < 4.5);
        assert_true(error < 1e-3);
    }
    direct_destroy(d);
    points_free(&g);
    environment_destroy(e);
}

/* Irradiance from a patch of radiance 1 between unit vectors a polygon's corners point to [Lambert 1760]: half the sum
 * over the edges of angle times the cosine of the edge's plane. The patch must lie above the horizon. */
static double polygon_irradiance(const double corner[4][3], const double n[3])
{
    double sum = 0.0;
    for (int k = 0; k < 4; k++) {
        const double *a = corner[k], *b = corner[(k + 1) % 4];
        const double cross[3] = { a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0] };
        const double l = sqrt(cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2]);
        const double dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        sum += atan2(l, dot) * (cross[0] * n[0] + cross[1] * n[1] + cross[2] * n[2]) / l;
    }
    return fabs(0.5 * sum);
}

/* Irradiance on a plane with normal +Y of the cube map itself, texel by texel above the horizon. n must be even, so
 * that no texel straddles it. */
static double cube_irradiance(const struct environment *e)
{
    static const double up[3] = { 0, 1, 0 };
    const uint32_t n = e->n;
    double sum = 0.0;
    for (uint32_t t = 0; t < 6 * n * n; t++) {
        const uint32_t face = t / (n * n), i = t / n % n, j = t % n;
        double corner[4][3], middle[3];
        if (e->texels[t].r <= 0.0f)
            continue;
        cube_direction(face, -1.0 + (2.0 * j + 1.0) / n, -1.0 + (2.0 * i + 1.0) / n, middle);
        if (middle[1] <= 0.0)
            continue;
        for (int k = 0; k < 4; k++) {
            cube_direction(face, -1.0 + 2.0 * (j + (k == 1 || k == 2)) / n, -1.0 + 2.0 * (i + (k >> 1)) / n, corner[k]);
            const double l =
                sqrt(corner[k][0] * corner[k][0] + corner[k][1] * corner[k][1] + corner[k][2] * corner[k][2]);
            for (int c = 0; c < 3; c++)
                corner[k][c] /= l;
        }
        sum += e->texels[t].r * polygon_irradiance(corner, up);
    }
    return sum;
}

/* One lat-long texel is lit: at face centres, edges, corners and the poles. An open plane with normal +Y then receives,
 * for a texel between polar angles a and b, L dphi (sin^2 b - sin^2 a) / 2 as far as it lies above the horizon.
 * Resampling moves energy by up to a cube texel, which changes its cosine: so the estimators are held to the cube map's
 * own irradiance
 * (|z| < 4.5 over 48 seeds, standard error below 1 %), and that to the lat-long's closed form within what a shift by
 * half a cube texel can do. */
static void a_one_texel_sky_gives_closed_form_irradiance(void **state)
{
    enum { WIDTH = 32, HEIGHT = 16, N = 32, SEEDS = 48 };
    static const uint32_t places[][2] = {
        { 16, 7 }, { 8, 7 },  { 0, 7 },  { 24, 7 }, { 31, 7 }, /* face centres about the horizon, and the seam */
        { 20, 7 }, { 12, 7 }, { 4, 5 },                        /* edges */
        { 20, 4 }, { 12, 4 }, { 3, 4 },  { 27, 5 },            /* corners: elevation 35 degrees */
        { 0, 0 },  { 17, 0 }, { 5, 15 }, { 9, 9 },             /* poles, below the horizon */
    };
    static const enum method by_light[] = { METHOD_LIGHT, METHOD_FACES_UNIFORM, METHOD_FACES, METHOD_MIS };
    static float lo[3 * PACKET];
    (void)state;
    struct gbuffer g = points_make(1, LOBE_LAMBERT, 1.0f, 0.0f, 0.0f);
    struct direct *d = direct_create(best_kernels());
    for (size_t q = 0; q < sizeof(places) / sizeof(places[0]); q++) {
        struct frame f = sky_constant(WIDTH, HEIGHT, 0.0f);
        sky_paint(&f, places[q][0], places[q][1], 100.0f, 100.0f, 100.0f);
        struct environment *e = sky_environment(f, N, 0.0);
        const double a = PI * places[q][1] / HEIGHT, b = fmin(PI * (places[q][1] + 1) / HEIGHT, 0.5 * PI);
        const double closed = b > a ? 100.0 * 2.0 * PI / WIDTH * (sin(b) * sin(b) - sin(a) * sin(a)) / 2.0 : 0.0;
        const double want = cube_irradiance(e);
        assert_true(fabs(want - closed) <= 0.03 * closed + 100.0 * 2.0 * PI / WIDTH * 0.002);
        for (size_t m = 0; m < sizeof(by_light) / sizeof(by_light[0]); m++) {
            double sum = 0.0, squares = 0.0;
            for (uint64_t seed = 0; seed < SEEDS; seed++) {
                shade(d, &g, e, by_light[m], 128, seed, lo);
                const double irradiance = PI * lo[0];
                sum += irradiance;
                squares += irradiance * irradiance;
            }
            const double mean = sum / SEEDS, variance = fmax(0.0, squares / SEEDS - mean * mean);
            const double error = sqrt(variance / (SEEDS - 1)) + 1e-5 * want;
            if (!(fabs(mean - want) <= 4.5 * error && error <= 0.01 * want + 1e-9))
                printf("%s, texel %u,%u: %.5f +- %.5f, closed form %.5f\n", method_name(by_light[m]), places[q][0],
                       places[q][1], mean, error, want);
            assert_true(fabs(mean - want) <= 4.5 * error);
            assert_true(error <= 0.01 * want + 1e-9);
        }
        environment_destroy(e);
    }
    direct_destroy(d);
    points_free(&g);
}

static void a_black_sky_lights_nothing(void **state)
{
    static float lo[3 * PACKET];
    (void)state;
    struct environment *e = sky_environment(sky_constant(8, 4, 0.0f), 8, 0.0);
    struct gbuffer g = points_make(1, LOBE_PHONG, 0.5f, 0.5f, 20.0f);
    struct direct *d = direct_create(best_kernels());
    for (size_t m = 0; m < METHODS; m++) {
        shade(d, &g, e, all_methods[m], 16, 0, lo);
        for (int k = 0; k < 3 * PACKET; k++)
            assert_true(lo[k] == 0.0f);
    }
    direct_destroy(d);
    points_free(&g);
    environment_destroy(e);
}

static void a_sun_behind_the_surface_lights_nothing(void **state)
{
    static float lo[3 * PACKET];
    (void)state;
    struct frame f = sky_constant(16, 8, 0.0f);
    for (uint32_t x = 0; x < 16; x++)
        sky_paint(&f, x, 7, 1e6f, 1e6f, 1e6f); /* straight below a plane that looks up */
    struct environment *e = sky_environment(f, 8, 0.0);
    struct gbuffer g = points_make(1, LOBE_LAMBERT, 1.0f, 0.0f, 0.0f);
    struct direct *d = direct_create(best_kernels());
    for (size_t m = 0; m < METHODS; m++) {
        shade(d, &g, e, all_methods[m], 64, 1, lo);
        for (int k = 0; k < 3 * PACKET; k++)
            assert_true(lo[k] == 0.0f);
    }
    direct_destroy(d);
    points_free(&g);
    environment_destroy(e);
}

/* A geometric normal that faces away from half of the light cuts it off, whatever the shading normal says. */
static void both_normals_must_face_the_light(void **state)
{
    static float lo[3 * PACKET];
    (void)state;
    struct environment *e = sky_environment(sky_constant(16, 8, 1.0f), 16, 0.0);
    struct gbuffer g = points_make(1, LOBE_LAMBERT, 1.0f, 0.0f, 0.0f);
    struct direct *d = direct_create(best_kernels());
    for (int l = 0; l < PACKET; l++) {
        g.packets[0].ng_x[l] = 1.0f;
        g.packets[0].ng_y[l] = 0.0f;
    }
    for (size_t m = 0; m < METHODS; m++) {
        double sum = 0.0;
        for (uint64_t seed = 0; seed < 16; seed++) {
            shade(d, &g, e, all_methods[m], 1024, seed, lo);
            sum += lo[0] / 16.0;
        }
        assert_true(fabs(sum - 0.5) < 0.01); /* by symmetry half of the cosine-weighted hemisphere */
    }
    direct_destroy(d);
    points_free(&g);
    environment_destroy(e);
}

static void one_thread_and_two_give_the_same_bits(void **state)
{
    enum { PACKETS = 100 };
    static float one[PACKETS * 3 * PACKET], two[PACKETS * 3 * PACKET];
    (void)state;
    struct environment *e = sky_environment(sky_with_sun(64, 32, 1e4f), 32, 0.0);
    struct gbuffer g = points_make(PACKETS, LOBE_PHONG, 0.4f, 0.5f, 40.0f);
    struct direct *d = direct_create(best_kernels());
    points_scatter(&g, 4);
    for (size_t m = 0; m < METHODS; m++) {
        omp_set_num_threads(1);
        const struct direct_stats a = shade(d, &g, e, all_methods[m], 33, 9, one);
        omp_set_num_threads(2);
        const struct direct_stats b = shade(d, &g, e, all_methods[m], 33, 9, two);
        assert_memory_equal(one, two, sizeof(one));
        assert_int_equal(a.effective, b.effective);
    }
    direct_destroy(d);
    points_free(&g);
    environment_destroy(e);
}

static void seed_and_pass_change_the_noise(void **state)
{
    static float a[3 * PACKET], b[3 * PACKET];
    struct direct_stats stats;
    (void)state;
    struct environment *e = sky_environment(sky_overcast(64, 32), 32, 0.0);
    struct gbuffer g = points_make(1, LOBE_LAMBERT, 0.5f, 0.0f, 0.0f);
    struct direct *d = direct_create(best_kernels());
    shade(d, &g, e, METHOD_MIS, 8, 1, a);
    shade(d, &g, e, METHOD_MIS, 8, 2, b);
    assert_memory_not_equal(a, b, sizeof(a));
    const struct direct_desc next = { .method = METHOD_MIS, .samples = 8, .seed = 1, .pass = 1, .no_visibility = true };
    assert_int_equal(direct_shade(d, &g, NULL, e, &next, b, &stats), ERR_OK);
    assert_memory_not_equal(a, b, sizeof(a));
    shade(d, &g, e, METHOD_MIS, 8, 1, b);
    assert_memory_equal(a, b, sizeof(a));
    direct_destroy(d);
    points_free(&g);
    environment_destroy(e);
}

/* Radiance grows in proportion to what the sky holds: the estimators are linear in it up to the choice of samples,
 * which a factor does not change. */
static void radiance_is_linear_in_a_gain(void **state)
{
    static float a[3 * PACKET], b[3 * PACKET];
    (void)state;
    struct frame f = sky_with_sun(64, 32, 1000.0f), g4 = sky_with_sun(64, 32, 1000.0f);
    for (size_t k = 0; k < 3 * 64 * 32; k++)
        g4.rgb[k] *= 4.0f;
    struct environment *e = sky_environment(f, 32, 0.0), *e4 = sky_environment(g4, 32, 0.0);
    struct gbuffer g = points_make(1, LOBE_PHONG, 0.3f, 0.6f, 80.0f);
    struct direct *d = direct_create(best_kernels());
    points_scatter(&g, 8);
    for (size_t m = 0; m < METHODS; m++) {
        shade(d, &g, e, all_methods[m], 64, 3, a);
        shade(d, &g, e4, all_methods[m], 64, 3, b);
        for (int k = 0; k < 3 * PACKET; k++)
            assert_true(fabsf(b[k] - 4.0f * a[k]) <= 1e-4f * b[k]);
    }
    direct_destroy(d);
    points_free(&g);
    environment_destroy(e);
    environment_destroy(e4);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_white_furnace_is_white_at_every_method),
    cmocka_unit_test(a_one_texel_sky_gives_closed_form_irradiance),
    cmocka_unit_test(a_black_sky_lights_nothing),
    cmocka_unit_test(a_sun_behind_the_surface_lights_nothing),
    cmocka_unit_test(both_normals_must_face_the_light),
    cmocka_unit_test(one_thread_and_two_give_the_same_bits),
    cmocka_unit_test(seed_and_pass_change_the_noise),
    cmocka_unit_test(radiance_is_linear_in_a_gain),
};
UNIT_MAIN(tests)
