/* What the pilot chooses, by a price list instead of a clock, so that it is the same everywhere: the built-in court,
 * and a card under a mirror ring where casters are wanted. */
#include "light/frame/pilot.h"
#include "light/frame/pilots.h"

#include <math.h>

enum { WIDTH = 96, HEIGHT = 54 };

static float rgb[3 * WIDTH * HEIGHT];

static bool says(const struct relight_stats *s, const char *part)
{
    for (uint32_t k = 0; k < s->plan.left_out_count; k++)
        if (strstr(s->plan.left_out[k], part))
            return true;
    return false;
}

static void a_scene_without_mirrors_runs_no_caustics(void **state)
{
    struct prepared_scene *set = set_of(&(struct prepared_scene_desc){ .width = WIDTH, .height = HEIGHT });
    struct pilot *p = pilot_of(set);
    struct environment *e = sky_environment(sky_with_sun(64, 32, 1e5f), 32, 0.0);
    const struct relight_desc light = { .classes = PATH_ALL };
    struct relight_stats stats;
    struct pilot_stats said;
    (void)state;

    assert_int_equal(set->facts.casters, 0);
    for (int k = 0; k < 5; k++) {
        fly(p, e, &light, (struct budget_target){ .seconds = 0.1 }, 1, rgb, &stats, &said);
        assert_int_equal(stats.plan.caustics, PLAN_NONE);
        assert_false(said.part[PILOT_AIMED].there);
        assert_true(says(&stats, "the scene has no mirror and no glass"));
    }
    pilot_end(p);
    environment_destroy(e);
    set_destroy(set);
}

static void an_overcast_sky_gets_no_samples_of_a_sun(void **state)
{
    struct prepared_scene *set = set_of(&(struct prepared_scene_desc){ .width = WIDTH, .height = HEIGHT });
    struct environment *dull = sky_environment(sky_overcast(64, 32), 32, 0.0);
    struct environment *fine = sky_environment(sky_with_sun(64, 32, 1e4f), 32, 0.0);
    const struct relight_desc light = { .classes = PATH_BACKGROUND | PATH_DIRECT };
    const struct budget_target target = { .seconds = 0.05 };
    struct relight_stats stats;
    struct pilot_stats said;
    (void)state;

    struct pilot *p = pilot_of(set);
    fly(p, dull, &light, target, 6, rgb, &stats, &said);
    assert_false(stats.direct.sun);
    pilot_end(p);
    p = pilot_of(set);
    fly(p, fine, &light, target, 6, rgb, &stats, &said);
    assert_true(stats.direct.sun);
    pilot_end(p);
    environment_destroy(dull);
    environment_destroy(fine);
    set_destroy(set);
}

static struct environment *sun_alone(void)
{
    struct frame f = sky_constant(64, 32, 0.0f);

    sky_paint(&f, 20, 8, 1e4f, 9e3f, 7e3f);
    sky_paint(&f, 21, 8, 2e3f, 2e3f, 2e3f);
    return sky_environment(f, 32, 0.0);
}

/* Overcast, then from one frame to the next nothing but a sun: within sixteen frames all that is in use has been
 * measured under it. */
static void another_sky_is_measured_anew_within_sixteen_frames(void **state)
{
    struct prepared_scene *set = set_of(&(struct prepared_scene_desc){ .width = WIDTH, .height = HEIGHT });
    struct environment *dull = sky_environment(sky_overcast(64, 32), 32, 0.0), *sun = sun_alone();
    const struct relight_desc light = { .classes = PATH_BACKGROUND | PATH_DIRECT };
    const struct budget_target target = { .seconds = 0.05 };
    struct relight_stats stats;
    struct pilot_stats before, said;
    (void)state;

    struct pilot *p = pilot_of(set);
    fly(p, dull, &light, target, 12, rgb, &stats, &before);
    assert_true(before.readings > 2);
    for (uint64_t k = 1; k <= 16; k++) {
        fly(p, sun, &light, target, 1, rgb, &stats, &said);
        assert_int_equal(said.frames, k);
        assert_true(said.readings <= 4 * k); /* those of the other sky count no more */
    }
    printf("overcast: %.2g; sun: %.2g by %u readings\n", before.error, said.error, said.readings);
    assert_true(said.readings >= 2);
    pilot_end(p);
    environment_destroy(dull);
    environment_destroy(sun);
    set_destroy(set);
}

/* Counts too: with another count the noise is another. */
static bool same_choice(const struct pilot_stats *a, const struct pilot_stats *b)
{
    for (int k = 0; k < PILOT_PARTS; k++)
        if (strcmp(a->part[k].name, b->part[k].name) != 0 || a->part[k].n != b->part[k].n)
            return false;
    return true;
}

/* From the tenth of 40 frames on: the time is kept to, measuring takes a twentieth, and ways and counts stand still but
 * where something better has been found. */
static void a_sky_that_stands_still_has_a_steady_image_in_time(void **state)
{
    struct prepared_scene *set = set_of(&(struct prepared_scene_desc){ .width = WIDTH, .height = HEIGHT });
    struct pilot *p = pilot_of(set);
    struct environment *e = sky_environment(sky_with_sun(64, 32, 1e5f), 32, 0.0);
    const struct relight_desc light = { .classes = PATH_ALL };
    struct budget_target target = { .seconds = seeds_count(6, 10) / 100.0 };
    struct relight_stats stats;
    struct pilot_stats said, last;
    double all = 0.0, own = 0.0;
    int changes = 0;
    (void)state;

    fly(p, e, &light, target, 10, rgb, &stats, &last);
    for (int k = 0; k < 30; k++) {
        fly(p, e, &light, target, 1, rgb, &stats, &said);
        all += said.seconds;
        own += said.pilot_seconds;
        changes += !same_choice(&said, &last);
        last = said;
    }
    printf("%.1f ms a frame of %.0f, %.1f %% of it for measuring, %d changes; relMSE %.2g\n", 1e3 / 30.0 * all,
           1e3 * target.seconds, 100.0 * own / all, changes, said.error);
    assert_true(all / 30.0 < 1.05 * target.seconds && all / 30.0 > 0.85 * target.seconds);
    assert_true(own / all < 0.07);
    assert_true(changes <= 4);
    pilot_end(p);
    environment_destroy(e);
    set_destroy(set);
}

static void an_error_is_met_by_time(void **state)
{
    struct prepared_scene *set = set_of(&(struct prepared_scene_desc){ .width = WIDTH, .height = HEIGHT });
    struct environment *e = sky_environment(sky_overcast(64, 32), 32, 0.0);
    const struct relight_desc light = { .classes = PATH_BACKGROUND | PATH_DIRECT };
    struct relight_stats stats;
    struct pilot_stats coarse, fine;
    (void)state;

    struct pilot *p = pilot_of(set);
    fly(p, e, &light, (struct budget_target){ .error = 1e-2 }, 8, rgb, &stats, &coarse);
    fly(p, e, &light, (struct budget_target){ .error = 1e-3 }, 8, rgb, &stats, &fine);
    printf("relMSE %.2g in %.3f s, %.2g in %.3f s\n", coarse.error, coarse.seconds, fine.error, fine.seconds);
    assert_true(coarse.met && fine.met);
    assert_true(coarse.error < 1.15e-2 && fine.error < 1.15e-3 && fine.error > 0.5e-3);
    assert_true(fine.seconds > 1.5 * coarse.seconds);
    pilot_end(p);
    environment_destroy(e);
    set_destroy(set);
}

/* Before the first image particles have a reading, as all else has; the other is the image's own. */
static void particles_are_measured_before_the_first_image(void **state)
{
    struct prepared_scene *set = set_of(&(struct prepared_scene_desc){ .width = WIDTH, .height = HEIGHT });
    struct environment *e = sky_environment(sky_overcast(64, 32), 32, 0.0);
    const struct relight_desc light = { .classes = PATH_ALL, .indirect = PLAN_LIGHT };
    struct pilot *p = pilot_of(set);
    struct relight_stats stats;
    struct pilot_stats said;
    (void)state;

    fly(p, e, &light, (struct budget_target){ .error = 0.5 }, 1, rgb, &stats, &said);
    assert_true(said.part[PILOT_WHOLE].n > 0.0);
    assert_int_equal(p->model[PILOT_WHOLE].fresh, 2);
    pilot_end(p);
    environment_destroy(e);
    set_destroy(set);
}

/* An image that turns out to be worse than it was chosen for has not met its target. */
static void a_target_is_met_by_the_image_not_by_its_choice(void **state)
{
    struct prepared_scene *set = set_of(&(struct prepared_scene_desc){ .width = WIDTH, .height = HEIGHT });
    struct environment *e = sky_environment(sky_overcast(64, 32), 32, 0.0);
    struct relight_desc light = { .classes = PATH_BACKGROUND | PATH_DIRECT };
    const struct budget_target target = { .error = 1e-2 };
    struct pilot *p = pilot_of(set);
    struct relight_stats stats;
    struct pilot_stats said;
    (void)state;

    fly(p, e, &light, target, 4, rgb, &stats, &said);
    assert_true(said.met);
    p->model[PILOT_DIRECT].variance *= 1e-3;
    p->model[PILOT_DIRECT].count = 1;
    p->bank_s = 1.0;
    fly(p, e, &light, target, 1, rgb, &stats, &said);
    assert_true(said.error > target.error);
    assert_false(said.met);
    /* Nor if only the audit finds it. */
    p->model[PILOT_DIRECT].variance *= 1e-3;
    p->model[PILOT_DIRECT].count = 1000;
    p->bank_s = -1e3;
    light.audit = 1.0;
    fly(p, e, &light, target, 1, rgb, &stats, &said);
    assert_true(said.error <= target.error && stats.error > target.error);
    assert_false(said.met);
    pilot_end(p);
    environment_destroy(e);
    set_destroy(set);
}

/* A hundredth and a tenth of the time that the fewest samples take: all light is there, filtered, and it is said that
 * the time is too short. With enough time nothing is filtered. */
static void nothing_is_left_out_where_the_time_is_short(void **state)
{
    static const double seconds[] = { 1e-4, 1e-3, 0.006, 1.0 };
    struct prepared_scene *set = set_of(&(struct prepared_scene_desc){ .width = WIDTH, .height = HEIGHT });
    struct environment *e = sky_environment(sky_with_sun(64, 32, 1e5f), 32, 0.0);
    const struct relight_desc light = { .classes = PATH_ALL };
    (void)state;

    for (size_t k = 0; k < sizeof(seconds) / sizeof(seconds[0]); k++) {
        const bool enough = seconds[k] == 1.0;
        struct pilot *p = pilot_of(set);
        for (int frame = 0; frame < (enough ? 1 : 20); frame++) {
            struct relight_stats stats;
            struct pilot_stats said;
            fly(p, e, &light, (struct budget_target){ .seconds = seconds[k] }, 1, rgb, &stats, &said);
            assert_int_equal(stats.plan.indirect, PLAN_EYE);
            assert_false(says(&stats, "indirect light"));
            assert_true(said.part[PILOT_EYE].n >= 1.0 && stats.eye.paths > 0);
            assert_true(said.denoised == !enough && !stats.bias == enough);
            assert_true(said.in_time == enough && said.met == enough);
        }
        pilot_end(p);
    }
    environment_destroy(e);
    set_destroy(set);
}

/* Counts that the user names are kept to. */
static void named_counts_and_estimators_are_kept_to(void **state)
{
    struct prepared_scene *set = set_of(&(struct prepared_scene_desc){ .width = WIDTH, .height = HEIGHT });
    struct pilot *p = pilot_of(set);
    struct environment *e = sky_environment(sky_overcast(64, 32), 32, 0.0);
    const struct relight_desc light = { .classes = PATH_ALL, .indirect = PLAN_EYE, .eye_paths = 3 };
    struct relight_stats stats;
    struct pilot_stats said;
    (void)state;

    fly(p, e, &light, (struct budget_target){ .error = 0.1 }, 4, rgb, &stats, &said);
    assert_int_equal(stats.plan.eye_paths, 3);
    assert_int_equal(stats.plan.indirect, PLAN_EYE);
    assert_int_equal(stats.eye.paths, 3 * set->gbuffer->point_count);
    pilot_end(p);
    environment_destroy(e);
    set_destroy(set);
}

static void a_black_sky_is_no_trouble(void **state)
{
    struct prepared_scene *set = set_of(&(struct prepared_scene_desc){ .width = WIDTH, .height = HEIGHT });
    struct pilot *p = pilot_of(set);
    struct environment *black = sky_environment(sky_constant(64, 32, 0.0f), 32, 0.0);
    struct environment *dull = sky_environment(sky_overcast(64, 32), 32, 0.0);
    const struct relight_desc light = { .classes = PATH_ALL };
    const struct budget_target target = { .seconds = 0.05 };
    struct relight_stats stats;
    struct pilot_stats said;
    (void)state;

    fly(p, black, &light, target, 3, rgb, &stats, &said);
    assert_true(said.error == 0.0);
    for (size_t i = 0; i < sizeof(rgb) / sizeof(rgb[0]); i++)
        assert_true(rgb[i] == 0.0f);
    fly(p, dull, &light, target, 6, rgb, &stats, &said);
    assert_true(said.error > 0.0 && said.error < 0.2);
    fly(p, black, &light, target, 2, rgb, &stats, &said);
    assert_true(isfinite(said.error));
    pilot_end(p);
    environment_destroy(black);
    environment_destroy(dull);
    set_destroy(set);
}

/* Direct light alone, a sample of which costs 1 ms: of an image's time, a fiftieth goes to measurements of what is
 * known well and `other` seconds on what follows from points to pixels, and samples fill the rest, but never less than
 * a fifth. */
static void samples_fill_what_is_left_of_the_time(void **state)
{
    static const struct {
        double seconds, other, n;
    } cases[] = { { 0.1, 0.02, 78.0 }, { 0.1, 0.0, 98.0 }, { 0.1, 1.0, 20.0 }, { 2.0, 0.4, 1560.0 } };
    const struct environment sky = { .total_energy = 1.0 };
    (void)state;

    for (size_t k = 0; k < sizeof(cases) / sizeof(cases[0]); k++) {
        struct pilot *p = mem_alloc(1, sizeof(*p));
        assert_non_null(p);
        p->environment = &sky;
        p->begun = p->offered[PILOT_DIRECT] = true;
        p->runs = 1;
        p->other_s = cases[k].other;
        p->model[PILOT_DIRECT] = (struct model){ .variance = 1.0, .unit_s = 1e-3, .fresh = 1000, .known = true };
        pilot_choose(p, &(struct budget_target){ .seconds = cases[k].seconds });
        if (fabs(p->n[PILOT_DIRECT] - cases[k].n) > 1e-6)
            fail_msg("%.9g samples, want %g", p->n[PILOT_DIRECT], cases[k].n);
        mem_free(p);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_scene_without_mirrors_runs_no_caustics),
    cmocka_unit_test(an_overcast_sky_gets_no_samples_of_a_sun),
    cmocka_unit_test(another_sky_is_measured_anew_within_sixteen_frames),
    cmocka_unit_test(a_sky_that_stands_still_has_a_steady_image_in_time),
    cmocka_unit_test(an_error_is_met_by_time),
    cmocka_unit_test(particles_are_measured_before_the_first_image),
    cmocka_unit_test(a_target_is_met_by_the_image_not_by_its_choice),
    cmocka_unit_test(nothing_is_left_out_where_the_time_is_short),
    cmocka_unit_test(named_counts_and_estimators_are_kept_to),
    cmocka_unit_test(a_black_sky_is_no_trouble),
    cmocka_unit_test(samples_fill_what_is_left_of_the_time),
};
UNIT_MAIN(tests)
