/* The sun taken out of an image and put back: places, energies and sizes that are known. */
#include "sky/between/between_skies.h"
#include "sky/daylight/sun.h"

#include <string.h>

static const double sun_energy[3] = { 6.0, 5.0, 4.0 };

static void a_disc_is_found_where_it_was_put(void **state)
{
    static const uint32_t widths[] = { 512, 1024, 2048 };
    double worst[3] = { 0.0 }, energy = 0.0;
    (void)state;

    for (uint32_t k = 0; k < 3; k++)
        for (int i = 0; i < 24; i++) {
            const uint32_t w = widths[k], h = w / 2;
            struct frame f = sky_constant(w, h, 0.5f);
            struct sun_patch p = { .found = false };
            double at[3];
            towards((3.0 + 3.6 * i) * DEGREES, 47.3 * i * DEGREES, at);
            sun_put(f.rgb, w, h, at, SUN_RADIUS, sun_energy);
            assert_int_equal(sun_patch_take(f.rgb, w, h, &p), ERR_OK);
            assert_true(p.found && p.radius == SUN_RADIUS && p.others < 1e-3);
            worst[k] = fmax(worst[k], degrees_between(p.direction, at));
            for (int c = 0; c < 3; c++)
                energy = fmax(energy, fabs(p.energy[c] / sun_energy[c] - 1.0));
            for (size_t t = 0; t < 3 * (size_t)w * h; t++)
                assert_true(fabsf(f.rgb[t] - 0.5f) < 1e-6f);
            sun_patch_finish(&p);
            frame_finish(&f);
        }
    printf("off by at most %.2g, %.2g, %.2g degrees at 512, 1024, 2048 texels; energy by %.2g\n", worst[0], worst[1],
           worst[2], energy);
    /* A disc inside one texel of 0.70 degrees may be anywhere in it: 0.085 degrees each way. */
    assert_true(worst[0] < 0.13 && worst[1] < 0.01 && worst[2] < 0.004 && energy < 1e-4);
}

static void what_was_taken_is_given_back_bit_for_bit(void **state)
{
    struct frame f = cloudy(512, 256, 0.0, 0.0);
    float *before = mem_alloc(3 * 512 * 256, sizeof(*before));
    struct sun_patch p = { .found = false };
    double at[3];
    (void)state;

    towards(50.0 * DEGREES, 179.0 * DEGREES, at);
    sun_put(f.rgb, 512, 256, at, SUN_RADIUS, sun_energy);
    memcpy(before, f.rgb, 3 * 512 * 256 * sizeof(*before));
    assert_int_equal(sun_patch_take(f.rgb, 512, 256, &p), ERR_OK);
    assert_true(p.found && memcmp(before, f.rgb, 3 * 512 * 256 * sizeof(*before)) != 0);
    sun_patch_restore(&p, f.rgb);
    assert_memory_equal(before, f.rgb, 3 * 512 * 256 * sizeof(*before));
    sun_patch_finish(&p);
    mem_free(before);
    frame_finish(&f);
}

/* A camera's glare keeps its size, so that its highlight stays soft. */
static void a_wide_glare_keeps_its_radius(void **state)
{
    struct frame f = sky_constant(1024, 512, 0.5f);
    struct sun_patch p = { .found = false };
    double at[3];
    (void)state;

    towards(35.0 * DEGREES, 120.0 * DEGREES, at);
    sun_put(f.rgb, 1024, 512, at, 1.2 * DEGREES, sun_energy);
    assert_int_equal(sun_patch_take(f.rgb, 1024, 512, &p), ERR_OK);
    assert_true(p.found && fabs(p.radius / DEGREES - 1.2) < 0.05 && degrees_between(p.direction, at) < 0.01);
    sun_patch_finish(&p);
    frame_finish(&f);
}

static void skies_without_a_sun_stay_as_they_are(void **state)
{
    struct frame skies[] = { sky_constant(256, 128, 0.0f), sky_constant(256, 128, 2.0f), sky_overcast(256, 128),
                             cloudy(256, 128, 0.0, 0.0), sky_constant(256, 128, 0.5f) };
    struct sun_patch p = { .found = false };
    double at[3];
    (void)state;

    towards(40.0 * DEGREES, 0.0, at); /* a bright cloud of 20 degrees */
    sun_put(skies[4].rgb, 256, 128, at, 10.0 * DEGREES, (const double[3]){ 2.0, 2.0, 2.0 });
    for (size_t k = 0; k < sizeof(skies) / sizeof(skies[0]); k++) {
        const uint64_t size = 3 * 256 * 128 * sizeof(float);
        float *before = mem_alloc(1, size);
        memcpy(before, skies[k].rgb, size);
        assert_int_equal(sun_patch_take(skies[k].rgb, 256, 128, &p), ERR_OK);
        assert_false(p.found);
        assert_memory_equal(before, skies[k].rgb, size);
        mem_free(before);
        frame_finish(&skies[k]);
    }
    sun_patch_finish(&p);
}

static void a_second_sun_is_told(void **state)
{
    struct frame f = sky_constant(512, 256, 0.5f);
    struct sun_patch p = { .found = false };
    double at[3], other[3];
    (void)state;

    towards(40.0 * DEGREES, 0.3, at);
    towards(30.0 * DEGREES, 2.3, other);
    sun_put(f.rgb, 512, 256, at, SUN_RADIUS, sun_energy);
    sun_put(f.rgb, 512, 256, other, SUN_RADIUS, (const double[3]){ 3.0, 2.5, 2.0 });
    assert_int_equal(sun_patch_take(f.rgb, 512, 256, &p), ERR_OK);
    assert_true(p.found && degrees_between(p.direction, at) < 0.2 && fabs(p.others - 0.5) < 0.1);
    sun_patch_finish(&p);
    frame_finish(&f);
}

/* The true sun every half hour, at four times: between the middle two, and an hour later. */
static void the_way_follows_the_suns_circle(void **state)
{
    double between = 0.0, later = 0.0;
    (void)state;

    for (int i = 0; i < 16; i++) {
        const double latitude = (-60.0 + 8.0 * i) * DEGREES, hour = 7.0 + 0.5 * i;
        struct sun_mark marks[SUN_MARKS];
        double w[3], truth[3];
        for (int k = 0; k < SUN_MARKS; k++) {
            marks[k].seconds = 1800.0 * k;
            sky_sun_place(latitude, 172, hour + 0.5 * k, marks[k].direction);
        }
        sun_way(marks, SUN_MARKS, 1800.0 * 1.5, w);
        sky_sun_place(latitude, 172, hour + 0.75, truth);
        between = fmax(between, degrees_between(w, truth));
        sun_way(marks, SUN_MARKS, 1800.0 * 3.5, w);
        sky_sun_place(latitude, 172, hour + 1.75, truth);
        later = fmax(later, degrees_between(w, truth));
        sun_way(marks, 1, 1800.0 * 9, w);
        assert_true(degrees_between(w, marks[0].direction) < 1e-9);
    }
    printf("off by at most %.2g degrees between, %.2g a quarter of an hour ahead\n", between, later);
    assert_true(between < 0.002 && later < 0.01);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_disc_is_found_where_it_was_put),
    cmocka_unit_test(what_was_taken_is_given_back_bit_for_bit),
    cmocka_unit_test(a_wide_glare_keeps_its_radius),
    cmocka_unit_test(skies_without_a_sun_stay_as_they_are),
    cmocka_unit_test(a_second_sun_is_told),
    cmocka_unit_test(the_way_follows_the_suns_circle),
};

UNIT_MAIN(tests)
