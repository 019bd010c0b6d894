/* What images are expected to cost, from what others did. */
#include "support/unit.h"

#include "relightd/daemon/shade.h"

static const struct plan_facts facts = { .points = 1000, .pixels = 800, .albedo = 0.5, .casters = 1 };

static struct relight_desc ask(enum method method, uint32_t samples, uint32_t classes)
{
    return (struct relight_desc){ .direct = { .method = method, .samples = samples }, .classes = classes };
}

static double seconds(const struct cost *c, enum method method, uint32_t samples, uint32_t classes)
{
    const struct relight_desc light = ask(method, samples, classes);
    return cost_estimate(c, &facts, &light);
}

/* A tenth of a second for ten light samples of each of the 1000 points. */
static void learn(struct cost *c)
{
    const struct relight_stats stats = { .shade_ms = 100.0, .resolve_ms = 5.0, .direct = { .rays = 1 } };
    const struct relight_desc light = ask(METHOD_LIGHT, 10, PATH_DIRECT);

    cost_learn(c, facts.points, &light, &stats);
}

static void nothing_is_known_before_the_first_image(void **state)
{
    const struct cost c = { .sample_s = 0.0 };

    (void)state;
    assert_true(seconds(&c, METHOD_MIS, 1 << 20, PATH_ALL) == 0.0);
}

static void an_estimate_follows_samples_method_and_paths(void **state)
{
    struct cost c = { .sample_s = 0.0 };

    (void)state;
    learn(&c);
    assert_float_equal(seconds(&c, METHOD_LIGHT, 10, PATH_DIRECT), 0.105, 1e-9);
    assert_float_equal(seconds(&c, METHOD_LIGHT, 1000, PATH_DIRECT), 10.005, 1e-9);
    assert_float_equal(seconds(&c, METHOD_BRDF, 10, PATH_DIRECT), 0.005 + 3.5 * 0.1, 1e-6);
    assert_float_equal(seconds(&c, METHOD_MIS, 10, PATH_DIRECT), 0.005 + 2.25 * 0.1, 1e-6);
    const double direct = seconds(&c, METHOD_LIGHT, 160, PATH_DIRECT);
    const double caustics = seconds(&c, METHOD_LIGHT, 160, PATH_DIRECT | PATH_CAUSTICS);
    assert_true(caustics > 1.7 * direct && seconds(&c, METHOD_LIGHT, 160, PATH_ALL) > caustics);
    assert_true(seconds(&c, METHOD_CACHED, 160, PATH_ALL) > seconds(&c, METHOD_MIS, 160, PATH_DIRECT));
}

static void each_part_is_learnt_from_images_that_have_it(void **state)
{
    struct cost c = { .sample_s = 0.0 };
    const struct relight_stats slow = {
        .shade_ms = 200.0, .eye_ms = 50.0, .resolve_ms = 5.0, .direct = { .rays = 1 }, .eye = { .paths = 1000 }
    };
    const struct relight_stats black = { .shade_ms = 0.1, .resolve_ms = 5.0 };
    const struct relight_desc light = ask(METHOD_LIGHT, 10, PATH_ALL), few = ask(METHOD_LIGHT, 1, PATH_DIRECT);

    (void)state;
    learn(&c);
    cost_learn(&c, facts.points, &light, &black);
    assert_float_equal(c.sample_s, 1e-5, 1e-12);
    cost_learn(&c, facts.points, &few, &slow); /* at one sample the rest outweighs it */
    assert_float_equal(c.sample_s, 1e-5, 1e-12);
    assert_float_equal(c.path_s, 5e-5, 1e-12);
    cost_learn(&c, facts.points, &light, &slow);
    assert_true(c.sample_s > 1e-5 && c.sample_s < 2e-5);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(nothing_is_known_before_the_first_image),
    cmocka_unit_test(an_estimate_follows_samples_method_and_paths),
    cmocka_unit_test(each_part_is_learnt_from_images_that_have_it),
};
UNIT_MAIN(tests)
