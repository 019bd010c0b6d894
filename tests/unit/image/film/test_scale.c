#include "base/luminance.h"
#include "image/film/film.h"

#include "support/unit.h"

#include <math.h>

#define W 61
#define H 37

/* The share of [a, a + 1) within [from, to). */
static double share(double a, double from, double to)
{
    return fmax(0.0, fmin(to, a + 1.0) - fmax(from, a));
}

static void each_pixel_is_the_mean_of_its_area(void **state)
{
    (void)state;
    static const uint32_t sizes[][2] = { { 61, 37 }, { 60, 36 }, { 17, 11 }, { 16, 10 }, { 1, 1 }, { 61, 1 } };
    static float from[3 * W * H], to[3 * W * H];

    for (int i = 0; i < 3 * W * H; i++)
        from[i] = (float)(i * 7919 % 1000) * (i % 50 == 0 ? 100.0f : 0.01f);
    for (size_t k = 0; k < sizeof(sizes) / sizeof(sizes[0]); k++) {
        const uint32_t w = sizes[k][0], h = sizes[k][1];
        const double step_x = (double)W / w, step_y = (double)H / h;
        scale_linear(from, W, H, to, w, h);
        for (uint32_t i = 0; i < 3 * w * h; i++) {
            const uint32_t x = i / 3 % w, y = i / 3 / w;
            double want = 0.0;
            for (int j = 0; j < W * H; j++)
                want += share(j % W, x * step_x, (x + 1) * step_x) * share(j / W, y * step_y, (y + 1) * step_y) *
                        (double)from[3 * j + (int)(i % 3)];
            want /= step_x * step_y;
            assert_true(fabs((double)to[i] - want) <= 1e-5 * want + 1e-6);
        }
    }
}

/* A checkerboard of black and white is half as bright as white, which is code 188 and not 128. */
static void light_is_averaged_before_it_is_encoded(void **state)
{
    (void)state;
    static float from[3 * 64 * 32], to[3 * 64 * 32];

    for (int i = 0; i < 3 * 64 * 32; i++)
        from[i] = (i / 3 % 64 + i / 3 / 64) % 2 ? 1.0f : 0.0f;
    scale_linear(from, 64, 32, to, 32, 16);
    for (int i = 0; i < 3 * 32 * 16; i++)
        assert_int_equal(lround(255.0 * srgb_encode((double)to[i])), 188);
    for (int i = 0; i < 3 * 64 * 32; i++)
        from[i] = (float)srgb_decode(i * 31 % 256 / 255.0);
    scale_linear(from, 64, 32, to, 64, 32); /* the same size: nothing changes */
    assert_memory_equal(from, to, sizeof(from));
    scale_linear(from, 64, 32, to, 1, 1);
    for (int c = 0; c < 3; c++) {
        double mean = 0.0;
        for (int i = 0; i < 64 * 32; i++)
            mean += (double)from[3 * i + c] / (64 * 32);
        assert_true(fabs((double)to[c] - mean) <= 1e-6);
    }
}

static void height_keeps_the_aspect_ratio(void **state)
{
    (void)state;
    assert_int_equal(scale_height(1920, 1080, 640), 360);
    assert_int_equal(scale_height(960, 540, 100), 56);
    assert_int_equal(scale_height(1920, 1080, 1920), 1080);
    assert_int_equal(scale_height(16384, 16, 16), 1);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(each_pixel_is_the_mean_of_its_area),
    cmocka_unit_test(light_is_averaged_before_it_is_encoded),
    cmocka_unit_test(height_keeps_the_aspect_ratio),
};
UNIT_MAIN(tests)
