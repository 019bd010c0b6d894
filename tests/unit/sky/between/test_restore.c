#include "sky/between/skies.h"

#include "image/codec/decode.h"
#include "sky/between/restore.h"

static struct restored restore(struct picture *p, double lux, double units)
{
    const struct restore_desc d = { .lux = lux, .units = units };
    struct restored r;
    struct reason why = { "" };

    if (restore_sun(p->rgb, p->width, p->height, &d, &r, &why))
        fail_msg("%s", why.text);
    return r;
}

/* Clips a sky at `times` its brightest part without the sun, restores it, and returns the error of its illuminance, %.
 */
static double clip_and_restore(struct picture *p, const double sun[3], double times, double units, struct restored *out)
{
    const double truth = picture_lux(p);

    picture_clip(p, times * picture_brightest_sky(p, sun));
    assert_true(picture_lux(p) < 0.7 * truth); /* the sun was lost indeed */
    *out = restore(p, 0.0, units);
    return 100.0 * (picture_lux(p) / truth - 1.0);
}

/* ---- The energy ---- */

static void energy_is_right_for_the_built_in_sky_in_any_units(void **state)
{
    struct picture p = picture_make(512);
    struct restored r;

    (void)state;
    for (int i = 0; i < 8; i++) {
        const double t = (double[]){ 2.3, 3.0, 4.0, 5.5 }[i / 2], scale = i % 2 ? 1e-3 : 20.0;
        double sun[3];
        sun_at(25.0 + 12.0 * i / 2, 40.0 * i, sun);
        paint_sky(&p, sun, t);
        picture_scale(&p, scale);
        const double off = clip_and_restore(&p, sun, 4.0, 0.0, &r);
        printf("turbidity %.1f, found %.2f: %+.1f %%\n", t, r.turbidity, off);
        assert_int_equal(r.kind, RESTORE_ADDED);
        assert_true(fabs(off) < 5.0 && fabs(r.turbidity / t - 1.0) < 0.06 && fabs(r.scale / scale - 1.0) < 0.05);
        assert_true(r.lux == 0.0); /* of unknown units */
        assert_true(angle_between(r.direction, sun) < 0.3 * DEGREE);
    }
    test_free(p.rgb);
}

/* Irradiances, W m^-2, that are usual at a zenith angle of the sun: clear ones, then hazy ones. The sky's pattern and
 * both illuminances follow from them by what Perez et al. measured. */
static const struct {
    double zenith, direct, diffuse, most; /* %, with known units */
    int cie;                              /* the standard sky of the same weather */
} measured[] = {
    { 30.0, 900.0, 95.0, 10.0, 12 },  { 40.0, 880.0, 95.0, 10.0, 12 },  { 50.0, 850.0, 90.0, 10.0, 12 },
    { 60.0, 760.0, 85.0, 10.0, 12 },  { 30.0, 850.0, 130.0, 10.0, 12 }, { 45.0, 780.0, 130.0, 10.0, 12 },
    { 60.0, 680.0, 110.0, 10.0, 12 }, { 40.0, 650.0, 230.0, 15.0, 13 }, { 60.0, 500.0, 170.0, 15.0, 13 },
    { 70.0, 400.0, 120.0, 15.0, 13 }, { 45.0, 600.0, 180.0, 15.0, 11 },
};

static void paint_measured(struct picture *p, size_t k, bool standard, const double sun[3])
{
    const double z = measured[k].zenith * DEGREE, direct = measured[k].direct, diffuse = measured[k].diffuse;
    const double clear = perez_clearness(z, direct, diffuse), bright = perez_brightness(z, diffuse, 100);
    struct sky_pattern pattern;

    if (standard)
        cie_pattern(measured[k].cie, &pattern);
    else
        perez_pattern(z, clear, bright, &pattern);
    paint_pattern(p, &pattern, sun, diffuse * perez_diffuse_efficacy(z, clear, bright, 10.0));
    add_sun(p, sun, direct * perez_direct_efficacy(z, clear, bright, 10.0));
}

/* Paints a measured sky, clips and restores it; units: 0 if they are not told. Returns how far its light is off, %. */
static double restore_measured(struct picture *p, size_t k, bool cie, double units, struct restored *r)
{
    double sun[3];

    sun_at(90.0 - measured[k].zenith, 230.0, sun);
    paint_measured(p, k, cie, sun);
    picture_scale(p, units > 0.0 ? units : 1.0);
    return clip_and_restore(p, sun, 3.0, units, r);
}

static void energy_is_right_for_measured_skies_in_known_units(void **state)
{
    struct picture p = picture_make(512);
    struct restored r;

    (void)state;
    for (size_t i = 0; i < 2 * sizeof(measured) / sizeof(measured[0]); i++) {
        const size_t k = i / 2;
        const double off = restore_measured(&p, k, i % 2, 0.01, &r);
        printf("%s zenith %.0f, %.0f + %.0f W: turbidity %.2f, agreement %.2f, %+.1f %%\n", i % 2 ? "cie" : "perez",
               measured[k].zenith, measured[k].direct, measured[k].diffuse, r.turbidity, r.agreement, off);
        assert_int_equal(r.kind, RESTORE_ADDED);
        assert_true(fabs(off) < measured[k].most);
        assert_true(fabs(r.lux - LUMINOUS_EFFICACY * r.irradiance / 0.01) < 1e-9 * r.lux);
    }
    test_free(p.rgb);
}

/* In unknown units only the clearest of them are met: what restore.h says. */
static void shape_alone_suffices_for_clear_skies_at_high_sun(void **state)
{
    struct picture p = picture_make(512);
    struct restored r;

    (void)state;
    for (size_t i = 0; i < 2 * sizeof(measured) / sizeof(measured[0]); i++) {
        const size_t k = i / 2;
        const double off = restore_measured(&p, k, i % 2, 0.0, &r);
        printf("%s zenith %.0f, %.0f + %.0f W: turbidity %.2f, %+.1f %%\n", i % 2 ? "cie" : "perez", measured[k].zenith,
               measured[k].direct, measured[k].diffuse, r.turbidity, off);
        assert_true(fabs(off) < (k < 3 ? 10.0 : 100.0));
    }
    test_free(p.rgb);
}

/* Clouds as bright, grey blots; the sky is free around the sun. cover: of the sky, 0..1. */
static double paint_clouds(struct picture *p, const double sun[3], double cover, unsigned seed)
{
    double covered = 0.0, whole = 0.0, centre[40][3];

    srand(seed);
    for (int k = 0; k < 40; k++) {
        const double up = rand() / (double)RAND_MAX, a = 2.0 * PI * rand() / (double)RAND_MAX;
        centre[k][0] = sqrt(1.0 - up * up) * cos(a);
        centre[k][1] = up;
        centre[k][2] = sqrt(1.0 - up * up) * sin(a);
    }
    for (uint32_t y = 0; y < p->height / 2; y++)
        for (uint32_t x = 0; x < p->width; x++) {
            float *t = p->rgb + 3 * ((size_t)y * p->width + x);
            double w[3], near = 10.0;
            texel_direction(p->width, p->height, x + 0.5, y + 0.5, w);
            for (int k = 0; k < 40; k++)
                near = fmin(near, angle_between(w, centre[k]));
            whole += texel_solid_angle(p->width, p->height, y);
            if (near > cover * 20.0 * DEGREE || angle_between(w, sun) < 4.0 * DEGREE)
                continue;
            covered += texel_solid_angle(p->width, p->height, y);
            for (int c = 0; c < 3; c++) /* 5000 to 12000 cd m^-2, in cells of some degrees */
                t[c] =
                    (float)((5000.0 + 7000.0 * (0.5 + 0.5 * sin(40.0 * w[0]) * cos(35.0 * w[2]))) / LUMINOUS_EFFICACY);
        }
    return covered / whole;
}

static void energy_is_right_between_broken_clouds(void **state)
{
    struct picture p = picture_make(512);
    struct restored r;

    (void)state;
    for (unsigned i = 0; i < 24; i++) {
        const double t = (double[]){ 2.5, 3.0, 4.5 }[i % 3], units = i % 2 ? 1.0 : 0.0;
        double sun[3];
        sun_at(30.0 + i, 77.0 * i, sun);
        paint_sky(&p, sun, t);
        const double cover = paint_clouds(&p, sun, 0.3 + 0.1 * (i % 4), i);
        const double off = clip_and_restore(&p, sun, 3.0, units, &r);
        printf("turbidity %.1f, %2.0f %% clouds, units %.0f: found %.2f, agreement %.2f, %+.1f %%\n", t, 100.0 * cover,
               units, r.turbidity, r.agreement, off);
        if (cover < 0.45)
            assert_int_equal(r.kind, RESTORE_ADDED);
        assert_true(r.kind == RESTORE_ADDED ? fabs(off) < 20.0 : r.kind == RESTORE_DOUBT);
    }
    test_free(p.rgb);
}

static void stated_lux_are_met(void **state)
{
    struct picture p = picture_make(1024);
    double sun[3];

    (void)state;
    sun_at(40.0, 100.0, sun);
    paint_sky(&p, sun, 3.0);
    picture_scale(&p, 0.25);
    picture_clip(&p, 3.0 * picture_brightest_sky(&p, sun));
    const struct restored r = restore(&p, 60000.0, 0.25);
    assert_int_equal(r.kind, RESTORE_ADDED);
    assert_true(fabs(picture_lux(&p) / 0.25 - 60000.0) < 60.0);
    assert_true(r.turbidity == 0.0 && strstr(r.note, "60000") == NULL && strstr(r.note, "6e+04") != NULL);

    paint_sky(&p, sun, 3.0);
    picture_clip(&p, 3.0 * picture_brightest_sky(&p, sun));
    const double before = picture_lux(&p);
    assert_int_equal(restore(&p, 0.5 * before, 1.0).kind, RESTORE_DOUBT);
    assert_true(picture_lux(&p) == before);

    const struct restore_desc d = { .lux = 60000.0 };
    struct restored none;
    struct reason why = { "" };
    assert_int_equal(restore_sun(p.rgb, p.width, p.height, &d, &none, &why), ERR_USAGE);
    assert_non_null(strstr(why.text, "units"));
    test_free(p.rgb);
}

/* ---- Where, and where not ---- */

/* An infinite half float was mended to 65504. */
static void sun_at_the_largest_half_float_is_restored(void **state)
{
    struct picture p = picture_make(1024);
    double sun[3];

    (void)state;
    sun_at(50.0, 0.0, sun);
    paint_sky(&p, sun, 3.0);
    const double truth = picture_lux(&p);
    picture_scale(&p, 0.04);
    picture_clip(&p, 65504.0);
    assert_true(picture_lux(&p) < 0.04 * 0.6 * truth);
    assert_int_equal(restore(&p, 0.0, 0.0).kind, RESTORE_ADDED);
    assert_true(fabs(picture_lux(&p) / (0.04 * truth) - 1.0) < 0.05);
    test_free(p.rgb);
}

static void whole_suns_are_left_alone(void **state)
{
    (void)state;
    for (uint32_t width = 128; width <= 4096; width *= 2) {
        struct picture p = picture_make(width);
        double sun[3];
        sun_at(50.0, 30.0, sun);
        paint_sky(&p, sun, 3.0);
        const double before = picture_lux(&p);
        const struct restored r = restore(&p, 0.0, 0.0);
        assert_true(r.kind == RESTORE_NONE || r.kind == RESTORE_WHOLE);
        assert_true(picture_lux(&p) == before);
        test_free(p.rgb);
    }
}

static void skies_without_sun_get_none(void **state)
{
    struct picture p = picture_make(512);
    double sun[3], lamp[3];

    (void)state;
    sun_at(45.0, 30.0, sun);
    for (int type = 1; type <= CIE_SKIES; type++) {
        struct sky_pattern pattern;
        cie_pattern(type, &pattern);
        paint_pattern(&p, &pattern, sun, 10000.0);
        assert_int_equal(restore(&p, 0.0, 0.0).kind, RESTORE_NONE);
    }
    for (int k = 0; k < 3; k++) { /* an overcast sky with a brighter spot, a clipped lamp in a dark room, a low lamp */
        struct sky_pattern pattern;
        sun_at(k == 2 ? 1.0 : 45.0, 30.0, lamp);
        cie_pattern(1, &pattern);
        if (k == 2)
            paint_sky(&p, sun, 3.0), picture_clip(&p, picture_brightest_sky(&p, sun));
        else
            paint_pattern(&p, &pattern, sun, k ? 1.0 : 10000.0);
        const double level = (k == 1 ? 100.0 : 4.0) * picture_brightest_sky(&p, lamp);
        add_sun(&p, lamp, 100000.0);
        picture_clip(&p, level);
        const double before = picture_lux(&p);
        const struct restored r = restore(&p, 0.0, 0.0);
        assert_int_equal(r.kind, RESTORE_DOUBT);
        assert_non_null(strstr(r.note, "nothing was added"));
        assert_true(picture_lux(&p) == before);
    }
    test_free(p.rgb);
}

static void large_spots_are_no_suns(void **state)
{
    struct picture p = picture_make(512);
    double sun[3];

    (void)state;
    sun_at(45.0, 30.0, sun);
    for (int degrees = 2; degrees <= 8; degrees += 6) { /* the glare of a sun, and a window */
        paint_sky(&p, sun, 3.0);
        picture_clip(&p, picture_brightest_sky(&p, sun));
        const float level = 10.0f * (float)picture_brightest_sky(&p, sun);
        for (size_t i = 0; i < picture_values(&p); i++) {
            double w[3];
            texel_direction(p.width, p.height, i / 3 % p.width + 0.5, (double)(i / 3 / p.width) + 0.5, w);
            if (angle_between(w, sun) < degrees * DEGREE)
                p.rgb[i] = level;
        }
        assert_int_equal(restore(&p, 0.0, 0.0).kind, degrees == 2 ? RESTORE_ADDED : RESTORE_NONE);
    }
    test_free(p.rgb);
}

static void black_and_tiny_images_are_survived(void **state)
{
    (void)state;
    for (uint32_t width = 2; width <= 64; width *= 2) {
        struct picture p = picture_make(width);
        assert_int_equal(restore(&p, 0.0, 0.0).kind, RESTORE_NONE);
        p.rgb[0] = 1.0f;
        assert_true(restore(&p, 0.0, 1.0).kind != RESTORE_ADDED);
        test_free(p.rgb);
    }
}

/* ---- Captured skies ---- */

static struct picture load(const char *name, struct image *im)
{
    struct reason why = { "" };

    *im = (struct image){ .width = 0 };
    if (decode_file(unit_data(name), im, &why))
        fail_msg("%s", why.text);
    return (struct picture){ im->width, im->height, im->rgb };
}

/* Captured skies with a whole sun: no constant was fitted to them, but they were known when the model was chosen. Two
 * are missed by far: the sun of noon_grass is a third of what its sky, as blue as that of StinsonBeach, calls for, and
 * at 8 degrees the light of a sun is a matter of haze. */
static void captured_suns_come_back(void **state)
{
    static const struct {
        const char *name;
        double most; /* % */
    } skies[] = { { "env/clear_StinsonBeach_1k.hdr", 10.0 },
                  { "env/partlycloudy_kloppenheim_05_1k.hdr", 20.0 },
                  { "env/clear_noon_grass_1k.hdr", 100.0 },
                  { "env/extreme_sunrise_1k.hdr", 50.0 } };

    (void)state;
    for (size_t i = 0; i < 16; i++) {
        struct image im;
        struct picture p = load(skies[i / 4].name, &im);
        const double truth = picture_lux(&p);
        const struct restored whole = restore(&p, 0.0, 0.0);
        assert_true(whole.kind == RESTORE_NONE || whole.kind == RESTORE_WHOLE);
        assert_true(picture_lux(&p) == truth);
        picture_clip(&p, 10.0 * pow(10.0, (double)(i % 4) - (i / 4 == 0)));
        const struct restored r = restore(&p, 0.0, 0.0);
        printf("%s: %+.1f %% %s\n", skies[i / 4].name, 100.0 * (picture_lux(&p) / truth - 1.0), r.note);
        assert_true(fabs(picture_lux(&p) / truth - 1.0) < 0.01 * skies[i / 4].most || r.kind == RESTORE_WHOLE);
        assert_true(i % 4 == 3 || r.kind == RESTORE_ADDED);
        image_finish(&im);
    }
}

static void captured_places_without_a_clear_sun_get_none(void **state)
{
    static const char *const names[] = {
        "env/brokencloud_aristea_puresky_1k.hdr",
        "env/dawn_1k.hdr",
        "env/overcast_city_1k.hdr",
        "env/night_1k.hdr",
        "env/night_st_peters_1k.hdr",
        "env/studio_small_05_1k.hdr",
        "env/interior_dancing_hall_1k.hdr",
        "env/dwab_blender_interior_1k.exr",
        "env/odd_StageEnvLatLong_1000x500.exr",
        "env/check_WavyLinesLatLong.exr",
    };

    (void)state;
    for (size_t i = 0; i < sizeof(names) / sizeof(names[0]); i++) {
        struct image im;
        for (double level = 1e6; level > 0.05; level *= 0.5) {
            struct picture p = load(names[i], &im);
            picture_clip(&p, level);
            const double before = picture_lux(&p);
            const struct restored r = restore(&p, 0.0, 0.0);
            if (r.kind == RESTORE_ADDED)
                printf("%s at %g: %s\n", names[i], level, r.note);
            assert_true(r.kind != RESTORE_ADDED && picture_lux(&p) == before);
            image_finish(&im);
        }
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(energy_is_right_for_the_built_in_sky_in_any_units),
    cmocka_unit_test(energy_is_right_for_measured_skies_in_known_units),
    cmocka_unit_test(shape_alone_suffices_for_clear_skies_at_high_sun),
    cmocka_unit_test(energy_is_right_between_broken_clouds),
    cmocka_unit_test(stated_lux_are_met),
    cmocka_unit_test(sun_at_the_largest_half_float_is_restored),
    cmocka_unit_test(whole_suns_are_left_alone),
    cmocka_unit_test(skies_without_sun_get_none),
    cmocka_unit_test(large_spots_are_no_suns),
    cmocka_unit_test(black_and_tiny_images_are_survived),
    cmocka_unit_test(captured_suns_come_back),
    cmocka_unit_test(captured_places_without_a_clear_sun_get_none),
};

UNIT_MAIN(tests)
