/* Matrices between spaces of colours, held against published ones. */
#include "support/unit.h"

#include "image/codec/primaries.h"
#include "image/codec/signal.h"

#include <math.h>

static const struct chromaticities rec2020 = { /* [ITU-R BT.2020-2] */
                                               { 0.708, 0.292 },
                                               { 0.170, 0.797 },
                                               { 0.131, 0.046 },
                                               { 0.3127, 0.3290 }
};
static const struct chromaticities p3_d65 = { /* [SMPTE EG 432-1] */
                                              { 0.680, 0.320 },
                                              { 0.265, 0.690 },
                                              { 0.150, 0.060 },
                                              { 0.3127, 0.3290 }
};
static const struct chromaticities aces_ap0 = { /* [SMPTE ST 2065-1] */
                                                { 0.7347, 0.2653 },
                                                { 0.0000, 1.0000 },
                                                { 0.0001, -0.0770 },
                                                { 0.32168, 0.33767 }
};
static const struct chromaticities aces_ap1 = { /* [Academy S-2014-004] */
                                                { 0.713, 0.293 },
                                                { 0.165, 0.830 },
                                                { 0.128, 0.044 },
                                                { 0.32168, 0.33767 }
};

static void must_be(const struct chromaticities *from, const double want[9], double tolerance)
{
    double m[9];

    assert_int_equal(colour_to_rec709(from, m), ERR_OK);
    for (int i = 0; i < 9; i++)
        if (!(fabs(m[i] - want[i]) <= tolerance))
            fail_msg("element %d is %.6f, not %.6f", i, m[i], want[i]);
}

static void rec709_is_itself(void **state)
{
    static const double identity[9] = { 1, 0, 0, 0, 1, 0, 0, 0, 1 };
    (void)state;

    must_be(&colour_rec709, identity, 1e-14);
}

static void published_matrices_are_met(void **state)
{
    static const double of_2020[9] = { /* [ITU-R BT.2407-0] */
                                       1.6605, -0.5876, -0.0728, -0.1246, 1.1329, -0.0083, -0.0182, -0.1006, 1.1187
    };
    static const double of_p3[9] = { 1.2249, -0.2249, 0.0, -0.0421, 1.0421, 0.0, -0.0196, -0.0786, 1.0983 };
    /* white D60 to D65 by Bradford, as ACES' own conversions to Rec.709 have it */
    static const double of_ap1[9] = { 1.7051, -0.6218, -0.0833, -0.1303, 1.1408, -0.0105, -0.0240, -0.1290, 1.1530 };
    static const double of_ap0[9] = { 2.5217, -1.1341, -0.3876, -0.2765, 1.3727, -0.0962, -0.0154, -0.1530, 1.1684 };
    (void)state;

    must_be(&rec2020, of_2020, 1e-4);
    must_be(&p3_d65, of_p3, 1e-4);
    must_be(&aces_ap1, of_ap1, 1e-3);
    must_be(&aces_ap0, of_ap0, 1e-3);
}

static void white_stays_white(void **state)
{
    const struct chromaticities *const spaces[] = { &colour_rec709, &rec2020, &p3_d65, &aces_ap0, &aces_ap1 };
    double m[9];
    (void)state;

    for (size_t s = 0; s < 6; s++) {
        if (s == 5)
            colour_xyz_to_rec709(m); /* X = Y = Z is white E */
        else
            assert_int_equal(colour_to_rec709(spaces[s], m), ERR_OK);
        for (int i = 0; i < 3; i++)
            assert_true(fabs(m[3 * i] + m[3 * i + 1] + m[3 * i + 2] - 1.0) < 1e-12);
    }
}

/* By two ways to Rec.709: directly, and by the published matrix of CIE RGB, whose white is E, to XYZ and from there. */
static void xyz_agrees_with_a_space_whose_white_is_e(void **state)
{
    static const struct chromaticities cie_rgb = {
        { 0.735, 0.265 }, { 0.274, 0.717 }, { 0.167, 0.009 }, { 1.0 / 3.0, 1.0 / 3.0 }
    };
    /* of the CIE's RGB of 1931 with rounded primaries, as colour references list it */
    static const double to_xyz[9] = { 0.488718, 0.310680, 0.200602, 0.176204, 0.812985,
                                      0.010811, 0.000000, 0.010205, 0.989795 };
    double direct[9], from_xyz[9];
    (void)state;

    assert_int_equal(colour_to_rec709(&cie_rgb, direct), ERR_OK);
    colour_xyz_to_rec709(from_xyz);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double sum = 0.0;
            for (int k = 0; k < 3; k++)
                sum += from_xyz[3 * i + k] * to_xyz[3 * k + j];
            assert_true(fabs(sum - direct[3 * i + j]) < 1e-5);
        }
}

static void primaries_that_span_nothing_are_refused(void **state)
{
    static const struct chromaticities rows[] = {
        { { 0, 0 }, { 0, 0 }, { 0, 0 }, { 0, 0 } },
        { { 0.1, 0.1 }, { 0.2, 0.2 }, { 0.3, 0.3 }, { 0.3127, 0.3290 } },
        { { 0.64, 0.33 }, { 0.30, 0.60 }, { 0.15, 0.06 }, { 0.3127, 0.0 } },
        { { 0.64, 0.33 }, { 0.30, 0.60 }, { 0.15, 0.06 }, { 0.1, 0.3 } }, /* white beside the triangle */
        { { 1.5, -0.5 }, { -0.5, 1.5 }, { 0.0, -0.5 }, { 0.7, 0.02 } },   /* white that a cone sees as negative */
        { { NAN, 0.33 }, { 0.30, 0.60 }, { 0.15, 0.06 }, { 0.3127, 0.3290 } },
        { { 0.64, INFINITY }, { 0.30, 0.60 }, { 0.15, 0.06 }, { 0.3127, 0.3290 } },
        { { 0.64, 0.33 }, { 0.30, 1e30 }, { 0.15, 0.06 }, { 0.3127, 0.3290 } },
    };
    double m[9];
    (void)state;

    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++)
        assert_int_equal(colour_to_rec709(&rows[i], m), ERR_RANGE);
}

static void sameness_has_a_tolerance_and_excludes_nan(void **state)
{
    struct chromaticities other = colour_rec709;
    (void)state;

    other.blue[1] += 0.9e-4;
    assert_true(colour_same(&colour_rec709, &other, 1e-4));
    other.blue[1] += 0.2e-4;
    assert_false(colour_same(&colour_rec709, &other, 1e-4));
    other.blue[1] = NAN;
    assert_false(colour_same(&colour_rec709, &other, 1e-4));
}

/* A code of 255 is white: in PQ 10,000 cd/m^2, or less where it is clipped; in BT.709 203 cd/m^2, or the peak that is
 * given. A code of 0 is black. */
static void white_of_a_video_has_its_luminance(void **state)
{
    static const struct {
        uint8_t transfer; /* H.273 */
        double peak, want;
    } cases[] = {
        { 16, 0.0, 10000.0 }, { 16, 500.0, 500.0 }, { 16, 20000.0, 10000.0 }, { 1, 0.0, 203.0 }, { 1, 80.0, 80.0 }
    };
    static const float white = 255.0f, black = 0.0f;
    static struct signal s;
    (void)state;
    for (size_t k = 0; k < sizeof(cases) / sizeof(cases[0]); k++) {
        const struct signal_desc d = { .primaries = 9,
                                       .transfer = cases[k].transfer,
                                       .matrix = 9,
                                       .full_range = true,
                                       .rgb = true,
                                       .depth = 8,
                                       .peak_cdm2 = cases[k].peak };
        struct reason why;
        float rgb[3];
        assert_int_equal(signal_prepare(&d, "x", &s, &why), ERR_OK);
        signal_row(&s, &white, &white, &white, 1, rgb);
        for (int c = 0; c < 3; c++)
            assert_true(fabs((double)rgb[c] / cases[k].want - 1.0) < 1e-3);
        signal_row(&s, &black, &black, &black, 1, rgb);
        for (int c = 0; c < 3; c++)
            assert_true(fabsf(rgb[c]) < 1e-3f);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(rec709_is_itself),
    cmocka_unit_test(published_matrices_are_met),
    cmocka_unit_test(white_stays_white),
    cmocka_unit_test(xyz_agrees_with_a_space_whose_white_is_e),
    cmocka_unit_test(primaries_that_span_nothing_are_refused),
    cmocka_unit_test(sameness_has_a_tolerance_and_excludes_nan),
    cmocka_unit_test(white_of_a_video_has_its_luminance),
};

UNIT_MAIN(tests)
