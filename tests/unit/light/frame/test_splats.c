/* Lone splats in denoised images (light/denoise/denoise.h). RING: docs/examples. */
#include "light/denoise/denoise.h"
#include "light/frame/stage.h"

#include <math.h>

enum { SIDE = 9, VALUES = 3 * SIDE * SIDE, WIDTH = 48, HEIGHT = 27 };

static float *pixel(float rgb[VALUES], uint32_t x, uint32_t y)
{
    return rgb + 3 * ((size_t)y * SIDE + x);
}

static double sum_of(const float *rgb, size_t values)
{
    double sum = 0.0;

    for (size_t v = 0; v < values; v++)
        sum += (double)rgb[v];
    return sum;
}

/* By hand: alone in the middle, 25 becomes 1 in 25 pixels; in a corner, 9 becomes 1 in 9. Colours stay. */
static void a_lone_splat_spreads(void **state)
{
    float rgb[VALUES] = { 0.0f };
    (void)state;

    pixel(rgb, 4, 5)[0] = 25.0f;
    pixel(rgb, 0, 0)[2] = 9.0f;
    assert_int_equal(splats_spread(rgb, SIDE, SIDE), ERR_OK);
    for (uint32_t y = 0; y < SIDE; y++)
        for (uint32_t x = 0; x < SIDE; x++) {
            const bool near = x >= 2 && x <= 6 && y >= 3 && y <= 7, corner = x <= 2 && y <= 2;
            assert_float_equal(pixel(rgb, x, y)[0], near ? 1.0 : 0.0, 1e-5);
            assert_float_equal(pixel(rgb, x, y)[1], 0.0, 0.0);
            assert_float_equal(pixel(rgb, x, y)[2], corner ? 1.0 : 0.0, 1e-5);
        }
}

/* By hand: beside a pixel of 2, one of 29 keeps 8 of it and its part of the rest, 21 / 25. A line stays as it is. */
static void neighbours_keep_what_is_theirs(void **state)
{
    float rgb[VALUES] = { 0.0f }, before[VALUES];
    (void)state;

    pixel(rgb, 4, 4)[1] = 29.0f;
    pixel(rgb, 5, 6)[1] = 2.0f;
    assert_int_equal(splats_spread(rgb, SIDE, SIDE), ERR_OK);
    assert_float_equal(pixel(rgb, 4, 4)[1], 8.0 + 21.0 / 25.0, 1e-5);
    assert_float_equal(pixel(rgb, 5, 6)[1], 2.0 + 21.0 / 25.0, 1e-5);
    assert_float_equal(sum_of(rgb, VALUES), 31.0, 1e-4);
    memset(rgb, 0, sizeof(rgb));
    for (uint32_t x = 0; x < SIDE; x++)
        pixel(rgb, x, 4)[0] = 10.0f;
    memcpy(before, rgb, sizeof(before));
    assert_int_equal(splats_spread(rgb, SIDE, SIDE), ERR_OK);
    assert_memory_equal(rgb, before, sizeof(before));
}

/* Four particles under a sun leave specks. Denoised, the image has the same light, and no pixel of it is a tenth as
 * bright. */
static void a_denoised_image_has_no_specks(void **state)
{
    struct stage s = stage_make(&(struct prepared_scene_desc){ .scene = RING, .width = WIDTH, .height = HEIGHT },
                                sky_with_sun(64, 32, 2e3f));
    struct relight_desc light = { .direct = { .method = METHOD_AUTO, .samples = 4 },
                                  .classes = PATH_CAUSTICS,
                                  .caustics = PLAN_LIGHT,
                                  .particles = 4 };
    double most[2] = { 0.0 }, sum[2];
    struct relight_stats stats;
    (void)state;

    s.set->facts.behind = 0; /* no eye paths behind glass, which find the sun by chance */
    for (int k = 0; k < 2; k++) {
        light.denoise = k == 1;
        assert_int_equal(stage_run(&s, &light, &stats), ERR_OK);
        sum[k] = sum_of(s.rgb, (size_t)3 * WIDTH * HEIGHT);
        for (size_t v = 0; v < (size_t)3 * WIDTH * HEIGHT; v++)
            most[k] = fmax(most[k], (double)s.rgb[v]);
    }
    print_message("brightest %.3g, denoised %.3g; sums %.4g, %.4g\n", most[0], most[1], sum[0], sum[1]);
    assert_true(most[1] < 0.1 * most[0]);
    assert_float_equal(sum[1] / sum[0], 1.0, 0.02);
    stage_finish(&s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_lone_splat_spreads),
    cmocka_unit_test(neighbours_keep_what_is_theirs),
    cmocka_unit_test(a_denoised_image_has_no_specks),
};
UNIT_MAIN(tests)
