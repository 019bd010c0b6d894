#include "image/film/film.h"

#include "base/luminance.h"
#include "base/rng.h"
#include "base/vec.h"
#include "light/frame/near.h"
#include "support/unit.h"

#include <float.h>
#include <math.h>
#include <omp.h>
#include <stdlib.h>

#define CURVES 3
#define RAMP_FIRST 0x1p-14f
#define RAMP_LAST 0x1p5f
#define RAMP_STRIDE 1009 /* floats between two steps: 158 thousand of them, 8300 an octave */
#define ROW 1000

static const enum tone_curve curves[CURVES] = { TONE_FILMIC, TONE_REINHARD, TONE_LINEAR };

static float float_of(uint32_t bits)
{
    float f;
    memcpy(&f, &bits, sizeof(f));
    return f;
}

static uint32_t bits_of(float f)
{
    uint32_t bits;
    memcpy(&bits, &f, sizeof(bits));
    return bits;
}

/* The exact formula: curve, transfer function, rounding. */
static int want_code(enum tone_curve curve, double x)
{
    return (int)floor(255.0 * srgb_encode(tone_value(curve, x)) + 0.5);
}

/* The code of one grey pixel. */
static int code(enum tone_curve curve, double gain, float grey)
{
    const float rgb[3] = { grey, grey, grey };
    uint8_t out[3];
    tone_map(rgb, 1, 1, &(struct tone_desc){ gain, curve, NULL }, out);
    assert_true(out[0] == out[1] && out[1] == out[2]);
    return out[0];
}

/* Calls `visit` with ROW grey values and their codes at a time, over the whole ramp. */
static void walk_ramp(enum tone_curve curve, void (*visit)(enum tone_curve, const float *, const uint8_t *, void *),
                      void *data)
{
    static float rgb[ROW][3];
    static uint8_t out[ROW][3];
    float grey[ROW];
    uint8_t got[ROW];

    for (uint32_t b = bits_of(RAMP_FIRST); b < bits_of(RAMP_LAST); b += ROW * RAMP_STRIDE) {
        for (uint32_t i = 0; i < ROW; i++) {
            grey[i] = float_of(b + i * RAMP_STRIDE);
            rgb[i][0] = rgb[i][1] = rgb[i][2] = grey[i];
        }
        tone_map(&rgb[0][0], ROW, 1, &(struct tone_desc){ 1.0, curve, NULL }, &out[0][0]);
        for (uint32_t i = 0; i < ROW; i++)
            got[i] = out[i][1];
        visit(curve, grey, got, data);
    }
}

struct tally {
    uint64_t count, differ;
    int worst, last;
};

static void compare(enum tone_curve curve, const float *grey, const uint8_t *got, void *data)
{
    struct tally *t = data;
    for (int i = 0; i < ROW; i++) {
        const int error = abs((int)got[i] - want_code(curve, (double)grey[i]));
        t->count++;
        t->differ += error != 0;
        t->worst = error > t->worst ? error : t->worst;
    }
}

static void ramp_is_the_exact_formula_but_for_one_code_in_a_hundred(void **state)
{
    (void)state;
    for (int c = 0; c < CURVES; c++) {
        struct tally t = { 0 };
        walk_ramp(curves[c], compare, &t);
        print_message("%s: %llu of %llu differ, by at most %d\n", choice_name(tone_choices, (int)curves[c]),
                      (unsigned long long)t.differ, (unsigned long long)t.count, t.worst);
        assert_true(t.count > 150000);
        assert_true(t.worst <= 1);
        assert_true(t.differ * 100 < t.count);
    }
}

static void rise(enum tone_curve curve, const float *grey, const uint8_t *got, void *data)
{
    struct tally *t = data;
    (void)curve;
    (void)grey;
    for (int i = 0; i < ROW; i++) {
        assert_true(got[i] >= t->last);
        assert_true(got[i] - t->last <= 1); /* no code is skipped either */
        t->last = got[i];
    }
}

static void ramp_never_falls_and_reaches_every_code(void **state)
{
    (void)state;
    for (int c = 0; c < CURVES; c++) {
        struct tally t = { 0 };
        walk_ramp(curves[c], rise, &t);
        assert_int_equal(t.last, 255);
    }
}

static void white_is_255_and_filmic_leaves_middle_grey(void **state)
{
    (void)state;
    assert_int_equal(code(TONE_FILMIC, 1.0, (float)TONE_WHITE * 1.002f), 255);
    assert_int_equal(code(TONE_REINHARD, 1.0, (float)TONE_WHITE), 255);
    assert_int_equal(code(TONE_LINEAR, 1.0, 1.0f), 255);
    assert_true(tone_value(TONE_FILMIC, 0.98 * TONE_WHITE) < 1.0);
    assert_near(tone_value(TONE_FILMIC, 0.18), 0.18, 1e-4);
    assert_near(tone_value(TONE_REINHARD, 1.0), 0.505, 1e-12);
}

static void gain_is_a_factor(void **state)
{
    (void)state;
    for (int c = 0; c < CURVES; c++)
        for (int stops = -20; stops <= 20; stops += 4)
            assert_int_equal(code(curves[c], ldexp(1.0, stops), ldexpf(0.3f, -stops)), code(curves[c], 1.0, 0.3f));
}

static void srgb_joins_its_two_pieces(void **state)
{
    (void)state;
    assert_near(srgb_encode(0.0), 0.0, 0.0);
    assert_near(srgb_encode(1.0), 1.0, 1e-12);
    assert_near(srgb_encode(0.0031308), srgb_encode(0.00313081), 1e-6);
    assert_near(srgb_encode(0.2140411), 0.5, 1e-6); /* half the signal is 21.4 % of the light */
}

static void odd_values_are_black_or_white(void **state)
{
    static const double gains[] = { 1.0, 1e-30, 1e30, 0.0, INFINITY, NAN, -1.0 };
    (void)state;

    for (int c = 0; c < CURVES; c++) {
        for (size_t g = 0; g < sizeof(gains) / sizeof(gains[0]); g++) {
            assert_int_equal(code(curves[c], gains[g], INFINITY), 255);
            assert_int_equal(code(curves[c], gains[g], NAN), 0);
            assert_int_equal(code(curves[c], gains[g], -1.0f), 0);
            assert_int_equal(code(curves[c], gains[g], -INFINITY), 0);
            assert_int_equal(code(curves[c], gains[g], -0.0f), 0);
        }
        assert_int_equal(code(curves[c], 1.0, FLT_MAX), 255);
        assert_int_equal(code(curves[c], 1e30, FLT_MAX), 255);
        assert_int_equal(code(curves[c], 1.0, 0x1p-149f), 0);
        assert_near(tone_value(curves[c], INFINITY), 1.0, 0.0);
        assert_near(tone_value(curves[c], NAN), 0.0, 0.0);
    }
}

static void one_odd_channel_leaves_the_others(void **state)
{
    const float rgb[2][3] = { { INFINITY, 0.5f, NAN }, { NAN, -1.0f, 0.5f } };
    uint8_t out[2][3];
    (void)state;

    tone_map(&rgb[0][0], 2, 1, &(struct tone_desc){ 1.0, TONE_FILMIC, NULL }, &out[0][0]);
    const uint8_t half = (uint8_t)want_code(TONE_FILMIC, 0.5);
    const uint8_t want[2][3] = { { 255, half, 0 }, { 0, 0, half } };
    assert_memory_equal(out, want, sizeof(want));
}

/* Reinhard's operator on the luminance alone: a colour keeps its ratios, and its luminance is what the curve says. */
static void reinhard_keeps_the_ratios_of_a_colour(void **state)
{
    const float rgb[3] = { 0.9f, 0.45f, 0.225f };
    const double l = (double)rgb_luminance(rgb[0], rgb[1], rgb[2]);
    uint8_t out[3];
    (void)state;

    tone_map(rgb, 1, 1, &(struct tone_desc){ 1.0, TONE_REINHARD, NULL }, out);
    for (int k = 0; k < 3; k++) {
        const double want = srgb_encode((double)rgb[k] * tone_value(TONE_REINHARD, l) / l);
        assert_true(fabs(255.0 * want - out[k]) <= 1.0);
    }
}

static void every_size_fills_its_bytes_and_no_more(void **state)
{
    static float rgb[2100 * 3];
    static uint8_t out[2100 * 3 + 8];
    (void)state;

    for (size_t i = 0; i < 2100 * 3; i++)
        rgb[i] = 5.0f;
    for (uint32_t width = 1; width <= 2100; width += width < 520 ? 1 : 37) {
        memset(out, 77, sizeof(out));
        tone_map(rgb, width, 1, &(struct tone_desc){ 1.0, TONE_LINEAR, NULL }, out);
        for (size_t i = 0; i < sizeof(out); i++)
            assert_int_equal(out[i], i < 3 * (size_t)width ? 255 : 77);
        assert_int_equal(out[3 * width], 77);
    }
}

static void image_has_the_same_bytes_at_any_thread_count(void **state)
{
    enum { SIDE = 83 };
    static float rgb[SIDE * SIDE * 3];
    static uint8_t want[sizeof(rgb) / sizeof(rgb[0])], got[sizeof(want)];
    struct rng r = { 3 };
    (void)state;

    for (size_t i = 0; i < SIDE * SIDE * 3; i++)
        rgb[i] = (float)exp2(14.0 * rng_next(&r) - 9.0);
    for (int c = 0; c < CURVES; c++) {
        omp_set_num_threads(1);
        tone_map(rgb, SIDE, SIDE, &(struct tone_desc){ 0.7, curves[c], NULL }, want);
        for (int n = 2; n <= 5; n++) {
            omp_set_num_threads(n);
            tone_map(rgb, SIDE, SIDE, &(struct tone_desc){ 0.7, curves[c], NULL }, got);
            assert_memory_equal(got, want, sizeof(want));
        }
    }
}

/* 16 bits are the exact formula, so that 8 are within one of them; a fourth channel is no light. */
static void sixteen_bits_are_eight_made_finer(void **state)
{
    enum { COUNT = 4096 };
    static float rgb[3 * COUNT], rgba[4 * COUNT];
    static uint8_t want[3 * COUNT];
    static uint16_t got[3 * COUNT], with[4 * COUNT];
    struct rng r = { 3 };
    (void)state;

    for (size_t i = 0; i < 3 * COUNT; i++)
        rgb[i] = i < 6 ? (i < 3 ? NAN : INFINITY) : (float)exp2(14.0 * rng_next(&r) - 9.0);
    for (size_t i = 0; i < COUNT; i++) {
        memcpy(rgba + 4 * i, rgb + 3 * i, 3 * sizeof(float));
        rgba[4 * i + 3] = (float)i / (COUNT - 1);
    }
    for (int c = 0; c < CURVES; c++) {
        const struct tone_desc desc = { 0.7, curves[c], NULL };
        tone_map(rgb, COUNT, 1, &desc, want);
        tone_map_deep(rgb, COUNT, 1, 3, &desc, got);
        tone_map_deep(rgba, COUNT, 1, 4, &desc, with);
        for (size_t i = 0; i < 3 * COUNT; i++)
            assert_true(fabs(got[i] / 257.0 - want[i]) < 1.01);
        for (size_t i = 0; i < COUNT; i++) {
            assert_memory_equal(with + 4 * i, got + 3 * i, 3 * sizeof(*got));
            assert_int_equal(with[4 * i + 3], lrint(65535.0 * (double)i / (COUNT - 1)));
        }
    }
}

static void names_are_parsed_and_others_refused(void **state)
{
    int c;
    struct reason why = { "" };
    (void)state;

    for (int i = 0; i < CURVES; i++) {
        assert_int_equal(choice_parse(tone_choices, 0, "tone", choice_name(tone_choices, (int)curves[i]), &c, &why),
                         ERR_OK);
        assert_int_equal(c, curves[i]);
    }
    assert_int_equal(choice_parse(tone_choices, 0, "tone", "aces", &c, &why), ERR_USAGE);
    assert_non_null(strstr(why.text, "'aces'"));
}

/* Table 4 of BT.2100 by hand, and white, grey and red of Rec.709 in Rec.2020 [BT.2087]. */
static void pq_is_that_of_the_standard(void **state)
{
    static const float light[6][3] = { { 1, 1, 1 }, { 100, 100, 100 }, { 0, 0, 0 },
                                       { 1, 0, 0 }, { -1, NAN, 0 },    { INFINITY, 1, 1 } };
    uint16_t out[6][3];
    (void)state;

    assert_float_equal(tone_pq(0.0), 7.3e-7, 1e-7);
    assert_float_equal(tone_pq(100.0), 0.5081, 1e-4);
    assert_float_equal(tone_pq(203.0), 0.5807, 1e-4);
    assert_float_equal(tone_pq(1000.0), 0.7518, 1e-4);
    assert_float_equal(tone_pq(10000.0), 1.0, 1e-12);
    tone_map_pq(&light[0][0], 6, 1, 1.0, &out[0][0]);
    for (int c = 0; c < 3; c++) {
        static const double red[3] = { 0.6274, 0.0691, 0.0164 };
        assert_true(abs((int)out[0][c] - (int)lrint(65535.0 * tone_pq(203.0))) <= 2);
        assert_true(abs((int)out[1][c] - (int)lrint(65535.0 * tone_pq(1000.0))) <= 2);
        assert_int_equal(out[2][c], 0);
        assert_true(abs((int)out[3][c] - (int)lrint(65535.0 * tone_pq(203.0 * red[c]))) <= 2);
        assert_int_equal(out[4][c], 0);
        assert_true(abs((int)out[5][c] - (int)lrint(65535.0 * tone_pq(1000.0))) <= 2);
    }
}

/* The ends and the middle of the scale, by green light, whose luminance is 0.7152 of its value. */
static void false_colour_shows_luminance(void **state)
{
    static const float y[5] = { 0.001f, 0.01f, 0.31622777f, 10.0f, INFINITY };
    static const uint8_t want[5][3] = {
        { 18, 12, 60 }, { 18, 12, 60 }, { 62, 184, 110 }, { 206, 44, 44 }, { 206, 44, 44 }
    };
    float rgb[5][3] = { { 0.0f } };
    uint8_t out[5][3];
    uint16_t deep[5][3];
    const struct tone_desc d = { 0.25, TONE_FALSE_COLOUR, NULL };

    (void)state;
    for (int k = 0; k < 5; k++)
        rgb[k][1] = y[k] * 4.0f / 0.7152f;
    tone_map(&rgb[0][0], 5, 1, &d, &out[0][0]);
    tone_map_deep(&rgb[0][0], 5, 1, 3, &d, &deep[0][0]);
    for (int k = 0; k < 5; k++)
        for (int c = 0; c < 3; c++) {
            assert_true(abs((int)out[k][c] - want[k][c]) <= 1);
            assert_true(abs((int)deep[k][c] - 257 * out[k][c]) <= 1);
        }
    rgb[0][0] = NAN;
    tone_map(&rgb[0][0], 1, 1, &d, &out[0][0]);
    assert_int_equal(out[0][2], 60);
}

/* The colours at eighths, which the page's legend draws too (clients/web/daylight_model.js), and halfway between two.
 */
static void false_colour_passes_its_stops(void **state)
{
    static const uint8_t want[9][3] = { { 18, 12, 60 },   { 42, 42, 134 },  { 24, 96, 172 },
                                        { 18, 146, 160 }, { 62, 184, 110 }, { 160, 212, 60 },
                                        { 248, 222, 60 }, { 246, 150, 46 }, { 206, 44, 44 } };
    uint8_t rgb[3];

    (void)state;
    for (int k = 0; k < 9; k++) {
        false_colour(k / 8.0, rgb);
        assert_memory_equal(rgb, want[k], 3);
    }
    false_colour(1.0 / 16.0, rgb);
    assert_memory_equal(rgb, ((const uint8_t[]){ 30, 27, 97 }), 3);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(false_colour_passes_its_stops),
    cmocka_unit_test(ramp_is_the_exact_formula_but_for_one_code_in_a_hundred),
    cmocka_unit_test(ramp_never_falls_and_reaches_every_code),
    cmocka_unit_test(white_is_255_and_filmic_leaves_middle_grey),
    cmocka_unit_test(gain_is_a_factor),
    cmocka_unit_test(srgb_joins_its_two_pieces),
    cmocka_unit_test(odd_values_are_black_or_white),
    cmocka_unit_test(one_odd_channel_leaves_the_others),
    cmocka_unit_test(reinhard_keeps_the_ratios_of_a_colour),
    cmocka_unit_test(every_size_fills_its_bytes_and_no_more),
    cmocka_unit_test(image_has_the_same_bytes_at_any_thread_count),
    cmocka_unit_test(sixteen_bits_are_eight_made_finer),
    cmocka_unit_test(names_are_parsed_and_others_refused),
    cmocka_unit_test(pq_is_that_of_the_standard),
    cmocka_unit_test(false_colour_shows_luminance),
};

UNIT_MAIN(tests)
