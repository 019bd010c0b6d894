/* Skies between two: at their own times they are what was captured; between, light and sun are where they must be. */
#include "sky/between/align.h"
#include "sky/between/between.h"
#include "sky/between/between_skies.h"

#include <string.h>

enum { W = 1024, H = 512 };

static struct between *made(enum between_mode mode)
{
    struct between *b = NULL;

    assert_int_equal(between_create(&(struct between_desc){ .mode = mode, .hold = 2 }, &b), ERR_OK);
    return b;
}

/* A sky with a sun of `light` times the usual energy at an azimuth in degrees. */
static struct frame sunny(double azimuth, double light)
{
    const double energy[3] = { 6.0 * light, 5.0 * light, 4.0 * light };
    struct frame f = sky_constant(W, H, 0.5f);
    double at[3];

    towards(45.0 * DEGREES, azimuth * DEGREES, at);
    if (light > 0.0)
        sun_put(f.rgb, W, H, at, 0.2665 * DEGREES, energy);
    return f;
}

static void take(struct between *b, const struct frame *f, double seconds)
{
    struct reason why = { "" };

    assert_int_equal(between_take(b, f, seconds, NULL, &why), ERR_OK);
}

static void take_sunny(struct between *b, double azimuth, double light, double seconds)
{
    struct frame f = sunny(azimuth, light);

    take(b, &f, seconds);
    frame_finish(&f);
}

static const struct frame *show(struct between *b, double seconds)
{
    static struct frame out;

    assert_int_equal(between_show(b, seconds, &out), ERR_OK);
    return &out;
}

/* The sun's light above the grey, and how far from an azimuth (degrees) its middle is. */
static double sun_of(const struct frame *f, double azimuth, double *off)
{
    float *above = mem_alloc(3 * (size_t)W * H, sizeof(*above));
    double middle[3], at[3];

    for (size_t t = 0; t < 3 * (size_t)W * H; t++)
        above[t] = f->rgb[t] - 0.5f > 1e-4f ? f->rgb[t] - 0.5f : 0.0f;
    const double light = light_of(above, W, H, middle);
    towards(45.0 * DEGREES, azimuth * DEGREES, at);
    *off = degrees_between(middle, at);
    mem_free(above);
    return light;
}

static void at_its_own_time_a_sky_is_as_it_came(void **state)
{
    struct frame first = sunny(100.0, 1.0), second = sunny(101.0, 0.5);
    (void)state;

    for (int mode = BETWEEN_OFF; mode <= BETWEEN_MOTION; mode++) {
        struct between *b = made((enum between_mode)mode);
        take(b, &first, 10.0);
        take(b, &second, 25.0);
        assert_memory_equal(show(b, 10.0)->rgb, first.rgb, 3 * W * H * sizeof(float));
        assert_memory_equal(show(b, 25.0)->rgb, second.rgb, 3 * W * H * sizeof(float));
        assert_memory_equal(show(b, 3.0)->rgb, first.rgb, 3 * W * H * sizeof(float));
        if (mode == BETWEEN_OFF)
            assert_memory_equal(show(b, 24.0)->rgb, first.rgb, 3 * W * H * sizeof(float));
        between_destroy(b);
    }
    frame_finish(&first);
    frame_finish(&second);
}

/* One sun, on its way, with the light between; not two that fade. */
static void the_sun_moves_and_dims(void **state)
{
    struct between *b = made(BETWEEN_FADE);
    double whole, worst = 0.0, light = 0.0, off;
    (void)state;

    take_sunny(b, 100.0, 1.0, 0.0);
    take_sunny(b, 102.0, 0.1, 60.0);
    whole = sun_of(show(b, 0.0), 100.0, &off);
    for (int i = 1; i < 12; i++) {
        const double t = i / 12.0, g = sun_of(show(b, 60.0 * t), 100.0 + 2.0 * t, &off) / whole;
        worst = fmax(worst, off);
        light = fmax(light, fabs(g - (1.0 - 0.9 * t)));
    }
    printf("the sun is off by at most %.2g degrees and %.2g of its light\n", worst, light);
    assert_true(worst < 0.01 && light < 0.002);
    between_destroy(b);
}

/* A cloud takes the whole sun: it goes out on its way, where the skies before say that it leads. */
static void a_sun_that_goes_out_stays_on_its_way(void **state)
{
    struct between *b = made(BETWEEN_FADE);
    double off, off_back;
    (void)state;

    take_sunny(b, 100.0, 1.0, 0.0);
    take_sunny(b, 102.0, 1.0, 60.0);
    take_sunny(b, 104.0, 0.0, 120.0);
    const double whole = sun_of(show(b, 60.0), 102.0, &off);
    const double half = sun_of(show(b, 90.0), 103.0, &off);
    assert_true(off < 0.02 && fabs(half / whole - 0.5) < 0.002);
    take_sunny(b, 106.0, 1.0, 180.0);
    const double back = sun_of(show(b, 150.0), 105.0, &off_back);
    assert_true(off_back < 0.02 && fabs(back / whole - 0.5) < 0.002);
    between_destroy(b);
}

static float brightest(const struct frame *f)
{
    float most = 0.0f;

    for (size_t t = 0; t < 3 * (size_t)f->width * f->height; t++)
        most = fmaxf(most, f->rgb[t]);
    return most;
}

static void suns_far_apart_fade(void **state)
{
    struct between *b = made(BETWEEN_FADE);
    double off;
    (void)state;

    take_sunny(b, 100.0, 1.0, 0.0);
    take_sunny(b, 160.0, 1.0, 60.0);
    const double whole = sun_of(show(b, 0.0), 100.0, &off);
    const double both = sun_of(show(b, 30.0), 130.0, &off);
    assert_true(fabs(both / whole - 1.0) < 0.002);
    assert_true(brightest(show(b, 30.0)) < 0.6f * brightest(show(b, 0.0))); /* each has half of the radiance */
    between_destroy(b);
}

static void before_a_sky_of_another_size_the_last_one_stays(void **state)
{
    struct between *b = made(BETWEEN_FADE);
    struct frame small = sky_constant(256, 128, 1.0f);
    (void)state;

    take_sunny(b, 100.0, 1.0, 0.0);
    take(b, &small, 10.0);
    assert_int_equal(show(b, 5.0)->width, W);
    assert_int_equal(show(b, 10.0)->width, 256);
    take_sunny(b, 100.0, 1.0, 20.0);
    assert_int_equal(show(b, 15.0)->width, 256);
    assert_int_equal(show(b, 20.0)->width, W);
    frame_finish(&small);
    between_destroy(b);
}

/* Skies right before and after a long gap would turn the errors of their suns' places into a wide curve. */
static void a_gap_between_two_pairs_is_crossed_straight(void **state)
{
    static const double seconds[4] = { 0.0, 15.0, 3615.0, 3630.0 };
    struct between *b = made(BETWEEN_FADE);
    double off;
    (void)state;

    for (int k = 0; k < 4; k++) /* a third of a texel wrong */
        take_sunny(b, 100.0 + seconds[k] / 240.0 + (k % 3 ? 0.12 : 0.0), 1.0, seconds[k]);
    (void)sun_of(show(b, 1815.0), 107.5, &off);
    printf("%.2f degrees off\n", off);
    assert_true(off < 1.0);
    between_destroy(b);
}

/* Captured maps state no units: an illuminance is compared with them as W sr^-1 m^-2, and far too much is doubted. */
static void an_illuminance_restores_the_sun_of_a_captured_sky(void **state)
{
    static const double lux[2] = { 5000.0, 85000.0 };
    struct frame f = sky_constant(W, H, 0.5f); /* 281 lx */
    double at[3];
    (void)state;

    towards(45.0 * DEGREES, 100.0 * DEGREES, at);
    sun_put(f.rgb, W, H, at, 1.5 * DEGREES, (const double[3]){ 1.0, 1.0, 1.0 });
    for (size_t t = 0; t < 3 * (size_t)W * H; t++)
        f.rgb[t] = fminf(f.rgb[t], 2.0f);
    for (int k = 0; k < 2; k++) {
        struct between *b = NULL;
        assert_int_equal(between_create(&(struct between_desc){ .sun = lux[k] }, &b), ERR_OK);
        take(b, &f, 0.0);
        assert_true(show(b, 0.0)->sun_restored == (k == 0));
        between_destroy(b);
    }
    frame_finish(&f);
}

/* Of a sky that was turned by an alignment and one before it that was not, there are no images between. */
static void skies_that_were_turned_otherwise_do_not_meet(void **state)
{
    struct between *b = NULL;
    const struct between_desc desc = { .mode = BETWEEN_FADE, .align = BETWEEN_ALIGN_SUN, .place = { 45.0, 0.0 } };
    struct frame dull = sky_constant(W, H, 0.5f), f = sunny(200.0, 1.0);
    (void)state;

    dull.capture_us = INT64_C(1718202605000000);
    f.capture_us = dull.capture_us + 15000000;
    assert_int_equal(between_create(&desc, &b), ERR_OK);
    take(b, &dull, 0.0);
    assert_int_equal(between_count(b), 1);
    take(b, &f, 15.0);
    assert_int_equal(between_count(b), 1);
    assert_true(between_seconds(b, 0) == 15.0);
    frame_finish(&dull);
    frame_finish(&f);
    between_destroy(b);
}

/* A sun that clipped is found, too: four times the sky is far below what sun_patch takes for one. */
static void a_clipped_sun_tells_north(void **state)
{
    struct between *b = NULL;
    const struct between_desc desc = { .align = BETWEEN_ALIGN_SUN, .place = { 45.0, 0.0 } };
    struct frame f = sky_constant(W, H, 0.5f);
    double at[3], known[3];
    (void)state;

    f.capture_us = INT64_C(1718202605000000); /* 12 June 2024, 14:30:05 UTC */
    align_sun(45.0, 0.0, f.capture_us, known);
    const double azimuth = atan2(-known[0], known[2]), elevation = asin(known[1]);
    towards(elevation, azimuth - 30.0 * DEGREES, at); /* the rig looks 30 degrees east of north */
    sun_put(f.rgb, W, H, at, 1.5 * DEGREES, (const double[3]){ 1.0, 1.0, 1.0 });
    for (size_t t = 0; t < 3 * (size_t)W * H; t++)
        f.rgb[t] = fminf(f.rgb[t], 2.0f);
    assert_int_equal(between_create(&desc, &b), ERR_OK);
    take(b, &f, 0.0);
    const double turn = remainder(show(b, 0.0)->turn, 360.0);
    printf("turned by %.3f degrees\n", turn);
    assert_true(fabs(fabs(turn) - 30.0) < 0.1);
    frame_finish(&f);
    between_destroy(b);
}

/* A cube map among others is looked up as a lat-long image of about as many texels. */
static void other_layouts_become_lat_long(void **state)
{
    struct between *b = NULL;
    struct frame cube = sky_constant(64, 384, 1.5f);
    (void)state;

    assert_int_equal(between_create(&(struct between_desc){ .mode = BETWEEN_FADE, .layout = LAYOUT_CUBE }, &b), ERR_OK);
    take(b, &cube, 0.0);
    const struct frame *f = show(b, 0.0);
    assert_true(f->width == 2 * f->height && f->height >= 110 && f->height <= 112);
    for (size_t t = 0; t < 3 * (size_t)f->width * f->height; t++)
        assert_true(fabsf(f->rgb[t] - 1.5f) < 1e-5f);
    frame_finish(&cube);
    between_destroy(b);
}

static void after_the_last_sky_its_sun_goes_on_for_one_interval(void **state)
{
    struct between *b = made(BETWEEN_FADE);
    double off;
    (void)state;

    take_sunny(b, 100.0, 1.0, 0.0);
    take_sunny(b, 102.0, 1.0, 60.0);
    (void)sun_of(show(b, 90.0), 103.0, &off);
    assert_true(off < 0.06);
    (void)sun_of(show(b, 600.0), 104.0, &off);
    assert_true(off < 0.06);
    between_destroy(b);
}

static void what_belongs_to_a_frame_is_between_too(void **state)
{
    struct between *b = made(BETWEEN_FADE);
    struct frame f = sky_constant(64, 32, 1.0f);
    (void)state;

    f.number = 7;
    f.turn = 350.0;
    f.units = 2.0;
    f.capture_us = 1000000;
    take(b, &f, 0.0);
    f.number = 8;
    f.turn = 10.0;
    f.capture_us = 3000000;
    take(b, &f, 2.0);
    const struct frame *half = show(b, 1.0);
    assert_true(half->number == 7 && half->units == 2.0 && half->capture_us == 2000000);
    assert_true(fabs(remainder(half->turn, 360.0)) < 1e-9);
    frame_finish(&f);
    between_destroy(b);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(at_its_own_time_a_sky_is_as_it_came),
    cmocka_unit_test(the_sun_moves_and_dims),
    cmocka_unit_test(a_sun_that_goes_out_stays_on_its_way),
    cmocka_unit_test(suns_far_apart_fade),
    cmocka_unit_test(before_a_sky_of_another_size_the_last_one_stays),
    cmocka_unit_test(a_gap_between_two_pairs_is_crossed_straight),
    cmocka_unit_test(an_illuminance_restores_the_sun_of_a_captured_sky),
    cmocka_unit_test(skies_that_were_turned_otherwise_do_not_meet),
    cmocka_unit_test(a_clipped_sun_tells_north),
    cmocka_unit_test(other_layouts_become_lat_long),
    cmocka_unit_test(after_the_last_sky_its_sun_goes_on_for_one_interval),
    cmocka_unit_test(what_belongs_to_a_frame_is_between_too),
};

UNIT_MAIN(tests)
