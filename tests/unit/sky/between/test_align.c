#include "sky/between/skies.h"

#include "image/codec/decode.h"
#include "sky/between/align.h"

/* ---- The sun of a place and time ---- */

static double elevation_of(const double w[3])
{
    return asin(w[1]) / DEGREE;
}

static double azimuth_of(const double w[3])
{
    const double a = atan2(-w[0], w[2]) / DEGREE;
    return a < 0.0 ? a + 360.0 : a;
}

static void sun_agrees_with_published_positions(void **state)
{
    double w[3];

    (void)state;
    /* The example of NREL's algorithm, 17 October 2003, 12:30:30 in Golden, at 820 mbar [Reda and Andreas 2004]. */
    align_sun(39.742476, -105.1786, INT64_C(1066419030000000), w);
    assert_true(fabs(elevation_of(w) - (90.0 - 50.11162)) < 0.02);
    assert_true(fabs(azimuth_of(w) - 194.34024) < 0.02);
    /* Greenwich, noon of the solstices of 2024: declination 23.44, and the equation of time -1:45 and +1:50 minutes. */
    align_sun(51.4779, 0.0, INT64_C(1718884905000000), w);
    assert_true(fabs(elevation_of(w) - (90.0 - 51.4779 + 23.437)) < 0.03 && fabs(azimuth_of(w) - 180.0) < 0.2);
    align_sun(51.4779, 0.0, INT64_C(1734782400000000) - INT64_C(110000000), w);
    assert_true(fabs(elevation_of(w) - (90.0 - 51.4779 - 23.437 + 0.06)) < 0.03 && fabs(azimuth_of(w) - 180.0) < 0.2);
    /* The equinox of 20 March 2024, 3:06: at the pole refraction alone lifts the sun, by 29 minutes of arc. */
    align_sun(90.0, 0.0, INT64_C(1710903960000000), w);
    assert_true(fabs(elevation_of(w) - 0.48) < 0.03);
    /* Sunrise in London on 21 June 2024, 3:43: the upper limb is at the horizon. */
    align_sun(51.5074, -0.1278, INT64_C(1718941380000000), w);
    assert_true(fabs(elevation_of(w) + 0.267) < 0.15 && fabs(azimuth_of(w) - 49.0) < 1.0);
    /* Sydney, 21 December 2024, 1:53: noon, with the sun in the north. */
    align_sun(-33.87, 151.21, INT64_C(1734745980000000), w);
    assert_true(fabs(elevation_of(w) - (90.0 - 33.87 + 23.437)) < 0.03 && fabs(remainder(azimuth_of(w), 360.0)) < 2.0);
}

/* Before 1970 and over midnight the sun moves on: 15 degrees of hour angle an hour. */
static void sun_moves_evenly_through_any_year(void **state)
{
    (void)state;
    for (int64_t t = INT64_C(-600000000000000); t < INT64_C(2400000000000000); t += INT64_C(7654321098765)) {
        double a[3], b[3];
        align_sun(0.0, 13.0, t, a);
        align_sun(0.0, 13.0, t + INT64_C(240000000), b);
        if (elevation_of(a) > 10.0)
            assert_true(fabs(angle_between(a, b) / DEGREE - 1.0) < 0.09); /* cos 23.4 degrees at the solstices */
    }
}

/* It agrees with the suns of computed skies and of weather files [Spencer 1971], which leave out the leap years. A
 * series that is a day off, either way, is off by 0.55 and 0.68 degrees. */
static void sun_is_near_the_sky_s_own(void **state)
{
    const struct epw weather = { .latitude = 47.0, .longitude = 13.0, .zone = 1.0 };
    double most[2] = { 0.0, 0.0 };

    (void)state;
    for (int64_t n = 0; n < 4 * 365; n += 3) { /* 2021 to 2024, whose leap day is at its end */
        const int day = (int)(n % 365) + 1;
        const struct sun_day at = epw_day(&weather, day);
        double a[3], b[3], c[3];
        align_sun(47.0, 13.0, INT64_C(1000000) * (INT64_C(1609459200) + n * 86400 + 36000), a);
        sky_sun_place(47.0 * DEGREE, day, 10.0 + 13.0 / 15.0 + sky_equation_of_time(day, 10.0) / 60.0, b);
        sun_day_at(&at, 11.0, c);
        most[0] = fmax(most[0], angle_between(a, b) / DEGREE);
        most[1] = fmax(most[1], angle_between(a, c) / DEGREE);
    }
    printf("%.3f and %.3f degrees apart at most\n", most[0], most[1]);
    assert_true(most[0] < 0.4 && most[1] < 0.4);
}

/* ---- The sun of an image ---- */

static void sun_is_found_within_a_texel(void **state)
{
    struct picture p = picture_make(1000);
    double worst[3] = { 0.0 };

    (void)state;
    for (int i = 0; i < 30; i++) {
        double sun[3], w[3];
        bool found;
        sun_at(8.0 + 2.6 * i, i % 4 ? 37.7 * i : 180.0, sun); /* some across the seam */
        paint_sky(&p, sun, 3.0);
        const double sky = picture_brightest_sky(&p, sun);
        const int kind = i % 3; /* whole; clipped; clipped to little more than the sky */
        if (kind)
            picture_clip(&p, kind == 1 ? 100.0 * sky : 1.5 * sky);
        assert_int_equal(align_find_sun(p.rgb, p.width, p.height, w, &found), ERR_OK);
        if (!found)
            fail_msg("kind %d at %.1f degrees", kind, 8.0 + 2.6 * i);
        worst[kind] = fmax(worst[kind], angle_between(w, sun) / DEGREE);
    }
    printf("degrees off at most: whole %.3f, clipped %.3f, clipped low %.3f\n", worst[0], worst[1], worst[2]);
    assert_true(worst[0] < 0.05 && worst[1] < 0.15 && worst[2] < 0.5);
    test_free(p.rgb);
}

static void no_sun_is_found_where_none_is(void **state)
{
    struct picture p = picture_make(256);
    double w[3];
    bool found = true;

    (void)state;
    assert_int_equal(align_find_sun(p.rgb, p.width, p.height, w, &found), ERR_OK);
    assert_false(found); /* black */
    for (int type = 1; type <= 5; type++) {
        struct sky_pattern pattern;
        const double up[3] = { 0.0, 1.0, 0.0 };
        cie_pattern(type, &pattern);
        paint_pattern(&p, &pattern, up, 10000.0);
        assert_int_equal(align_find_sun(p.rgb, p.width, p.height, w, &found), ERR_OK);
        assert_false(found);
    }
    test_free(p.rgb);
}

/* Captured suns, whole ones as the truth: the same one where they are clipped to some ten times the sky. */
static void captured_suns_are_found_clipped_too(void **state)
{
    static const char *const names[] = { "env/clear_StinsonBeach_1k.hdr", "env/clear_noon_grass_1k.hdr",
                                         "env/partlycloudy_kloppenheim_05_1k.hdr", "env/extreme_sunrise_1k.hdr" };

    (void)state;
    for (size_t i = 0; i < 4; i++) {
        struct image im = { .width = 0 };
        struct reason why = { "" };
        double whole[3], w[3];
        bool found;
        if (decode_file(unit_data(names[i]), &im, &why))
            fail_msg("%s", why.text);
        struct picture p = { im.width, im.height, im.rgb };
        assert_int_equal(align_find_sun(p.rgb, p.width, p.height, whole, &found), ERR_OK);
        assert_true(found);
        for (double level = 1000.0; level > (i == 3 ? 50.0 : 2.0); level *= 0.4) {
            picture_clip(&p, level);
            assert_int_equal(align_find_sun(p.rgb, p.width, p.height, w, &found), ERR_OK);
            assert_true(found && angle_between(w, whole) < 0.25 * DEGREE);
        }
        image_finish(&im);
    }
}

/* ---- The rotation ---- */

/* By an angle about an axis (unit), degrees. */
static void rotation(const double axis[3], double degrees, double r[3][3])
{
    const double c = cos(degrees * DEGREE), s = sin(degrees * DEGREE);

    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const int k = 3 - i - j;
            const double cross = i == j ? 0.0 : (j == (i + 1) % 3 ? -axis[k] : axis[k]);
            r[i][j] = (i == j ? c : 0.0) + (1.0 - c) * axis[i] * axis[j] + s * cross;
        }
}

static void multiply(const double a[3][3], const double b[3][3], double out[3][3])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out[i][j] = a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j];
}

/* The largest angle, degrees, between what two orthogonal matrices do to the axes. */
static double apart(const double a[3][3], const double b[3][3])
{
    double most = 0.0;

    for (int j = 0; j < 3; j++) {
        const double x[3] = { a[0][j], a[1][j], a[2][j] }, y[3] = { b[0][j], b[1][j], b[2][j] };
        most = fmax(most, angle_between(x, y) / DEGREE);
    }
    return most;
}

static double any(void)
{
    return rand() / (0.5 * RAND_MAX) - 1.0;
}

/* A rig turned by `azimuth` and tilted by `tilt` degrees, with an exchange of axes before (diagonal of signs). */
static void rig(double azimuth, double tilt, const double exchange[3], double r[3][3])
{
    const double up[3] = { 0.0, 1.0, 0.0 }, side[3] = { 0.6, 0.0, 0.8 };
    double a[3][3], b[3][3];

    rotation(up, azimuth, a);
    rotation(side, tilt, b);
    multiply((const double(*)[3])b, (const double(*)[3])a, r);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            r[i][j] *= exchange[j];
}

/* The suns of `hours` from 9 o'clock on 10 May 2024 at 48 degrees, as that rig sees them with noise of some degrees. */
static void see(const double r[3][3], size_t count, double hours, double noise, struct sun_pair *pairs)
{
    for (size_t i = 0; i < count; i++) {
        const double h = 9.0 + hours * (double)i / fmax(1.0, (double)count - 1.0);
        align_sun(48.0, 0.0, INT64_C(1715299200000000) + (int64_t)(3600e6 * h), pairs[i].known);
        double w[3];
        for (int j = 0; j < 3; j++)
            w[j] = r[0][j] * pairs[i].known[0] + r[1][j] * pairs[i].known[1] + r[2][j] * pairs[i].known[2] +
                   any() * noise * DEGREE;
        const double length = sqrt(dot3(w, w));
        for (int j = 0; j < 3; j++)
            pairs[i].seen[j] = w[j] / length;
    }
}

static const double plain[3] = { 1.0, 1.0, 1.0 };

static void one_sun_gives_the_azimuth_and_says_the_elevation(void **state)
{
    struct sun_pair pair;
    struct alignment a;
    double r[3][3];

    (void)state;
    for (int i = 0; i < 36; i++) {
        rig(10.0 * i, 0.0, plain, r);
        see((const double(*)[3])r, 1, 0.0, 0.0, &pair);
        align_fit(&pair, 1, &a);
        assert_int_equal(a.kind, ALIGN_AZIMUTH);
        assert_true(apart((const double(*)[3])a.r, (const double(*)[3])r) < 1e-9 && a.residual < 1e-6);
        assert_true(fabs(remainder(a.azimuth + 10.0 * i, 360.0)) < 1e-9); /* +Y turns from +Z to +X, the west */
    }
    double lower[3];
    sun_at(elevation_of(pair.seen) - 2.0, azimuth_of(pair.seen), lower);
    memcpy(pair.seen, lower, sizeof(lower));
    align_fit(&pair, 1, &a);
    assert_true(apart((const double(*)[3])a.r, (const double(*)[3])r) < 1e-9);
    assert_true(fabs(a.residual - 2.0) < 1e-6 && fabs(a.elevation_off + 2.0) < 1e-6);
    assert_non_null(strstr(a.note, "2.00"));
}

static void ten_suns_give_azimuth_and_tilt_despite_outliers(void **state)
{
    struct sun_pair pairs[10];
    struct alignment a;
    double worst = 0.0, r[3][3];

    (void)state;
    srand(1);
    for (int i = 0; i < 200; i++) {
        rig(17.0 * i, any() * 15.0, plain, r);
        see((const double(*)[3])r, 10, 8.0, 0.1, pairs);
        for (int k = 0; k < i % 4; k++) { /* up to three lamps or reflections, two in one place */
            const double lamp[3] = { 0.48, k == 2 ? 0.6 : -0.6, 0.64 };
            memcpy(pairs[3 * k].seen, lamp, sizeof(lamp));
        }
        align_fit(pairs, 10, &a);
        assert_int_equal(a.kind, ALIGN_ROTATION);
        assert_int_equal(a.rig, ALIGN_UPRIGHT);
        assert_int_equal(a.used, 10 - i % 4);
        assert_true(a.residual < 0.15);
        worst = fmax(worst, apart((const double(*)[3])a.r, (const double(*)[3])r));
    }
    printf("%.3f degrees off at most, with noise of 0.1\n", worst);
    assert_true(worst < 0.2);
}

static void mirrored_and_hanging_rigs_are_named(void **state)
{
    static const struct {
        double exchange[3];
        enum align_rig rig;
        const char *says;
    } rigs[] = { { { 1.0, 1.0, 1.0 }, ALIGN_UPRIGHT, "residual" },
                 { { -1.0, -1.0, 1.0 }, ALIGN_UPSIDE_DOWN, "upside down" },
                 { { -1.0, 1.0, 1.0 }, ALIGN_MIRRORED, "left to right" },
                 { { 1.0, -1.0, 1.0 }, ALIGN_MIRRORED_BOTTOM, "top to bottom" } };
    struct sun_pair pairs[20];
    struct alignment a;
    double r[3][3];

    (void)state;
    srand(2);
    for (int i = 0; i < 400; i++) { /* also over 2 hours, whose arc fits more than one */
        rig(23.0 * i, any() * 5.0, rigs[i % 4].exchange, r);
        see((const double(*)[3])r, 20, i % 8 < 4 ? 8.0 : 2.0, 0.05, pairs);
        align_fit(pairs, 20, &a);
        assert_int_equal(a.kind, ALIGN_ROTATION);
        assert_int_equal(a.rig, rigs[i % 4].rig);
        assert_non_null(strstr(a.note, rigs[i % 4].says));
        assert_true(fabs(a.tilt) < 7.0);
        assert_true(apart((const double(*)[3])a.r, (const double(*)[3])r) < (i % 8 < 4 ? 0.1 : 0.5));
    }
}

/* As many suns in the mirror's plane as suit an upright rig: those aside tell. */
static void mirrored_rig_is_told_by_the_suns_beside_its_plane(void **state)
{
    struct sun_pair pairs[9];
    struct alignment a;

    (void)state;
    for (int i = 0; i < 9; i++) {
        const double azimuth = i < 5 ? 180.0 : (double[]){ 80.0, 265.0, 110.0, 240.0 }[i - 5];
        const double elevation = i < 5 ? 50.0 + 4.0 * i : (double[]){ 15.0, 25.0, 40.0, 35.0 }[i - 5];
        sun_at(elevation, azimuth, pairs[i].known);
        sun_at(elevation, -azimuth, pairs[i].seen);
    }
    align_fit(pairs, 9, &a);
    assert_int_equal(a.rig, ALIGN_MIRRORED);
    assert_int_equal(a.used, 9);
    assert_true(a.residual < 1e-5 && a.r[0][0] < -0.999);
}

/* Within an hour the sun's arc is straight: a rig that is turned about the sun by half a circle fits as well. */
static void short_arc_is_taken_for_the_rig_with_less_tilt(void **state)
{
    struct sun_pair pairs[10];
    struct alignment a;
    double r[3][3];

    (void)state;
    srand(4);
    for (int i = 0; i < 40; i++) {
        const double mirror[3] = { i % 2 ? -1.0 : 1.0, 1.0, 1.0 };
        rig(23.0 * i, any() * 3.0, mirror, r);
        see((const double(*)[3])r, 10, 0.9, 0.02, pairs);
        align_fit(pairs, 10, &a);
        assert_int_equal(a.kind, ALIGN_ROTATION);
        assert_int_equal(a.rig, i % 2 ? ALIGN_MIRRORED : ALIGN_UPRIGHT);
        assert_true(apart((const double(*)[3])a.r, (const double(*)[3])r) < 1.0);
    }
}

static void suns_that_disagree_turn_nothing(void **state)
{
    struct sun_pair pairs[12];
    struct alignment a;

    (void)state;
    srand(3);
    for (size_t i = 0; i < 12; i++) {
        sun_at(20.0 + 5.0 * (double)i, 100.0 + 12.0 * (double)i, pairs[i].known);
        sun_at(40.0 * any(), 180.0 * any(), pairs[i].seen);
    }
    align_fit(pairs, 12, &a);
    assert_int_equal(a.kind, ALIGN_NONE);
    assert_true(a.r[0][0] == 1.0 && a.r[1][1] == 1.0 && a.r[2][2] == 1.0 && a.r[0][2] == 0.0);
    assert_non_null(strstr(a.note, "nothing was turned"));
    align_fit(pairs, 0, &a);
    assert_int_equal(a.kind, ALIGN_NONE);
}

/* ---- Turning an image ---- */

static void apply_moves_each_direction(void **state)
{
    struct picture p = picture_make(256), q = picture_make(256);
    double r[3][3], most = 0.0;
    const double mirror[3] = { -1.0, 1.0, 1.0 };

    (void)state;
    for (int i = 0; i < 6; i++) { /* a picture of the direction itself, which is smooth everywhere */
        rig(61.0 * i, 30.0 * i, i % 2 ? mirror : plain, r);
        for (size_t k = 0; k < picture_values(&p) / 3; k++) {
            double w[3];
            texel_direction(p.width, p.height, k % p.width + 0.5, (double)(k / p.width) + 0.5, w);
            for (size_t c = 0; c < 3; c++)
                p.rgb[3 * k + c] = (float)w[c];
        }
        align_apply((const double(*)[3])r, p.rgb, q.rgb, p.width, p.height);
        for (size_t k = 0; k < picture_values(&p) / 3; k++) {
            double w[3];
            texel_direction(p.width, p.height, k % p.width + 0.5, (double)(k / p.width) + 0.5, w);
            for (size_t c = 0; c < 3; c++) /* the inverse is the transpose */
                most = fmax(most, fabs((double)q.rgb[3 * k + c] - (r[0][c] * w[0] + r[1][c] * w[1] + r[2][c] * w[2])));
        }
    }
    printf("%.5f off at most\n", most);
    assert_true(most < 1e-3);
    test_free(p.rgb);
    test_free(q.rgb);
}

static void apply_keeps_the_light_and_the_place_of_a_sun(void **state)
{
    struct picture p = picture_make(1024), q = picture_make(1024);
    double off = 0.0, change = 0.0;

    (void)state;
    for (int i = 0; i < 10; i++) {
        double sun[3], w[3], r[3][3], to[3];
        bool found;
        sun_at(40.0 + i, 33.0 * i, sun);
        paint_sky(&p, sun, 3.0);
        rig(71.0 * i, 7.0, plain, r);
        align_apply((const double(*)[3])r, p.rgb, q.rgb, p.width, p.height);
        for (int k = 0; k < 3; k++)
            to[k] = dot3(r[k], sun);
        assert_int_equal(align_find_sun(q.rgb, q.width, q.height, w, &found), ERR_OK);
        assert_true(found);
        off = fmax(off, angle_between(w, to) / DEGREE);
        double sum[2] = { 0.0 };
        for (size_t k = 0; k < picture_values(&p) / 3; k++) {
            const double o = texel_solid_angle(p.width, p.height, (uint32_t)(k / p.width));
            sum[0] += o * texel_luminance(p.rgb, k);
            sum[1] += o * texel_luminance(q.rgb, k);
        }
        change = fmax(change, fabs(sum[1] / sum[0] - 1.0));
    }
    printf("the sun is %.3f degrees off at most, the light of all changes by %.2f %%\n", off, 100.0 * change);
    assert_true(off < 0.05 && change < 0.06);
    test_free(p.rgb);
    test_free(q.rgb);
}

/* From skies to the rotation: ten skies of a rig, half of them clipped to little above their brightest part. */
static void rotation_comes_from_ten_skies(void **state)
{
    double one = 0.0;

    (void)state;
    for (int tilt = 0; tilt <= 4; tilt += 4) {
        struct picture p = picture_make(tilt ? 1024 : 512), q = picture_make(p.width);
        struct sun_pair pairs[10];
        struct alignment a;
        double r[3][3], inverse[3][3];
        rig(123.0, tilt, plain, r);
        for (int i = 0; i < 9; i++)
            inverse[i / 3][i % 3] = r[i % 3][i / 3];
        see((const double(*)[3])r, 10, 8.0, 0.0, pairs);
        for (size_t i = 0; i < 10; i++) {
            bool found;
            paint_sky(&p, pairs[i].known, 3.0);
            align_apply((const double(*)[3])inverse, p.rgb, q.rgb, p.width, p.height);
            if (i % 2)
                picture_clip(&q, 2.0 * picture_brightest_sky(&p, pairs[i].known));
            assert_int_equal(align_find_sun(q.rgb, q.width, q.height, pairs[i].seen, &found), ERR_OK);
            assert_true(found);
            align_fit(&pairs[i], 1, &a);
            if (tilt == 0)
                one = fmax(one, apart((const double(*)[3])a.r, (const double(*)[3])r));
        }
        align_fit(pairs, 10, &a);
        printf("%s; off by %.3f\n", a.note, apart((const double(*)[3])a.r, (const double(*)[3])r));
        assert_true(a.used == 10 && apart((const double(*)[3])a.r, (const double(*)[3])r) < 0.1);
        test_free(p.rgb);
        test_free(q.rgb);
    }
    printf("by one sky of an upright rig %.3f at most\n", one);
    assert_true(one < 0.5);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(sun_agrees_with_published_positions),
    cmocka_unit_test(sun_moves_evenly_through_any_year),
    cmocka_unit_test(sun_is_near_the_sky_s_own),
    cmocka_unit_test(sun_is_found_within_a_texel),
    cmocka_unit_test(captured_suns_are_found_clipped_too),
    cmocka_unit_test(no_sun_is_found_where_none_is),
    cmocka_unit_test(one_sun_gives_the_azimuth_and_says_the_elevation),
    cmocka_unit_test(ten_suns_give_azimuth_and_tilt_despite_outliers),
    cmocka_unit_test(mirrored_and_hanging_rigs_are_named),
    cmocka_unit_test(mirrored_rig_is_told_by_the_suns_beside_its_plane),
    cmocka_unit_test(short_arc_is_taken_for_the_rig_with_less_tilt),
    cmocka_unit_test(suns_that_disagree_turn_nothing),
    cmocka_unit_test(apply_moves_each_direction),
    cmocka_unit_test(apply_keeps_the_light_and_the_place_of_a_sun),
    cmocka_unit_test(rotation_comes_from_ten_skies),
};

UNIT_MAIN(tests)
