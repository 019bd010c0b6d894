/* Resampling and the cube map: constant and energy kept, orientation, solid angles. */
#include "sky/tables/cube.h"
#include "sky/tables/resampling.h"
#include "support/skies.h"

static const struct {
    uint32_t width, height, n;
    double rotation;
} cases[] = {
    { 64, 32, 16, 0.0 },  { 64, 32, 16, 0.7 },  { 1, 1, 7, 0.3 },      { 2, 1, 4, -2.0 },     { 37, 19, 33, 0.1 },
    { 256, 128, 1, 0.0 }, { 100, 50, 64, 3.1 }, { 512, 256, 32, 0.0 }, { 1400, 700, 8, 0.4 }, /* offsets of 32 bits */
    { 3, 2000, 7, 0.0 }, /* rows whose borders are crossed only near the middle of a face */
};
#define CASES (sizeof(cases) / sizeof(cases[0]))

static double texel_solid_angle(uint32_t n, uint32_t i, uint32_t j)
{
    const double s = 2.0 / n;
    return cube_solid_angle(-1.0 + s * j, -1.0 + s * i, -1.0 + s * (j + 1), -1.0 + s * (i + 1));
}

static void solid_angles_add_up_to_the_sphere(void **state)
{
    (void)state;
    for (uint32_t n = 1; n <= 256; n *= 2) {
        double sum = 0.0;
        for (uint32_t i = 0; i < n; i++)
            for (uint32_t j = 0; j < n; j++)
                sum += texel_solid_angle(n, i, j);
        assert_true(fabs(6.0 * sum / (4.0 * PI) - 1.0) < 1e-12);
    }
}

static void locate_inverts_direction(void **state)
{
    struct rng r = { 1 };
    (void)state;
    for (int k = 0; k < 10000; k++) {
        const uint32_t face = (uint32_t)(6.0 * rng_next(&r));
        const double u = 1.998 * rng_next(&r) - 0.999, v = 1.998 * rng_next(&r) - 0.999;
        double d[3];
        float w[3], u_back, v_back;
        cube_direction(face, u, v, d);
        for (int c = 0; c < 3; c++)
            w[c] = (float)(0.37 * d[c]);
        assert_int_equal(cube_locate(w, &u_back, &v_back), face);
        assert_true(fabs(u_back - u) < 1e-5 && fabs(v_back - v) < 1e-5);
    }
}

static void resample_keeps_a_constant(void **state)
{
    (void)state;
    for (size_t q = 0; q < CASES; q++) {
        const uint32_t n = cases[q].n;
        struct resampler *r = resampling_make(LAYOUT_LATLONG, cases[q].width, cases[q].height, n, cases[q].rotation);
        struct frame f = sky_constant(cases[q].width, cases[q].height, 3.0f);
        float *cube = resampling_cube(r, f.rgb, 2.0f);
        for (size_t t = 0; t < 6 * (size_t)n * n; t++)
            assert_true(fabsf(cube[4 * t] / 6.0f - 1.0f) < 1e-5f);
        mem_free(cube);
        frame_finish(&f);
        resampler_destroy(r);
    }
}

/* What each source texel brings to all cube texels, against its own solid angle. */
static void resample_keeps_every_texels_energy(void **state)
{
    (void)state;
    for (size_t q = 0; q < CASES; q++) {
        const uint32_t width = cases[q].width, height = cases[q].height;
        struct resampler *r = resampling_make(LAYOUT_LATLONG, width, height, cases[q].n, cases[q].rotation);
        double *arrived = resampling_arrived(r);
        for (uint32_t y = 0; y < height; y++)
            for (uint32_t x = 0; x < width; x++) {
                const double want = 2.0 * PI / width * (cos(PI * y / height) - cos(PI * (y + 1) / height));
                assert_true(fabs(arrived[(size_t)y * width + x] / want - 1.0) < 1e-5);
            }
        mem_free(arrived);
        resampler_destroy(r);
    }
}

/* A texel is the mean of the sky over its solid angle, here by 300 x 300 places. Sizes of which quarter turns map the
 * source and the cube map onto themselves, and others. */
static void a_texel_is_the_mean_over_its_solid_angle(void **state)
{
    static const struct {
        uint32_t width, height, n;
        double rotation;
    } sizes[] = { { 16, 8, 4, 0.3 }, { 18, 9, 4, 0.3 }, { 16, 8, 3, 2.0 } };
    enum { PLACES = 300 };
    (void)state;
    for (size_t q = 0; q < sizeof(sizes) / sizeof(sizes[0]); q++) {
        const uint32_t n = sizes[q].n, width = sizes[q].width, height = sizes[q].height;
        struct resampler *r = resampling_make(LAYOUT_LATLONG, width, height, n, sizes[q].rotation);
        struct frame f = sky_constant(width, height, 0.0f);
        struct rng random = { 7 };
        for (size_t k = 0; k < 3 * (size_t)width * height; k++)
            f.rgb[k] = (float)rng_next(&random);
        float *cube = resampling_cube(r, f.rgb, 1.0f);
        for (uint32_t t = 0; t < 6 * n * n; t++) {
            double sum = 0.0, all = 0.0;
            for (uint32_t k = 0; k < PLACES * PLACES; k++) {
                const double u = (2.0 * (t % n + (k % PLACES + 0.5) / PLACES)) / n - 1.0;
                const double v = (2.0 * (t / n % n + (k / PLACES + 0.5) / PLACES)) / n - 1.0;
                double w[3];
                cube_direction(t / (n * n), u, v, w);
                const double omega = pow(1.0 + u * u + v * v, -1.5);
                double x = (PI - atan2(w[0], w[2]) + sizes[q].rotation) / (2.0 * PI);
                x -= floor(x);
                const double y = acos(w[1] / sqrt(1.0 + u * u + v * v)) / PI;
                sum += omega * (double)f.rgb[3 * ((size_t)(y * height) * width + (size_t)(x * width) % width)];
                all += omega;
            }
            assert_true(fabs(cube[4 * t] / (sum / all) - 1.0) < 0.01);
        }
        mem_free(cube);
        frame_finish(&f);
        resampler_destroy(r);
    }
}

/* The sums of a frame by the table's packed order, against the same table read term by term in double: sums in float of
 * up to 64 terms of one sign are off by at most 64 halves of a unit in the last place, 4e-6. 1400 x 700 texels on a
 * cube map of 8 x 8 take offsets of 32 bits, and lanes of thousands of terms. */
static void packed_sums_are_those_of_the_terms(void **state)
{
    static const struct {
        uint32_t width, height, n;
    } sizes[] = { { 300, 150, 61 }, { 1024, 512, 64 }, { 1400, 700, 8 }, { 37, 19, 3 } };
    (void)state;
    for (size_t q = 0; q < sizeof(sizes) / sizeof(sizes[0]); q++) {
        const uint32_t n = sizes[q].n;
        struct resampler *r = resampling_make(LAYOUT_LATLONG, sizes[q].width, sizes[q].height, n, 0.4);
        struct frame f = sky_constant(sizes[q].width, sizes[q].height, 0.0f);
        struct rng random = { 3 };
        for (size_t k = 0; k < 3 * (size_t)f.width * f.height; k++)
            f.rgb[k] = (float)rng_next(&random);
        assert_true(q != 2 || r->table->far);
        assert_true(q != 1 || r->table->near);
        float *cube = resampling_cube(r, f.rgb, 1.0f);
        double *want = resampling_sums(r, f.rgb);
        for (size_t k = 0; k < 18 * (size_t)n * n; k++)
            assert_true(fabs(cube[k / 3 * 4 + k % 3] / want[k] - 1.0) < 4e-6);
        mem_free(cube);
        mem_free(want);
        frame_finish(&f);
        resampler_destroy(r);
    }
}

/* Radiance towards the six axes of a sky with a differently bright patch about each. */
static void check_axes(double rotation_degrees, const float want[6])
{
    struct frame f = sky_constant(64, 32, 0.0f);
    for (uint32_t y = 0; y < 32; y++)
        for (uint32_t x = 0; x < 64; x++) {
            /* Centre +Z, a quarter to its left +X, right of it -X, the border -Z. */
            const float around = x < 8 || x >= 56 ? 4.0f : x < 24 ? 1.0f : x < 40 ? 3.0f : 2.0f;
            const float l = y < 6 ? 5.0f : y >= 26 ? 6.0f : around;
            sky_paint(&f, x, y, l, l, l);
        }
    struct environment *e = sky_environment(f, 32, rotation_degrees);
    static const float axis[6][3] = { { 1, 0, 0 }, { -1, 0, 0 }, { 0, 0, 1 }, { 0, 0, -1 }, { 0, 1, 0 }, { 0, -1, 0 } };
    for (int k = 0; k < 6; k++) {
        const float w[3] = { axis[k][0] + 0.01f, axis[k][1] + 0.02f, axis[k][2] + 0.01f };
        const struct vec3 unit = vec3_normalize(vec3_make(w[0], w[1], w[2]));
        float rgb[3], pdf;
        environment_evaluate(e, w, rgb, &pdf);
        assert_true(fabsf(rgb[0] - want[k]) < 1e-3f);
        environment_lookup(e, unit, rgb);
        assert_true(fabsf(rgb[0] - want[k]) < 1e-3f);
    }
    environment_destroy(e);
}

static void orientation_is_that_of_openexr(void **state)
{
    (void)state;
    check_axes(0.0, (const float[6]){ 1, 2, 3, 4, 5, 6 });
}

/* A quarter turn takes what stood at +Z to +X, at +X to -Z. */
static void rotation_is_right_handed_about_y(void **state)
{
    (void)state;
    check_axes(90.0, (const float[6]){ 3, 4, 2, 1, 5, 6 });
}

static void bottom_first_rows_are_the_same_sky_turned_over(void **state)
{
    (void)state;
    struct frame f = sky_with_sun(32, 16, 100.0f), g = sky_constant(32, 16, 0.0f);
    for (uint32_t y = 0; y < 16; y++)
        memcpy(g.rgb + 96 * (size_t)y, f.rgb + 96 * (size_t)(15 - y), 96 * sizeof(float));
    struct resampler *top = resampling_make(LAYOUT_LATLONG, 32, 16, 8, 0.2);
    struct resampler *bottom = resampling_make(LAYOUT_LATLONG_BOTTOM_FIRST, 32, 16, 8, 0.2);
    float *a = resampling_cube(top, f.rgb, 1.0f), *b = resampling_cube(bottom, g.rgb, 1.0f);
    for (int k = 0; k < 48 * 32; k++) /* summed in another order */
        assert_true(k % 4 == 3 || fabsf(a[k] - b[k]) <= 1e-6f * a[k]);
    mem_free(a);
    mem_free(b);
    resampler_destroy(top);
    resampler_destroy(bottom);
    frame_finish(&f);
    frame_finish(&g);
}

static void shapes_without_a_layout_are_refused_by_name(void **state)
{
    struct reason why = { "" };
    (void)state;
    struct frame f = sky_constant(20, 20, 1.0f);
    struct environment *e = environment_create(&(struct environment_desc){ .n = 8 });
    snprintf(f.name, sizeof(f.name), "square.exr");
    f.kind = FRAME_TEXELS;
    assert_int_equal(environment_decode(e, &f, &why), ERR_OK);
    e->image.layout = LAYOUT_AUTO; /* as of a file that says nothing */
    assert_int_equal(environment_rebuild(e, &why), ERR_UNSUPPORTED);
    assert_non_null(strstr(why.text, "square.exr"));
    assert_non_null(strstr(why.text, "--layout"));
    assert_false(e->ready);
    frame_finish(&f);
    environment_destroy(e);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(solid_angles_add_up_to_the_sphere),
    cmocka_unit_test(locate_inverts_direction),
    cmocka_unit_test(resample_keeps_a_constant),
    cmocka_unit_test(resample_keeps_every_texels_energy),
    cmocka_unit_test(a_texel_is_the_mean_over_its_solid_angle),
    cmocka_unit_test(packed_sums_are_those_of_the_terms),
    cmocka_unit_test(orientation_is_that_of_openexr),
    cmocka_unit_test(rotation_is_right_handed_about_y),
    cmocka_unit_test(bottom_first_rows_are_the_same_sky_turned_over),
    cmocka_unit_test(shapes_without_a_layout_are_refused_by_name),
};
UNIT_MAIN(tests)
