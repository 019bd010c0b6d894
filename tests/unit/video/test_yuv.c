#include "video/yuv.h"

#include "support/unit.h"

#include <math.h>
#include <stdbool.h>

/* One square of four pixels. */
static void convert(const uint8_t rgb[4][3], uint8_t y[4], uint8_t *cb, uint8_t *cr)
{
    uint8_t pixels[2][2][3];

    memcpy(pixels, rgb, sizeof(pixels));
    yuv_from_rgb(&pixels[0][0][0], 2, 2, &(struct yuv_planes){ y, cb, cr, 2, 1, 1 });
}

static void greys_have_no_colour_and_keep_their_value(void **state)
{
    (void)state;
    for (int v = 0; v < 256; v++) {
        uint8_t rgb[4][3], y[4], cb, cr;
        memset(rgb, v, sizeof(rgb));
        convert(rgb, y, &cb, &cr);
        for (int i = 0; i < 4; i++)
            assert_int_equal(y[i], v);
        assert_int_equal(cb, 128);
        assert_int_equal(cr, 128);
    }
}

/* The standard's own numbers, in double precision: nothing is off by more than rounding, and 2^-16 for the weights. */
static void colours_are_those_of_the_standard(void **state)
{
    uint32_t seed = 1;
    (void)state;
    for (int n = 0; n < 20000; n++) {
        uint8_t rgb[4][3], y[4], cb, cr;
        double mean[3] = { 0.0 };
        for (int i = 0; i < 12; i++) {
            seed = seed * 1664525u + 1013904223u;
            rgb[i / 3][i % 3] =
                n < 8 ? (n >> i % 3 & 1) * 255 : (uint8_t)(seed >> 24); /* the corners of the cube first */
            mean[i % 3] += rgb[i / 3][i % 3] / 4.0;
        }
        convert(rgb, y, &cb, &cr);
        for (int i = 0; i < 4; i++) {
            const double want = 0.2126 * rgb[i][0] + 0.7152 * rgb[i][1] + 0.0722 * rgb[i][2];
            assert_true(fabs(y[i] - want) <= 0.51);
        }
        const double luma = 0.2126 * mean[0] + 0.7152 * mean[1] + 0.0722 * mean[2];
        assert_true(fabs(cb - fmin(128.0 + (mean[2] - luma) / 1.8556, 255.0)) <= 0.51);
        assert_true(fabs(cr - fmin(128.0 + (mean[0] - luma) / 1.5748, 255.0)) <= 0.51);
    }
}

static void odd_sides_repeat_their_last_pixel_and_nothing_is_written_beyond(void **state)
{
    enum { PITCH = 8 };
    uint8_t rgb[3][5][3], y[5 * PITCH], cb[3 * PITCH], cr[3 * PITCH];
    (void)state;

    for (int j = 0; j < 3; j++)
        for (int i = 0; i < 5; i++)
            memset(rgb[j][i], 10 + 50 * j + 7 * i, 3);
    memset(y, 1, sizeof(y));
    memset(cb, 1, sizeof(cb));
    memset(cr, 1, sizeof(cr));
    yuv_from_rgb(&rgb[0][0][0], 5, 3, &(struct yuv_planes){ y, cb, cr, PITCH, PITCH, PITCH });
    for (int j = 0; j < 5; j++)
        for (int i = 0; i < PITCH; i++) {
            const bool in = j < 4 && i < 6, half = j < 2 && i < 3;
            assert_int_equal(y[j * PITCH + i], in ? rgb[j < 3 ? j : 2][i < 5 ? i : 4][0] : 1);
            if (j < 3) {
                assert_int_equal(cb[j * PITCH + i], half ? 128 : 1);
                assert_int_equal(cr[j * PITCH + i], half ? 128 : 1);
            }
        }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(greys_have_no_colour_and_keep_their_value),
    cmocka_unit_test(colours_are_those_of_the_standard),
    cmocka_unit_test(odd_sides_repeat_their_last_pixel_and_nothing_is_written_beyond),
};
UNIT_MAIN(tests)
