/* What is looked at with a wide eye. */
#include "support/skies.h"

#include "sky/tables/cube.h"
#include "sky/tables/pyramid.h"

static const float widths[] = { 0.0f, 1e-4f, 0.01f, 0.03f, 0.1f, 0.2f, 0.5f, 1.0f, 2.0f, 4.0f, 6.3f, 100.0f, INFINITY };
#define WIDTHS (sizeof(widths) / sizeof(widths[0]))

/* Point k of n that cover the sphere evenly: a spiral of equal steps in height and of golden angles. */
static struct vec3 on_sphere(uint32_t k, uint32_t n)
{
    const double y = 1.0 - (2.0 * k + 1.0) / n, r = sqrt(1.0 - y * y), phi = 2.3999632297286533 * k;
    return vec3_make((float)(r * sin(phi)), (float)y, (float)(r * cos(phi)));
}

/* Every texel a random number in 0..1, the same in each run. */
static struct frame sky_noise(uint32_t width, uint32_t height)
{
    struct frame f = sky_constant(width, height, 0.0f);
    for (uint32_t t = 0; t < width * height; t++)
        for (uint32_t c = 0; c < 3; c++)
            f.rgb[3 * t + c] = (float)rng_unit(rng_mix(t, c));
    return f;
}

static void constant_sky_is_constant_at_all_widths(void **state)
{
    static const struct {
        enum layout layout;
        uint32_t width, height;
    } skies[] = { { LAYOUT_LATLONG, 1, 1 },   { LAYOUT_LATLONG, 64, 32 }, { LAYOUT_LATLONG_BOTTOM_FIRST, 33, 17 },
                  { LAYOUT_CUBE, 9, 54 },     { LAYOUT_HCROSS, 40, 30 },  { LAYOUT_VCROSS, 30, 40 },
                  { LAYOUT_BALL, 41, 41 },    { LAYOUT_FISHEYE, 50, 40 }, { LAYOUT_LATLONG, 2048, 1024 },
                  { LAYOUT_CUBE, 450, 2700 }, { LAYOUT_BALL, 1100, 1100 } };
    static const uint32_t sizes[] = { 1, 2, 3, 7, 32, 37 };

    (void)state;
    for (size_t s = 0; s < sizeof(skies) / sizeof(skies[0]); s++)
        for (size_t i = 0; i < sizeof(sizes) / sizeof(sizes[0]); i++) {
            if (skies[s].width > 400 && i % seeds_count(3, 1)) /* each commit tries two sizes of cube for large maps */
                continue;
            struct environment *e = sky_environment_of(sky_constant(skies[s].width, skies[s].height, 3.0f),
                                                       skies[s].layout, sizes[i], 17.0);
            for (uint32_t k = 0; k < 300; k++)
                for (size_t w = 0; w < WIDTHS; w++) {
                    float rgb[3];
                    environment_lookup_wide(e, on_sphere(k, 300), widths[w], rgb);
                    for (int c = 0; c < 3; c++)
                        assert_true(fabsf(rgb[c] - 3.0f) < 3e-5f);
                }
            environment_destroy(e);
        }
}

static void narrow_lookup_is_the_plain_one(void **state)
{
    struct environment *e = sky_environment(sky_noise(128, 64), 32, 40.0);

    (void)state;
    for (uint32_t k = 0; k < 5000; k++) {
        float plain[3], narrow[3], not_a_number[3];
        environment_lookup(e, on_sphere(k, 5000), plain);
        environment_lookup_wide(e, on_sphere(k, 5000), 1e-3f, narrow);
        environment_lookup_wide(e, on_sphere(k, 5000), NAN, not_a_number);
        assert_memory_equal(plain, narrow, sizeof(plain));
        assert_memory_equal(plain, not_a_number, sizeof(plain));
    }
    environment_destroy(e);
}

/* Mean over the sphere of the lookup at a width, of the first channel. */
static double mean_at(const struct environment *e, float width, uint32_t points)
{
    double sum = 0.0;

#pragma omp parallel for reduction(+ : sum)
    for (uint32_t k = 0; k < points; k++) {
        float rgb[3];
        environment_lookup_wide(e, on_sphere(k, points), width, rgb);
        sum += (double)rgb[0];
    }
    return sum / points;
}

static double mean_of_texels(const struct environment *e)
{
    double sum = 0.0;

    for (size_t t = 0; t < (size_t)CUBE_FACES * e->n * e->n; t++)
        sum += (double)e->texels[t].r * e->solid_angle[t % ((size_t)e->n * e->n)];
    return sum / (4.0 * PI);
}

static void energy_is_kept_at_all_widths(void **state)
{
    static const uint32_t sizes[] = { 16, 33, 64 };

    (void)state;
    for (size_t i = 0; i < 3; i++) {
        struct environment *e = sky_environment(sky_noise(128, 64), sizes[i], 0.0);
        const double want = mean_of_texels(e);
        for (size_t w = 2; w < WIDTHS; w++)
            assert_true(fabs(mean_at(e, widths[w], 50000) / want - 1.0) < 2e-4);
        environment_destroy(e);
    }
}

/* One lit texel, anywhere: which is a sun. Without the gains of pyramid.c the worst is 40 %. Below a width of 0.1 the
 * points of this mean are too few for it, and n = 33 and 48 halve to odd sides. */
static void small_sun_keeps_its_energy_at_all_widths(void **state)
{
    (void)state;
    for (uint32_t k = 0; k < 6; k++) {
        struct frame f = sky_constant(128, 64, 0.0f);
        sky_paint(&f, 22 * k % 128, 10 * k + 4, 1e4f, 1e4f, 1e4f);
        struct environment *e = sky_environment(f, k & 1 ? 33 : 48, 0.0);
        const double want = mean_of_texels(e);
        for (size_t w = 4; w < WIDTHS; w++)
            assert_true(fabs(mean_at(e, widths[w], 50000) / want - 1.0) < 0.015);
        environment_destroy(e);
    }
}

/* The mean over the round cone that is as large as the square of edge `width`. */
static double brute_force(const struct environment *e, struct vec3 w, double width)
{
    const double solid = fmin(width * width, 4.0 * PI), least = 1.0 - solid / (2.0 * PI); /* cosine at its border */
    const struct vec3 axis = fabsf(w.y) < 0.7f ? vec3_make(0, 1, 0) : vec3_make(1, 0, 0);
    const struct vec3 a = vec3_normalize(vec3_cross(axis, w)), b = vec3_cross(w, a);
    const uint32_t n = 1000;
    double sum = 0.0;

    for (uint32_t k = 0; k < n; k++) {
        const double c = 1.0 + (least - 1.0) * (k + 0.5) / n, s = sqrt(1.0 - c * c), phi = 2.3999632297286533 * k;
        float rgb[3];
        environment_lookup(e,
                           vec3_add(vec3_scale(w, (float)c), vec3_add(vec3_scale(a, (float)(s * sin(phi))),
                                                                      vec3_scale(b, (float)(s * cos(phi))))),
                           rgb);
        sum += (double)rgb[0];
    }
    return sum / n;
}

/* Root mean squares over directions: of the lookup's difference from the truth, and of the plain lookup's. */
static void compare_with_cones(const struct environment *e, double width, double *wide, double *plain)
{
    const uint32_t n = 300;

    *wide = *plain = 0.0;
    for (uint32_t k = 0; k < n; k++) {
        const struct vec3 to = on_sphere(k, n);
        float a[3], b[3];
        const double want = brute_force(e, to, width);
        environment_lookup_wide(e, to, (float)width, a);
        environment_lookup(e, to, b);
        *wide += ((double)a[0] - want) * ((double)a[0] - want) / n;
        *plain += ((double)b[0] - want) * ((double)b[0] - want) / n;
    }
    *wide = sqrt(*wide);
    *plain = sqrt(*plain);
}

/* The filter is a mixture of tents where the truth is a disc of the same variance: they agree to second order. Bounds
 * are about 1.4 times what was measured. An overcast sky with a sharp horizon (0.33 to 0.1, its zenith being 1): at
 * widths from 0.1 to 1 the error is less than half of what looking at one direction makes. A sky of noise, of which
 * nothing but the mean may be left: little of it is. */
static void wide_lookup_is_the_mean_of_its_cone(void **state)
{
    static const struct {
        double width, overcast, noise;
    } cases[] = { { 0.1, 0.007, 0.012 }, { 0.2, 0.009, 0.008 }, { 0.5, 0.018, 0.007 },
                  { 1.0, 0.027, 0.007 }, { 2.0, 0.055, 0.007 }, { 4.0, 0.002, 0.007 } };
    struct environment *overcast = sky_environment(sky_overcast(256, 128), 64, 20.0);
    struct environment *noise = sky_environment(sky_noise(2048, 1024), 64, 20.0);

    (void)state;
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        double wide, plain;
        compare_with_cones(overcast, cases[i].width, &wide, &plain);
        assert_true(wide < cases[i].overcast && (wide < 0.5 * plain || cases[i].width < 0.2));
        compare_with_cones(noise, cases[i].width, &wide, &plain);
        assert_true(wide < cases[i].noise && plain > 0.15);
    }
    environment_destroy(overcast);
    environment_destroy(noise);
}

/* Sources whose texels are much finer than the cube map's: between the two several taps are taken, and blocks where the
 * resampler has them (800 texels along an edge are many enough). What is left of noise is what the mean over the cone
 * leaves: 0.98 to 1.43 times as much, most where the filter is about as narrow as a texel. 300 directions tell it to
 * 6 %. */
static void gap_below_the_cube_map_is_filled(void **state)
{
    (void)state;
    for (int sky = 0; sky < 2; sky++) {
        struct environment *e = sky == 0 ? sky_environment(sky_noise(1024, 512), 32, 0.0)
                                         : sky_environment_of(sky_noise(800, 4800), LAYOUT_CUBE, 64, 0.0);
        const double texel = sky == 0 ? 2.0 * PI / 1024 : sqrt(4.0 * PI / 6.0) / 800;
        for (double width = 2.5 * texel; width < 0.1; width *= 1.5) {
            double sum = 0.0, sum2 = 0.0, truth = 0.0, truth2 = 0.0;
            for (uint32_t k = 0; k < 300; k++) {
                float rgb[3];
                environment_lookup_wide(e, on_sphere(k, 300), (float)width, rgb);
                const double want = brute_force(e, on_sphere(k, 300), width);
                sum += (double)rgb[0] / 300;
                sum2 += (double)rgb[0] * (double)rgb[0] / 300;
                truth += want / 300;
                truth2 += want * want / 300;
            }
            const double got = sqrt(sum2 - sum * sum) / sqrt(truth2 - truth * truth);
            assert_true(got > 0.85 && got < 1.6);
        }
        environment_destroy(e);
    }
}

/* The steepest slope met along great circles, per radian, of a level of the pyramid or (-1) of the lookup of some
 * width: about the coordinate axes, where they run through the middles of edges and through the poles; about diagonals,
 * through corners; and about random axes. */
static float steepest(const struct environment *e, int level, float width, uint32_t steps)
{
    float most = 0.0f;

    for (uint32_t circle = 0; circle < 16; circle++) {
        struct vec3 pole = vec3_make(circle == 0, circle == 1, circle == 2);
        if (circle >= 3)
            pole = vec3_make(circle & 1 ? 1.0f : -1.0f, 0.0f, 1.0f);
        if (circle >= 5)
            pole = on_sphere((uint32_t)(1000 * rng_unit(rng_mix(circle, 0))), 1000);
        pole = vec3_normalize(pole);
        const struct vec3 axis = fabsf(pole.y) < 0.7f ? vec3_make(0, 1, 0) : vec3_make(1, 0, 0);
        const struct vec3 a = vec3_normalize(vec3_cross(axis, pole)), b = vec3_cross(pole, a);
        float before = 0.0f;
        for (uint32_t k = 0; k <= steps; k++) {
            const double t = 2.0 * PI * k / steps;
            const struct vec3 w = vec3_add(vec3_scale(a, (float)cos(t)), vec3_scale(b, (float)sin(t)));
            float rgb[3], u, v;
            const uint32_t face = cube_locate((const float[3]){ w.x, w.y, w.z }, &u, &v);
            if (level >= 0)
                pyramid_lookup_at(e->pyramid, (uint32_t)level, face, u, v, rgb);
            else
                environment_lookup_wide(e, w, width, rgb);
            if (k > 0)
                most = fmaxf(most, fabsf(rgb[0] - before));
            before = rgb[0];
        }
    }
    return most * (float)steps / (2.0f * (float)PI);
}

/* Steps of a tenth meet a tenth of the change: a seam's jump would look ten times as steep. */
static void lookup_has_no_seams(void **state)
{
    static const uint32_t sizes[] = { 1, 2, 5, 16, 17 };

    (void)state;
    for (size_t i = 0; i < sizeof(sizes) / sizeof(sizes[0]); i++) {
        struct environment *e = sky_environment(sky_noise(320, 160), sizes[i], 33.0);
        for (int level = 0; level < (int)e->pyramid->count; level++)
            assert_true(steepest(e, level, 0.0f, 5000) < 1.5f * steepest(e, level, 0.0f, 500) + 1e-3f);
        /* nothing of the source is mixed in there, which is not continuous at the poles */
        for (size_t w = 6; w < WIDTHS && sizes[i] >= 16; w++)
            assert_true(steepest(e, -1, widths[w], 5000) < 1.5f * steepest(e, -1, widths[w], 500) + 1e-3f);
        environment_destroy(e);
    }
}

/* In a width as well: from rung to rung. */
static void lookup_is_continuous_in_width(void **state)
{
    struct environment *e = sky_environment(sky_noise(256, 128), 33, 0.0);

    (void)state;
    for (uint32_t k = 0; k < 100; k++) {
        float before[3] = { 0.0f };
        for (float width = 1e-3f; width < 5.0f; width *= 1.0005f) {
            float rgb[3];
            environment_lookup_wide(e, on_sphere(k, 100), width, rgb);
            if (width > 1e-3f)
                assert_true(fabsf(rgb[0] - before[0]) < 5e-3f);
            before[0] = rgb[0];
        }
    }
    environment_destroy(e);
}

/* Slots for frames copy what depends on the size alone. The sizes have levels without gains, with gains, and one. */
static void environment_like_another_is_the_same(void **state)
{
    static const uint32_t sizes[] = { 1, 7, 32, 40 };
    struct frame f = sky_noise(64, 32);
    struct reason why;

    (void)state;
    for (size_t i = 0; i < sizeof(sizes) / sizeof(sizes[0]); i++) {
        const struct environment_desc desc = { .n = sizes[i], .layout = LAYOUT_LATLONG };
        struct environment_desc like = desc;
        struct environment *a = environment_create(&desc);
        like.like = a;
        struct environment *b = environment_create(&like);
        assert_true(a && b);
        assert_int_equal(environment_update(b, &f, &why), ERR_OK); /* first: it takes nothing of a's frame */
        assert_int_equal(environment_update(a, &f, &why), ERR_OK);
        const size_t texels = (size_t)CUBE_FACES * sizes[i] * sizes[i];
        assert_memory_equal(a->texels, b->texels, texels * sizeof(*a->texels));
        assert_memory_equal(a->row_cdf, b->row_cdf, texels * sizeof(*a->row_cdf));
        for (uint32_t k = 0; k < 200 * WIDTHS; k++) {
            float seen[2][3];
            environment_lookup_wide(a, on_sphere(k / WIDTHS, 200), widths[k % WIDTHS], seen[0]);
            environment_lookup_wide(b, on_sphere(k / WIDTHS, 200), widths[k % WIDTHS], seen[1]);
            assert_memory_equal(seen[0], seen[1], sizeof(seen[0]));
        }
        environment_destroy(a); /* b has copies of its own */
        environment_destroy(b);
    }
    frame_finish(&f);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(environment_like_another_is_the_same),
    cmocka_unit_test(constant_sky_is_constant_at_all_widths),
    cmocka_unit_test(narrow_lookup_is_the_plain_one),
    cmocka_unit_test(energy_is_kept_at_all_widths),
    cmocka_unit_test(small_sun_keeps_its_energy_at_all_widths),
    cmocka_unit_test(gap_below_the_cube_map_is_filled),
    cmocka_unit_test(wide_lookup_is_the_mean_of_its_cone),
    cmocka_unit_test(lookup_has_no_seams),
    cmocka_unit_test(lookup_is_continuous_in_width),
};

UNIT_MAIN(tests)
