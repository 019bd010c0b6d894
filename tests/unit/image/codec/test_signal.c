/* From code values to light: range, matrix, transfer function and primaries, each against the numbers of its standard.
 */
#include "support/unit.h"

#include "image/codec/signal.h"

#include <math.h>

enum { BT709 = 1, UNSTATED = 2, LINEAR = 8 };

static const struct signal_desc plain = { .primaries = BT709, .transfer = LINEAR, .matrix = BT709, .depth = 8 };

static void convert(const struct signal_desc *d, float a, float b, float c, float rgb[3])
{
    static struct signal s;
    struct reason why;

    if (signal_prepare(d, "picture", &s, &why))
        fail_msg("%s", why.text);
    signal_row(&s, &a, &b, &c, 1, rgb);
}

static void must_be(const struct signal_desc *d, const float code[3], const double want[3], double tolerance)
{
    float rgb[3];

    convert(d, code[0], code[1], code[2], rgb);
    for (int c = 0; c < 3; c++)
        if (!(fabs((double)rgb[c] - want[c]) <= tolerance))
            fail_msg("component %d is %.4f, not %.4f", c, (double)rgb[c], want[c]);
}

/* White and black of narrow range lie at 16 and 235, of 10 bits at 64 and 940, of 16 at 4096 and 60160. */
static void black_and_white_lie_where_the_range_puts_them(void **state)
{
    static const struct {
        uint32_t depth;
        bool full;
        float black, white, none;
    } rows[] = { { 8, false, 16, 235, 128 },        { 10, false, 64, 940, 512 }, { 12, false, 256, 3760, 2048 },
                 { 16, false, 4096, 60160, 32768 }, { 8, true, 0, 255, 128 },    { 10, true, 0, 1023, 512 } };
    (void)state;

    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        struct signal_desc d = plain;
        d.depth = rows[i].depth;
        d.full_range = rows[i].full;
        must_be(&d, (const float[]){ rows[i].black, rows[i].none, rows[i].none }, (const double[]){ 0, 0, 0 }, 0.01);
        must_be(&d, (const float[]){ rows[i].white, rows[i].none, rows[i].none }, (const double[]){ 203, 203, 203 },
                0.05);
        d.rgb = true;
        must_be(&d, (const float[]){ rows[i].black, rows[i].white, rows[i].black }, (const double[]){ 0, 203, 0 },
                0.05);
    }
}

/* Y' = Kr R' + Kg G' + Kb B', Cb = (B' - Y') / (2 - 2 Kb), Cr = (R' - Y') / (2 - 2 Kr) [H.273, Table 4]: a colour coded
 * by these comes back. */
static void each_matrix_is_undone(void **state)
{
    static const struct {
        uint8_t code;
        double red, blue;
    } rows[] = { { 1, 0.2126, 0.0722 }, { 2, 0.299, 0.114 }, { 4, 0.3, 0.11 },     { 5, 0.299, 0.114 },
                 { 6, 0.299, 0.114 },   { 7, 0.212, 0.087 }, { 9, 0.2627, 0.0593 } };
    static const double colours[4][3] = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 }, { 0.8, 0.3, 0.5 } };
    (void)state;

    for (size_t i = 0; i < 4 * sizeof(rows) / sizeof(rows[0]); i++) {
        const double *c = colours[i % 4], red = rows[i / 4].red, blue = rows[i / 4].blue;
        const double y = red * c[0] + (1.0 - red - blue) * c[1] + blue * c[2];
        const float code[3] = { (float)(16.0 + 219.0 * y), (float)(128.0 + 224.0 * (c[2] - y) / (2.0 - 2.0 * blue)),
                                (float)(128.0 + 224.0 * (c[0] - y) / (2.0 - 2.0 * red)) };
        struct signal_desc d = plain;
        d.matrix = rows[i / 4].code;
        must_be(&d, code, (const double[]){ 203.0 * c[0], 203.0 * c[1], 203.0 * c[2] }, 0.01);
    }
}

/* Grey R'G'B' of a full range of 16 bits. */
static double light_of(struct signal_desc d, double signal)
{
    const float v = (float)(signal * 65535.0);
    float rgb[3];

    d.depth = 16;
    d.full_range = d.rgb = true;
    convert(&d, v, v, v, rgb);
    assert_true(fabsf(rgb[0] - rgb[1]) <= 1e-4f * rgb[0] && fabsf(rgb[0] - rgb[2]) <= 1e-4f * rgb[0]);
    return (double)rgb[0];
}

/* The points of PQ and HLG are those that ITU-R BT.2408 tabulates: of HLG, 75 % is the white of 203 on a display of
 * 1000. */
static void each_curve_has_its_points(void **state)
{
    static const struct {
        uint8_t code;
        double signal, light;
    } rows[] = {
        { 13, 0.04, 203.0 * 0.0030960 },
        { 13, 0.5, 203.0 * 0.2140411 },
        { 13, 1.0, 203.0 },
        { 1, 0.5, 203.0 * 0.1894646 },
        { 6, 0.5, 203.0 * 0.1894646 },
        { 7, 0.5, 203.0 * 0.1894646 },
        { 11, 0.5, 203.0 * 0.1894646 },
        { 12, 0.5, 203.0 * 0.1894646 },
        { 14, 0.5, 203.0 * 0.1894646 },
        { 15, 0.5, 203.0 * 0.1894646 },
        { 4, 0.5, 203.0 * 0.2176376 },
        { 5, 0.5, 203.0 * 0.1435873 },
        { 8, 0.5, 203.0 * 0.5 },
        { 8, 1.05, 203.0 * 1.05 },
        { 8, 1.2, 203.0 * 1.1 },
        { 16, 0.0, 0.0 },
        { 16, 0.150, 1.0 },
        { 16, 0.50808, 100.0 },
        { 16, 0.58069, 203.0 },
        { 16, 0.75183, 1000.0 },
        { 16, 1.0, 10000.0 },
        { 18, 0.5, 50.70 },
        { 18, 0.75, 203.2 },
        { 18, 1.0, 1000.0 },
        { 18, 0.25, 9.606 },
    };
    (void)state;

    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        struct signal_desc d = plain;
        d.transfer = rows[i].code;
        const double got = light_of(d, rows[i].signal);
        if (!(fabs(got - rows[i].light) <= 0.002 * rows[i].light + 1e-5))
            fail_msg("transfer function %d at %g: %.5g, not %.5g", rows[i].code, rows[i].signal, got, rows[i].light);
    }
}

static void a_stated_curve_is_overridden_and_a_missing_one_assumed(void **state)
{
    static struct signal s;
    struct signal_desc d = plain;
    struct reason why;
    (void)state;

    d.transfer = UNSTATED;
    assert_int_equal(signal_prepare(&d, "picture", &s, &why), ERR_OK);
    assert_true(s.transfer_assumed && s.transfer == SIGNAL_BT1886);
    d.rgb = true;
    assert_int_equal(signal_prepare(&d, "picture", &s, &why), ERR_OK);
    assert_true(s.transfer_assumed && s.transfer == SIGNAL_SRGB);
    d.override = SIGNAL_PQ;
    assert_int_equal(signal_prepare(&d, "picture", &s, &why), ERR_OK);
    assert_true(!s.transfer_assumed && s.transfer == SIGNAL_PQ);
    d.override = SIGNAL_AUTO;
    d.transfer = 16;
    assert_int_equal(signal_prepare(&d, "picture", &s, &why), ERR_OK);
    assert_true(!s.transfer_assumed && s.transfer == SIGNAL_PQ);
}

/* White's luminance, PQ's clip, and the system gamma 1.2 + 0.42 log10(peak / 1000) of HLG, which a bright colour has
 * from its luminance. */
static void a_peak_is_honoured_by_each_kind(void **state)
{
    struct signal_desc d = plain;
    (void)state;

    d.peak_cdm2 = 500.0;
    assert_true(fabs(light_of(d, 0.5) - 250.0) < 0.05);
    d.transfer = 16;
    assert_true(fabs(light_of(d, 0.75183) - 500.0) < 0.5);
    assert_true(fabs(light_of(d, 0.50808) - 100.0) < 0.2);
    d.transfer = 18;
    d.peak_cdm2 = 2000.0;
    const double scene = 0.264963, gamma = 1.2 + 0.42 * 0.30103;
    assert_true(fabs(light_of(d, 0.75) / (2000.0 * pow(scene, gamma)) - 1.0) < 0.002);
    /* Green alone, of BT.709's luminance 0.7152. */
    d.depth = 8;
    d.full_range = d.rgb = true;
    must_be(&d, (const float[]){ 0, 255, 0 }, (const double[]){ 0, 2000.0 * pow(0.7152, gamma - 1.0), 0 }, 2.0);
}

/* Rec.709 back to x and y of a primary alone: those of H.273, Table 2. */
static void primaries_keep_their_chromaticities(void **state)
{
    static const double xyz[9] = { 0.4123908, 0.3575843, 0.1804808, 0.2126390, 0.7151687,
                                   0.0721923, 0.0193308, 0.1191948, 0.9505322 };
    static const struct {
        uint8_t code;
        double xy[3][2];
    } rows[] = { { 1, { { 0.64, 0.33 }, { 0.3, 0.6 }, { 0.15, 0.06 } } },
                 { 2, { { 0.64, 0.33 }, { 0.3, 0.6 }, { 0.15, 0.06 } } },
                 { 5, { { 0.64, 0.33 }, { 0.29, 0.6 }, { 0.15, 0.06 } } },
                 { 6, { { 0.63, 0.34 }, { 0.31, 0.595 }, { 0.155, 0.07 } } },
                 { 7, { { 0.63, 0.34 }, { 0.31, 0.595 }, { 0.155, 0.07 } } },
                 { 9, { { 0.708, 0.292 }, { 0.17, 0.797 }, { 0.131, 0.046 } } },
                 { 12, { { 0.68, 0.32 }, { 0.265, 0.69 }, { 0.15, 0.06 } } } };
    (void)state;

    for (size_t i = 0; i < 3 * sizeof(rows) / sizeof(rows[0]); i++) {
        struct signal_desc d = plain;
        float rgb[3];
        double v[3];
        d.primaries = rows[i / 3].code;
        d.rgb = d.full_range = true;
        convert(&d, i % 3 == 0 ? 255 : 0, i % 3 == 1 ? 255 : 0, i % 3 == 2 ? 255 : 0, rgb);
        for (int k = 0; k < 3; k++)
            v[k] = xyz[3 * k] * (double)rgb[0] + xyz[3 * k + 1] * (double)rgb[1] + xyz[3 * k + 2] * (double)rgb[2];
        for (int k = 0; k < 2; k++)
            if (fabs(v[k] / (v[0] + v[1] + v[2]) - rows[i / 3].xy[i % 3][k]) > 5e-4)
                fail_msg("primary %zu of %d lies elsewhere: %.4f, %.4f", i % 3, rows[i / 3].code,
                         v[0] / (v[0] + v[1] + v[2]), v[1] / (v[0] + v[1] + v[2]));
    }
}

/* Also of primaries whose white is not D65. */
static void white_stays_white_under_all_primaries(void **state)
{
    static const uint8_t codes[] = { 1, 2, 4, 5, 6, 7, 9, 11, 12 };
    (void)state;

    for (size_t i = 0; i < sizeof(codes); i++) {
        struct signal_desc d = plain;
        d.primaries = codes[i];
        must_be(&d, (const float[]){ 235, 128, 128 }, (const double[]){ 203, 203, 203 }, 0.2);
    }
}

static void what_is_not_known_is_refused_by_name(void **state)
{
    static const struct {
        struct signal_desc d;
        const char *about;
    } rows[] = {
        { { .primaries = 8, .transfer = 1, .matrix = 1, .depth = 8 }, "primaries (number 8" },
        { { .primaries = 1, .transfer = 9, .matrix = 1, .depth = 8 }, "transfer function (number 9" },
        { { .primaries = 1, .transfer = 1, .matrix = 10, .depth = 8 }, "matrix (number 10" },
        { { .primaries = 1, .transfer = 1, .matrix = 1, .depth = 7 }, "7 bits" },
        { { .primaries = 1, .transfer = 1, .matrix = 1, .depth = 17 }, "17 bits" },
    };
    static struct signal s;
    struct signal_desc d = plain;
    struct reason why;
    (void)state;

    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        assert_int_equal(signal_prepare(&rows[i].d, "clip.mp4", &s, &why), ERR_UNSUPPORTED);
        assert_ptr_equal(strstr(why.text, "clip.mp4: "), why.text);
        assert_non_null(strstr(why.text, rows[i].about));
    }
    d.matrix = 0; /* the components are R', G' and B' */
    must_be(&d, (const float[]){ 16, 235, 16 }, (const double[]){ 0, 203, 0 }, 0.05);
    assert_string_equal(signal_transfer_name(SIGNAL_HLG), "hlg");
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(black_and_white_lie_where_the_range_puts_them),
    cmocka_unit_test(each_matrix_is_undone),
    cmocka_unit_test(each_curve_has_its_points),
    cmocka_unit_test(a_stated_curve_is_overridden_and_a_missing_one_assumed),
    cmocka_unit_test(a_peak_is_honoured_by_each_kind),
    cmocka_unit_test(primaries_keep_their_chromaticities),
    cmocka_unit_test(white_stays_white_under_all_primaries),
    cmocka_unit_test(what_is_not_known_is_refused_by_name),
};
UNIT_MAIN(tests)
