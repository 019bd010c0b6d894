/* The figures by which the plan decides, on skies and sets whose figures are known. */
#include "light/frame/frame_plan.h"

#include "light/frame/relight.h"
#include "support/sets.h"
#include "support/skies.h"

static double peakedness_of(struct frame f)
{
    struct environment *e = sky_environment(f, 32, 0.0);
    const double p = facts_peakedness(e);
    environment_destroy(e);
    return p;
}

static void an_even_sky_has_a_peakedness_of_one(void **state)
{
    (void)state;
    assert_float_equal(peakedness_of(sky_constant(64, 32, 3.0f)), 1.0, 1e-5);
    assert_float_equal(peakedness_of(sky_constant(64, 32, 0.0f)), 0.0, 0.0);
}

/* Half of the sphere black: the mean square is twice the square of the mean. */
static void a_sky_over_black_ground_has_two(void **state)
{
    struct frame f = sky_constant(64, 32, 1.0f);
    (void)state;

    for (uint32_t y = 16; y < 32; y++)
        for (uint32_t x = 0; x < 64; x++)
            sky_paint(&f, x, y, 0.0f, 0.0f, 0.0f);
    assert_float_equal(peakedness_of(f), 2.0, 0.01);
}

static void a_sun_makes_it_large(void **state)
{
    (void)state;
    assert_in_range((uintmax_t)(100.0 * peakedness_of(sky_overcast(64, 32))), 120, 300);
    assert_true(peakedness_of(sky_with_sun(64, 32, 1e5f)) > 100.0);
}

static void the_built_in_court_is_what_its_image_shows(void **state)
{
    const struct prepared_scene_desc desc = { .width = 64, .height = 36 };
    struct prepared_scene *s = NULL;
    struct plan_facts f;
    (void)state;

    s = set_of(&desc);
    facts_of_set(s->scene, s->gbuffer, &f);
    assert_int_equal(f.casters, 0); /* it has neither mirror nor glass */
    assert_int_equal(f.behind, 0);
    assert_int_equal(f.points, s->gbuffer->point_count);
    assert_int_equal(f.pixels, 64 * 36);
    assert_true(f.albedo > 0.1 && f.albedo < 0.9);
    assert_float_equal(f.peakedness, 0.0, 0.0); /* the sky's, which is not of the set */
    set_destroy(s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(an_even_sky_has_a_peakedness_of_one),
    cmocka_unit_test(a_sky_over_black_ground_has_two),
    cmocka_unit_test(a_sun_makes_it_large),
    cmocka_unit_test(the_built_in_court_is_what_its_image_shows),
};
UNIT_MAIN(tests)
