/* Resampling and the cube map: constant and energy kept, orientation, solid angles. */
#include "cube.h"
#include "resample.h"

#include "skies.h"

static const struct {
    uint32_t width, height, n;
    double rotation;
} cases[] = {
    { 64, 32, 16, 0.0 }, { 64, 32, 16, 0.7 },  { 1, 1, 7, 0.3 },     { 2, 1, 4, -2.0 },
    { 37, 19, 33, 0.1 }, { 256, 128, 1, 0.0 }, { 100, 50, 64, 3.1 }, { 512, 256, 32, 0.0 },
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
        struct resampler *r;
        assert_int_equal(
            resampler_create(LAYOUT_LATLONG, cases[q].width, cases[q].height, cases[q].n, cases[q].rotation, &r),
            ERR_OK);
        struct frame f = sky_constant(cases[q].width, cases[q].height, 3.0f);
        float *row = mem_alloc(cases[q].n, 4 * sizeof(float));
        resampler_load(r, f.rgb);
        for (uint32_t i = 0; i < 6 * cases[q].n; i++) {
            resampler_row(r, 2.0f, i, row);
            for (uint32_t j = 0; j < cases[q].n; j++)
                assert_true(fabsf(row[4 * j] / 6.0f - 1.0f) < 1e-5f);
        }
        mem_free(row);
        frame_finish(&f);
        resampler_destroy(r);
    }
}

/* What each source texel brings to all cube texels, against its own solid angle. */
static void resample_keeps_every_texels_energy(void **state)
{
    (void)state;
    for (size_t q = 0; q < CASES; q++) {
        const uint32_t width = cases[q].width, height = cases[q].height, n = cases[q].n;
        struct resampler *r;
        assert_int_equal(resampler_create(LAYOUT_LATLONG, width, height, n, cases[q].rotation, &r), ERR_OK);
        double *arrived = mem_alloc((size_t)width * height, sizeof(double));
        for (size_t t = 0; t < 6 * (size_t)n * n; t++)
            for (uint64_t k = r->first[t]; k < r->first[t + 1]; k++)
                arrived[r->index[k]] += r->weight[k] * texel_solid_angle(n, (uint32_t)(t / n % n), (uint32_t)(t % n));
        for (uint32_t y = 0; y < height; y++)
            for (uint32_t x = 0; x < width; x++) {
                const double want = 2.0 * PI / width * (cos(PI * y / height) - cos(PI * (y + 1) / height));
                assert_true(fabs(arrived[(size_t)y * width + x] / want - 1.0) < 1e-5);
            }
        mem_free(arrived);
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
        environment_look(e, unit, rgb);
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
    struct resampler *top, *bottom;
    float a[4 * 8], b[4 * 8];
    (void)state;
    struct frame f = sky_with_sun(32, 16, 100.0f), g = sky_constant(32, 16, 0.0f);
    for (uint32_t y = 0; y < 16; y++)
        memcpy(g.rgb + 96 * (size_t)y, f.rgb + 96 * (size_t)(15 - y), 96 * sizeof(float));
    assert_int_equal(resampler_create(LAYOUT_LATLONG, 32, 16, 8, 0.2, &top), ERR_OK);
    assert_int_equal(resampler_create(LAYOUT_LATLONG_BOTTOM_FIRST, 32, 16, 8, 0.2, &bottom), ERR_OK);
    resampler_load(top, f.rgb);
    resampler_load(bottom, g.rgb);
    for (uint32_t i = 0; i < 48; i++) {
        resampler_row(top, 1.0f, i, a);
        resampler_row(bottom, 1.0f, i, b);
        for (int k = 0; k < 32; k++) /* summed in another order */
            assert_true(k % 4 == 3 || fabsf(a[k] - b[k]) <= 1e-6f * a[k]);
    }
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
    cmocka_unit_test(orientation_is_that_of_openexr),
    cmocka_unit_test(rotation_is_right_handed_about_y),
    cmocka_unit_test(bottom_first_rows_are_the_same_sky_turned_over),
    cmocka_unit_test(shapes_without_a_layout_are_refused_by_name),
};
UNIT_MAIN(tests)
