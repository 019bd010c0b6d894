/* The relighter's store of light paths: made once, told apart, renewed by turns, and right. RING: docs/examples. */
#include "light/frame/stage.h"

enum { WIDTH = 48, HEIGHT = 27, VALUES = 3 * WIDTH * HEIGHT };

static struct stage ring(struct frame sky)
{
    return stage_make(&(struct prepared_scene_desc){ .scene = RING, .width = WIDTH, .height = HEIGHT }, sky);
}

static void run(struct stage *s, const struct relight_desc *light, struct relight_stats *stats)
{
    if (stage_run(s, light, stats))
        fail_msg("%s", s->why.text);
}

static const struct relight_desc stored = {
    .direct = { .method = METHOD_MIS, .samples = 8 },
    .classes = PATH_CAUSTICS | PATH_INDIRECT,
    .caustics = PLAN_STORED,
    .stored_paths = 20000,
    .renew = 4,
};

static void it_is_made_once_and_told_apart(void **state)
{
    struct stage s = ring(sky_with_sun(64, 32, 2e3f));
    struct relight_desc light = stored;
    struct relight_stats first, second, other;
    double ms;
    (void)state;

    run(&s, &light, &first);
    light.turn = 1;
    run(&s, &light, &second);
    assert_int_equal(first.plan.caustics, PLAN_STORED);
    assert_int_equal(first.plan.indirect_caustics, PLAN_STORED);
    assert_true(first.cache_ms > 0.0 && second.cache_ms == 0.0);
    assert_true(first.stored.paths >= 20000 && first.stored.paths < 20200);
    assert_true(first.stored.splats > 1000 && first.stored.bytes > 10 * first.stored.splats);
    assert_int_equal(second.stored.renewed, 1);
    assert_true(second.stored.rays > 0);
    assert_int_equal(relighter_prepare(s.relighter, &light, false, &ms), ERR_OK);
    assert_true(ms == 0.0);
    light.classes = PATH_CAUSTICS; /* other paths */
    run(&s, &light, &other);
    assert_true(other.cache_ms > 0.0 && other.stored.splats < first.stored.splats);
    light.caustics = PLAN_LIGHT;
    run(&s, &light, &other);
    assert_true(other.stored.paths == 0 && other.cache_ms == 0.0);
    stage_finish(&s);
}

/* Of the light that is left to them, as many particles as would have gone to it: none where nothing is. */
static void the_bright_part_has_its_share_of_the_particles(void **state)
{
    struct stage sun = ring(sky_with_sun(64, 32, 2e3f)), cloud = ring(sky_overcast(64, 32));
    struct relight_desc light = stored;
    struct relight_stats stats;
    (void)state;

    light.particles = 10000;
    run(&sun, &light, &stats);
    assert_true(stats.light.particles > 5000 && stats.light.particles < 10000);
    run(&cloud, &light, &stats);
    assert_int_equal(stats.light.particles, 0);
    assert_true(stats.stored.splats > 0);
    stage_finish(&sun);
    stage_finish(&cloud);
}

static void the_image_depends_on_the_turn_alone(void **state)
{
    struct stage a = ring(sky_overcast(64, 32)), b = ring(sky_overcast(64, 32));
    struct relight_desc light = stored;
    struct relight_stats stats;
    float before[VALUES];
    (void)state;

    for (light.turn = 0; light.turn < 3; light.turn++) {
        memcpy(before, a.rgb, sizeof(before));
        run(&a, &light, &stats);
    }
    light.turn = 2;
    run(&b, &light, &stats);
    assert_memory_equal(a.rgb, b.rgb, sizeof(a.rgb));
    assert_memory_not_equal(a.rgb, before, sizeof(before));
    light.renew = 0; /* nothing is drawn anew */
    run(&b, &light, &stats);
    memcpy(before, b.rgb, sizeof(before));
    light.turn = 3;
    run(&b, &light, &stats);
    assert_memory_equal(b.rgb, before, sizeof(before));
    assert_int_equal(stats.stored.renewed, 0);
    stage_finish(&a);
    stage_finish(&b);
}

static void cached_has_it_unless_another_is_asked(void **state)
{
    struct stage s = ring(sky_with_sun(64, 32, 2e3f));
    struct relight_desc light = stored;
    struct relight_stats stats;
    (void)state;

    light.direct.method = METHOD_CACHED;
    light.caustics = PLAN_AUTO; /* no direct light was asked for: nothing else is computed beforehand */
    run(&s, &light, &stats);
    assert_int_equal(stats.plan.caustics, PLAN_STORED);
    assert_true(stats.stored.splats > 0 && stats.cache.bytes == 0);
    light.caustics = PLAN_EYE;
    run(&s, &light, &stats);
    assert_int_equal(stats.plan.caustics, PLAN_EYE);
    assert_int_equal(stats.stored.splats, 0);
    light.direct.method = METHOD_MIS;
    light.caustics = PLAN_AUTO;
    run(&s, &light, &stats);
    assert_int_equal(stats.plan.caustics, PLAN_LIGHT);
    stage_finish(&s);
}

/* Mean luminance of the image, stored less traced, over 16 seeds (8 of half as many paths in each commit): what eye
 * paths find behind the ball is the same in both. It may be 4.5 of its standard errors from nothing (5.5 by 8). That
 * error is asserted to be below 0.2 % of the image (0.4 %): a bias of 1 % (2.4 %) is 5 (6) errors away, and seen in 7
 * of 10 cases; a lost factor, class or part of the sky is more. */
static void it_is_what_the_light_tracer_finds(void **state)
{
    const uint32_t seeds = seeds_count(8, 16), part = seeds_count(2, 1);
    const double limit = seeds_count(55, 45) / 10.0;
    struct relight_stats stats;
    (void)state;

    for (int k = 0; k < 2; k++) {
        struct stage s = ring(k ? sky_with_sun(64, 32, 1e3f) : sky_overcast(64, 32));
        double sum = 0.0, squares = 0.0, level = 0.0;
        for (uint64_t seed = 0; seed < seeds; seed++) {
            double mean[2] = { 0.0 };
            for (int by = 0; by < 2; by++) {
                struct relight_desc light = stored;
                light.classes = PATH_CAUSTICS;
                light.direct.seed = seed;
                light.caustics = by ? PLAN_LIGHT : PLAN_STORED;
                light.particles = 120000 / part;
                light.stored_paths = 200000 / part;
                run(&s, &light, &stats);
                for (int v = 0; v < VALUES; v += 3)
                    mean[by] += rgb_luminance(s.rgb[v], s.rgb[v + 1], s.rgb[v + 2]) / (WIDTH * HEIGHT);
            }
            sum += (mean[0] - mean[1]) / seeds;
            squares += pow(mean[0] - mean[1], 2.0) / seeds;
            level += mean[1] / seeds;
        }
        const double error = sqrt((squares - sum * sum) / (seeds - 1));
        printf("%+.3f %%, error %.3f %%\n", 100.0 * sum / level, 100.0 * error / level);
        assert_true(fabs(sum) < limit * error && error < 2e-3 * seeds_blur(8, 16) * sqrt(part) * level);
        stage_finish(&s);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(it_is_made_once_and_told_apart),
    cmocka_unit_test(the_bright_part_has_its_share_of_the_particles),
    cmocka_unit_test(the_image_depends_on_the_turn_alone),
    cmocka_unit_test(cached_has_it_unless_another_is_asked),
    cmocka_unit_test(it_is_what_the_light_tracer_finds),
};
UNIT_MAIN(tests)
