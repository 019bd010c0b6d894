#include "image/video/yuv.h"

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

/* Limited range by the standards' own numbers: 16 to 235 and 128 +- 112, times 4 with 10 bits. */
static void limited_range_is_that_of_the_standards(void **state)
{
    static const double weights[2][3] = { { 0.2126, 0.7152, 0.0722 }, { 0.2627, 0.6780, 0.0593 } };
    (void)state;

    for (int pq = 0; pq < 2; pq++)
        for (int n = 0; n < 8; n++) { /* the corners of the cube, and a grey of 1/4 for black */
            uint16_t rgb[4][3], luma[4] = { 0 }, cb[1] = { 0 }, cr[1] = { 0 };
            double value[3], y = 0.0;
            for (int c = 0; c < 3; c++) {
                value[c] = n == 0 ? 0.25 : n >> c & 1;
                y += weights[pq][c] * value[c];
                for (int i = 0; i < 4; i++)
                    rgb[i][c] = (uint16_t)(65535.0 * value[c]);
            }
            const int wide = pq ? 2 : 1;
            yuv_limited_from_rgb(
                &rgb[0][0], 2, 2, pq,
                &(struct yuv_planes){ (uint8_t *)luma, (uint8_t *)cb, (uint8_t *)cr, 2 * wide, wide, wide });
            const double step = pq ? 4.0 : 1.0, blue = (value[2] - y) / (2.0 * (1.0 - weights[pq][2])),
                         red = (value[0] - y) / (2.0 * (1.0 - weights[pq][0]));
            for (int i = 0; i < 4; i++)
                assert_true(fabs((pq ? luma[i] : ((uint8_t *)luma)[i]) - step * (16.0 + 219.0 * y)) <= 0.51);
            assert_true(fabs((pq ? cb[0] : ((uint8_t *)cb)[0]) - step * (128.0 + 224.0 * blue)) <= 0.51);
            assert_true(fabs((pq ? cr[0] : ((uint8_t *)cr)[0]) - step * (128.0 + 224.0 * red)) <= 0.51);
        }
}

/* Chroma lies on even columns: of a red column x = 2 a half each belongs to it, and a quarter of x = 1 and x = 3 to
 * either neighbour. */
static void chroma_lies_on_even_columns(void **state)
{
    uint16_t rgb[2][6][3] = { { { 0 } } };
    uint8_t y[12], cb[3], cr[3];
    const struct yuv_planes planes = { y, cb, cr, 6, 3, 3 };
    (void)state;

    rgb[0][2][0] = rgb[1][2][0] = 65535;
    yuv_limited_from_rgb(&rgb[0][0][0], 6, 2, false, &planes);
    assert_int_equal(cr[0], 128);
    assert_int_equal(cr[1], 128 + 56);
    assert_int_equal(cr[2], 128);
    rgb[0][2][0] = rgb[1][2][0] = 0;
    rgb[0][1][0] = rgb[1][1][0] = 65535;
    yuv_limited_from_rgb(&rgb[0][0][0], 6, 2, false, &planes);
    assert_int_equal(cr[0], 128 + 28);
    assert_int_equal(cr[1], 128 + 28);
    assert_int_equal(cr[2], 128);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(greys_have_no_colour_and_keep_their_value),
    cmocka_unit_test(colours_are_those_of_the_standard),
    cmocka_unit_test(odd_sides_repeat_their_last_pixel_and_nothing_is_written_beyond),
    cmocka_unit_test(limited_range_is_that_of_the_standards),
    cmocka_unit_test(chroma_lies_on_even_columns),
};
UNIT_MAIN(tests)
