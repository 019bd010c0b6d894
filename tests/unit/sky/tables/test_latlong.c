/* Sampling on the texels of a lat-long source: Jacobian, orientation, gain, and what is refused. That its densities
 * integrate to 1 and its samples follow them is in test_sampler_pdfs.c. */
#include "sky/tables/samples.h"

#include "sky/tables/sampling.h"

static struct environment *make(struct frame f, const struct environment_desc *desc, struct latlong *t)
{
    struct environment *e = environment_create(desc);
    struct reason why;

    assert_non_null(e);
    assert_int_equal(environment_update(e, &f, &why), ERR_OK);
    assert_int_equal(latlong_build(t, e, &why), ERR_OK);
    frame_finish(&f);
    return e;
}

static void direct(double theta, double phi, float w[3])
{
    w[0] = (float)(sin(theta) * sin(phi));
    w[1] = (float)cos(theta);
    w[2] = (float)(sin(theta) * cos(phi));
}

/* pdf = p(texel) w h / (2 pi^2 sin theta) [Scotty3D] with the theta of the direction itself: it changes within a texel,
 * where the texel's own theta would not. p by hand for two lit texels in rows 0 and 2 of four. */
static void rows_have_the_jacobian_of_the_sampled_theta(void **state)
{
    static const double within[] = { 0.001, 0.25, 0.5, 0.9, 0.999 };
    struct latlong t = { 0 };
    struct frame f = sky_constant(8, 4, 0.0f);
    (void)state;
    sky_paint(&f, 2, 0, 3, 3, 3);
    sky_paint(&f, 5, 2, 1, 1, 1);
    struct environment *e = make(f, &(struct environment_desc){ .n = 4 }, &t);
    const double a = 3.0 * (1.0 - cos(PI / 4)), b = cos(PI / 2) - cos(3 * PI / 4);

    for (int k = 0; k < 5; k++)
        for (int row = 0; row < 4; row += 2) {
            const double theta = PI / 4 * (row + within[k]), p = (row ? b : a) / (a + b);
            const double want = p * 8 * 4 / (2.0 * PI * PI * sin(theta));
            float w[3], rgb[3], pdf;
            direct(theta, PI - 2.0 * PI * ((row ? 5 : 2) + within[4 - k]) / 8, w);
            latlong_evaluate_rows(&t, w, rgb, &pdf);
            assert_true(rgb[1] == (row ? 1.0f : 3.0f));
            assert_true(fabs(pdf / want - 1.0) < 1e-5);
        }
    latlong_finish(&t);
    environment_destroy(e);
}

/* The other one is even over the texel's solid angle. */
static void marginal_and_conditional_are_even_over_a_texel(void **state)
{
    struct latlong t = { 0 };
    struct frame f = sky_constant(8, 4, 0.0f);
    (void)state;
    sky_paint(&f, 2, 0, 3, 3, 3);
    sky_paint(&f, 5, 2, 1, 1, 1);
    struct environment *e = make(f, &(struct environment_desc){ .n = 4 }, &t);
    const double a = 3.0 * (1.0 - cos(PI / 4)), b = cos(PI / 2) - cos(3 * PI / 4), per_angle = 8.0 / (2.0 * PI);

    for (int k = 1; k < 20; k++) {
        float w[3], rgb[3], pdf;
        direct(PI / 4 * k / 20.0, PI - 2.0 * PI * 2.7 / 8, w);
        latlong_evaluate(&t, w, rgb, &pdf);
        assert_true(fabs(pdf / (3.0 / (a + b) * per_angle) - 1.0) < 1e-6);
        direct(PI / 4 * (2 + k / 20.0), PI - 2.0 * PI * 5.1 / 8, w);
        latlong_evaluate(&t, w, rgb, &pdf);
        assert_true(fabs(pdf / (1.0 / (a + b) * per_angle) - 1.0) < 1e-6);
    }
    latlong_finish(&t);
    environment_destroy(e);
}

/* The cube map comes by another way, the table of overlaps: where one of its texels lies within one of the source, both
 * must show the same radiance, at any rotation, gain and order of rows. */
static void radiance_is_that_of_the_cube_map(void **state)
{
    (void)state;
    for (int k = 0; k < 12; k++) {
        const struct environment_desc desc = { .n = 128,
                                               .layout = k & 1 ? LAYOUT_LATLONG_BOTTOM_FIRST : LAYOUT_LATLONG,
                                               .rotation_degrees = 77.0 * (k / 4) - 40.0,
                                               .scale_stops = k & 2 ? 3.0 : 0.0 };
        struct latlong t = { 0 };
        struct environment *e = make(sky_noise(7, 5, (uint64_t)k, 3.0, 0.1), &desc, &t);
        uint32_t same = 0;
        for (uint32_t at = 0; at < 6 * 128 * 128; at++) {
            float w[3], a[3], b[3], pdf, pdf_rows;
            grid_direction(128, at / (128 * 128), at / 128 % 128, at % 128, w);
            latlong_evaluate(&t, w, a, &pdf);
            latlong_evaluate_rows(&t, w, b, &pdf_rows);
            assert_memory_equal(a, b, sizeof(a));
            bool equal = true;
            for (int c = 0; c < 3; c++)
                equal = equal && fabsf(a[c] - (&e->texels[at].r)[c]) <= 1e-5f * a[c];
            same += equal;
        }
        /* The rest is crossed by one of the 7 + 4 borders, some 128 texels long on each face. */
        assert_true(same > 0.9 * 6 * 128 * 128);
        latlong_finish(&t);
        environment_destroy(e);
    }
}

static void rotation_turns_the_densities(void **state)
{
    struct latlong still = { 0 }, turned = { 0 };
    (void)state;
    struct environment *a = make(sky_noise(16, 8, 3, 4.0, 0.2), &(struct environment_desc){ .n = 4 }, &still);
    struct environment *b =
        make(sky_noise(16, 8, 3, 4.0, 0.2), &(struct environment_desc){ .n = 4, .rotation_degrees = 90.0 }, &turned);
    struct rng r = { 9 };

    for (int k = 0; k < 2000; k++) {
        const double theta = PI * rng_next(&r), phi = 2.0 * PI * rng_next(&r);
        float w[3], rgb[2][3], pdf[2], rows[2];
        direct(theta, phi, w);
        latlong_evaluate(&still, w, rgb[0], &pdf[0]);
        latlong_evaluate_rows(&still, w, rgb[0], &rows[0]);
        direct(theta, phi + PI / 2, w); /* +Z towards +X */
        latlong_evaluate(&turned, w, rgb[1], &pdf[1]);
        latlong_evaluate_rows(&turned, w, rgb[1], &rows[1]);
        assert_memory_equal(rgb[0], rgb[1], sizeof(rgb[0]));
        assert_true(pdf[0] == pdf[1]);
        assert_true(fabsf(rows[0] - rows[1]) <= 1e-3f * rows[0]);
    }
    latlong_finish(&still);
    latlong_finish(&turned);
    environment_destroy(a);
    environment_destroy(b);
}

/* An image with its rows the other way round and the layout that says so is the same sky. */
static void bottom_first_is_the_same_sky(void **state)
{
    struct latlong t[2] = { { 0 }, { 0 } };
    struct frame f = sky_noise(6, 5, 8, 4.0, 0.1), g = sky_constant(6, 5, 0.0f);
    struct rng r = { 4 };
    (void)state;
    for (size_t y = 0; y < 5; y++)
        memcpy(g.rgb + 18 * (4 - y), f.rgb + 18 * y, 18 * sizeof(float));
    struct environment *a = make(f, &(struct environment_desc){ .n = 4, .layout = LAYOUT_LATLONG }, &t[0]);
    struct environment *b = make(g, &(struct environment_desc){ .n = 4, .layout = LAYOUT_LATLONG_BOTTOM_FIRST }, &t[1]);

    assert_true(t[1].bottom_first && !t[0].bottom_first);
    for (int k = 0; k < 2000; k++) {
        const double x[2] = { rng_next(&r), rng_next(&r) };
        float w[3], rgb[2][3], pdf[2][2];
        latlong_sample(&t[1], x, w, rgb[1], &pdf[1][0]);
        latlong_evaluate_rows(&t[1], w, rgb[1], &pdf[1][1]);
        latlong_evaluate(&t[0], w, rgb[0], &pdf[0][0]);
        latlong_evaluate_rows(&t[0], w, rgb[0], &pdf[0][1]);
        assert_memory_equal(rgb[0], rgb[1], sizeof(rgb[0]));
        assert_true(fabsf(pdf[0][0] - pdf[1][0]) <= 1e-6f * pdf[0][0]);
        assert_true(fabsf(pdf[0][1] - pdf[1][1]) <= 1e-6f * pdf[0][1]);
    }
    for (int k = 0; k < 2; k++)
        latlong_finish(&t[k]);
    environment_destroy(a);
    environment_destroy(b);
}

/* The mean of radiance / pdf is the sky's whole radiance, whose sum over the texels is known. Of blue, while luminance
 * draws: blue over luminance is at most 14 times its mean, so that 2^16 samples have a standard error below 1.5 %, and
 * far less since they are progressive. 3 % catch a wrong Jacobian; what is finer is left to test_sampler_pdfs.c. */
static void estimates_are_the_whole_sky(void **state)
{
    struct latlong t = { 0 };
    (void)state;
    struct environment *e =
        make(sky_noise(20, 10, 5, 6.0, 0.3), &(struct environment_desc){ .n = 4, .rotation_degrees = 10.0 }, &t);
    double want = 0.0, sum[2] = { 0.0, 0.0 };
    enum { N = 1 << 16 };

    for (uint32_t k = 0; k < 200; k++)
        want += e->image.rgb[3 * k + 2] * 2.0 * PI / 20 * (cos(PI * (k / 20) / 10.0) - cos(PI * (k / 20 + 1) / 10.0));
    for (uint32_t k = 0; k < N; k++) {
        double x[2];
        float w[3], rgb[3], pdf;
        rng_sobol2(1, k, x);
        latlong_sample(&t, x, w, rgb, &pdf);
        sum[0] += rgb[2] / pdf / N;
        latlong_sample_rows(&t, x, w, rgb, &pdf);
        sum[1] += rgb[2] / pdf / N;
    }
    assert_true(fabs(sum[0] / want - 1.0) < 0.03);
    assert_true(fabs(sum[1] / want - 1.0) < 0.03);
    latlong_finish(&t);
    environment_destroy(e);
}

static void the_pole_itself_has_a_finite_density(void **state)
{
    struct latlong t = { 0 };
    (void)state;
    struct environment *e = make(sky_constant(8, 4, 1.0f), &(struct environment_desc){ .n = 4 }, &t);

    for (int s = -1; s <= 1; s += 2) {
        const float w[3] = { 0.0f, (float)s, 0.0f };
        float rgb[3], pdf;
        latlong_evaluate_rows(&t, w, rgb, &pdf);
        assert_true(isfinite(pdf) && pdf > 0.0f);
        latlong_evaluate(&t, w, rgb, &pdf);
        assert_true(fabs(pdf * 4.0 * PI - 1.0) < 1e-6);
    }
    latlong_finish(&t);
    environment_destroy(e);
}

static void other_layouts_are_refused_by_name(void **state)
{
    static const struct {
        enum layout layout;
        uint32_t width, height;
    } sources[] = {
        { LAYOUT_CUBE, 4, 24 },  { LAYOUT_HCROSS, 16, 12 },  { LAYOUT_VCROSS, 12, 16 },
        { LAYOUT_BALL, 16, 16 }, { LAYOUT_FISHEYE, 16, 16 },
    };
    struct latlong t = { 0 };
    (void)state;
    for (size_t k = 0; k < sizeof(sources) / sizeof(sources[0]); k++) {
        struct environment *e =
            sky_environment_of(sky_constant(sources[k].width, sources[k].height, 1.0f), sources[k].layout, 4, 0.0);
        struct reason why = { "" };
        assert_int_equal(latlong_build(&t, e, &why), ERR_UNSUPPORTED);
        assert_non_null(strstr(why.text, layout_name(sources[k].layout)));
        assert_non_null(strstr(why.text, "a constant sky"));
        environment_destroy(e);
    }
    latlong_finish(&t);
}

/* Another frame, another size, another layout in the same table; nothing of the first is left. */
static void a_table_is_reused(void **state)
{
    struct latlong t = { 0 }, fresh = { 0 };
    (void)state;
    for (int k = 0; k < 3; k++) {
        struct environment *e = make_sky(k & 1 ? SKY_UPSIDE : SKY_SEVEN);
        assert_int_equal(latlong_build(&t, e, NULL), ERR_OK);
        assert_int_equal(latlong_build(&fresh, e, NULL), ERR_OK);
        assert_true(t.total == fresh.total && t.bottom_first == fresh.bottom_first);
        assert_memory_equal(t.cdf, fresh.cdf, (size_t)t.width * t.height * sizeof(*t.cdf));
        latlong_finish(&fresh);
        environment_destroy(e);
    }
    latlong_finish(&t);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(rows_have_the_jacobian_of_the_sampled_theta),
    cmocka_unit_test(marginal_and_conditional_are_even_over_a_texel),
    cmocka_unit_test(radiance_is_that_of_the_cube_map),
    cmocka_unit_test(rotation_turns_the_densities),
    cmocka_unit_test(bottom_first_is_the_same_sky),
    cmocka_unit_test(estimates_are_the_whole_sky),
    cmocka_unit_test(the_pole_itself_has_a_finite_density),
    cmocka_unit_test(other_layouts_are_refused_by_name),
    cmocka_unit_test(a_table_is_reused),
};
UNIT_MAIN(tests)
