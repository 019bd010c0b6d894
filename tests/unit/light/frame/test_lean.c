/* A sky whose tables wait until somebody asks for them: whatever method comes, it finds what it needs. */
#include "light/estimators/points.h"
#include "light/frame/relight.h"
#include "support/sets.h"

enum { WIDTH = 16, HEIGHT = 9, VALUES = 3 * WIDTH * HEIGHT };

static struct environment *make_sky(bool lean)
{
    struct environment *e = environment_create(&(struct environment_desc){ .n = 64, .lean = lean });
    struct frame f = sky_with_sun(64, 32, 2e3f);
    struct reason why;

    assert_non_null(e);
    assert_int_equal(environment_update(e, &f, &why), ERR_OK);
    frame_finish(&f);
    return e;
}

static void take_image(struct relighter *r, const struct environment *e, const struct relight_desc *light, float *rgb)
{
    struct relight_stats stats;

    assert_int_equal(relighter_run(r, e, light, rgb, &stats), ERR_OK);
}

static void every_method_has_the_same_bits_under_a_lean_sky(void **state)
{
    static const struct relight_desc lights[] = {
        { .direct = { .method = METHOD_MIS, .samples = 8 } },
        { .direct = { .method = METHOD_AUTO, .samples = 8 }, .classes = PATH_ALL },
        { .direct = { .method = METHOD_BRDF, .samples = 4 }, .classes = PATH_INDIRECT, .indirect = PLAN_LIGHT },
        { .direct = { .method = METHOD_BRDF, .samples = 4 }, .classes = PATH_INDIRECT, .indirect = PLAN_EYE },
        { .direct = { .method = METHOD_LATLONG, .samples = 4 } },
        { .direct = { .method = METHOD_PATH, .samples = 1 }, .classes = PATH_ALL },
        { .direct = { .method = METHOD_CACHED, .samples = 8 }, .classes = PATH_ALL },
    };
    static float want[VALUES], got[VALUES];
    const struct prepared_scene_desc desc = { .width = WIDTH, .height = HEIGHT };
    struct environment *whole = make_sky(false);
    struct prepared_scene *set;
    (void)state;

    set = set_of(&desc);
    for (size_t k = 0; k < sizeof(lights) / sizeof(lights[0]); k++) {
        struct environment *lean = make_sky(true);
        struct relighter *r = relighter_create(set, best_kernels());
        assert_non_null(r);
        take_image(r, lean, &lights[k], got);
        take_image(r, whole, &lights[k], want);
        assert_memory_equal(got, want, sizeof(want));
        relighter_destroy(r);
        environment_destroy(lean);
    }
    environment_destroy(whole);
    set_destroy(set);
}

static void the_cache_leaves_a_lean_sky_lean(void **state)
{
    const struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 8 }, .classes = PATH_DIRECT };
    static float rgb[VALUES];
    const struct prepared_scene_desc desc = { .width = WIDTH, .height = HEIGHT };
    struct environment *lean = make_sky(true);
    struct prepared_scene *set;
    (void)state;

    set = set_of(&desc);
    struct relighter *r = relighter_create(set, best_kernels());
    assert_non_null(r);
    take_image(r, lean, &light, rgb);
    assert_false(environment_is_complete(lean));
    relighter_destroy(r);
    environment_destroy(lean);
    set_destroy(set);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(every_method_has_the_same_bits_under_a_lean_sky),
    cmocka_unit_test(the_cache_leaves_a_lean_sky_lean),
};
UNIT_MAIN(tests)
