/* Change maps: exactly the pixels with other bits, and what was computed for them. */
#include "light/frame/changes.h"
#include "light/frame/stage.h"

enum { WIDTH = 32, HEIGHT = 18, PIXELS = WIDTH * HEIGHT };

static void run(struct stage *s, const struct relight_desc *light, struct changes *c, struct relight_stats *stats)
{
    assert_int_equal(stage_run(s, light, stats), ERR_OK);
    assert_int_equal(changes_take(c, s->relighter, stats, s->rgb), ERR_OK);
}

static uint32_t pixels_with(const struct changes *c, uint8_t bit)
{
    uint32_t count = 0;

    for (uint32_t k = 0; k < PIXELS; k++)
        count += (c->map[k] & bit) != 0;
    return count;
}

/* The first image is new everywhere. The same sky again changes nothing, though sampling computes all light again; a
 * pixel painted by hand is found alone, whichever of its channels differs, by the last bit. */
static void a_changed_pixel_is_found_alone(void **state)
{
    const struct relight_desc light = { .direct = { .method = METHOD_MIS, .samples = 4 } };
    struct stage s =
        stage_make(&(struct prepared_scene_desc){ .width = WIDTH, .height = HEIGHT }, sky_with_sun(64, 32, 2e3f));
    struct changes c = { .before = NULL };
    struct relight_stats stats;
    uint32_t lit = 0;
    (void)state;

    run(&s, &light, &c, &stats);
    assert_true(c.pixels == PIXELS && c.changed == PIXELS && c.box[1] == WIDTH && c.box[3] == HEIGHT);
    run(&s, &light, &c, &stats);
    for (uint32_t k = 0; k < PIXELS; k++)
        lit += s.set->gbuffer->entry_first[k + 1] > s.set->gbuffer->entry_first[k];
    assert_true(c.changed == 0 && c.sky == lit && lit > 0 && c.sun == 0 && c.box[1] == 0);
    for (uint32_t channel = 0; channel < 3; channel++) {
        const uint32_t at = 5 * WIDTH + 9 + channel;
        uint8_t painted[PIXELS * 3];
        s.rgb[3 * at + channel] = nextafterf(s.rgb[3 * at + channel], 1e9f);
        assert_int_equal(changes_take(&c, s.relighter, &stats, s.rgb), ERR_OK);
        assert_true(c.changed == 1 && c.map[at] & CHANGE_RADIANCE && pixels_with(&c, CHANGE_RADIANCE) == 1);
        assert_true(c.box[0] == 9 + channel && c.box[1] == 10 + channel && c.box[2] == 5 && c.box[3] == 6);
        changes_paint(&c, painted);
        assert_true(painted[3 * at] == 255 && painted[3 * at + 2] == 0);
        assert_int_equal(painted[3 * at + 1], c.map[at] & CHANGE_SKY ? 255 : 0);
    }
    c.begun = false;
    assert_int_equal(changes_take(&c, s.relighter, &stats, s.rgb), ERR_OK);
    assert_int_equal(c.changed, PIXELS);
    changes_finish(&c);
    stage_finish(&s);
}

/* A cached image of the same sky takes over nearly all; what changed was computed, or looks at the sky itself. */
static void what_a_cache_takes_over_is_not_computed(void **state)
{
    const struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 64 } };
    struct stage s =
        stage_make(&(struct prepared_scene_desc){ .width = WIDTH, .height = HEIGHT }, sky_with_sun(64, 32, 2e3f));
    struct environment *others = sky_environment(sky_with_sun(64, 32, 3e3f), 64, 0.0), *first = s.sky;
    struct changes c = { .before = NULL };
    struct relight_stats stats;
    (void)state;

    for (int k = 0; k < 3; k++)
        run(&s, &light, &c, &stats);
    assert_true(c.changed == 0 && c.sun == 0 && c.sky < PIXELS / 2);
    s.sky = others; /* another sun */
    run(&s, &light, &c, &stats);
    assert_true(c.changed > PIXELS / 10 && c.sun > PIXELS / 2);
    for (uint32_t k = 0; k < PIXELS; k++)
        if (s.set->gbuffer->miss_first[k] == s.set->gbuffer->miss_first[k + 1])
            assert_true(!(c.map[k] & CHANGE_RADIANCE) || c.map[k] & (CHANGE_SKY | CHANGE_SUN));
    s.sky = first;
    environment_destroy(others);
    changes_finish(&c);
    stage_finish(&s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_changed_pixel_is_found_alone),
    cmocka_unit_test(what_a_cache_takes_over_is_not_computed),
};
UNIT_MAIN(tests)
