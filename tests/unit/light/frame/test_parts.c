/* What a frame is made of, each by itself, on numbers worked out by hand. */
#include "light/estimators/points.h"
#include "light/frame/decide.h"
#include "light/frame/layers.h"
#include "light/frame/pilot.h"
#include "light/frame/refine.h"
#include "light/frame/relight_cache.h"
#include "support/sets.h"

static void assert_near(double got, double want, double allowed)
{
    if (!(fabs(got - want) <= allowed))
        fail_msg("%.9g, want %.9g within %.2g", got, want, allowed);
}

/* Of 17 parts the first is coarse direct light, or the quick cache of indirect light, after which the second is coarse
 * direct light; the rest is what is fine, half of it indirect light where that is wanted. */
static void each_stage_has_its_share(void **state)
{
    static const struct {
        struct relight_stages stages;
        double parts;
    } cases[] = {
        { { .coarse = 0.5 }, 0.5 },
        { { .coarse = 1.0, .fine = 0.25 }, 1.0 + 16.0 * 0.25 },
        { { .wanted = true, .quick = 0.5, .coarse = 1.0, .fine = 1.0 }, 0.5 },
        { { .wanted = true, .quick_ended = true, .quick = 1.0, .coarse = 0.5 }, 1.5 },
        { { .wanted = true, .quick_ended = true, .coarse = 1.0, .whole = 0.2 }, 2.0 + 15.0 * 0.1 },
        { { .wanted = true, .quick_ended = true, .coarse = 1.0, .fine = 0.4 }, 2.0 + 15.0 * 0.2 },
        { { .wanted = true, .quick_ended = true, .coarse = 1.0, .fine = 1.0, .whole = 1.0 }, 0.99 * 17.0 },
    };
    (void)state;

    for (size_t k = 0; k < sizeof(cases) / sizeof(cases[0]); k++)
        assert_near(17.0 * relight_share(&cases[k].stages), cases[k].parts, 1e-9);
}

/* Images that differ by 30 in one pixel's green: luminance 0.7152 * 30, squared and divided by three times the 25
 * pixels around, of which a corner has nine and the pixel beside an edge 20; beyond two pixels there is no error. */
static void the_error_is_that_of_25_pixels(void **state)
{
    enum { WIDE = 9, HIGH = 8 };
    static const struct {
        uint32_t at[2], x, y;
        double pixels; /* 0: out of reach */
    } cases[] = { { { 4, 4 }, 4, 4, 25 }, { { 4, 4 }, 2, 6 - 1, 25 }, { { 4, 4 }, 6, 4, 25 }, { { 4, 4 }, 7, 4, 0 },
                  { { 4, 4 }, 1, 4, 0 },  { { 4, 4 }, 4, 1, 0 },      { { 0, 0 }, 0, 0, 9 },  { { 0, 0 }, 2, 2, 25 },
                  { { 8, 7 }, 8, 7, 9 },  { { 8, 7 }, 6, 7, 15 },     { { 8, 4 }, 7, 4, 20 } };
    (void)state;

    for (size_t k = 0; k < sizeof(cases) / sizeof(cases[0]); k++) {
        float whole[HIGH][WIDE][3] = { { { 0 } } }, half[HIGH][WIDE][3] = { { { 0 } } };
        whole[cases[k].at[1]][cases[k].at[0]][1] = 10.0f;
        half[cases[k].at[1]][cases[k].at[0]][1] = -20.0f;
        const double got = (double)layers_error(whole[0][0], half[0][0], WIDE, HIGH, cases[k].x, cases[k].y);
        assert_near(got, cases[k].pixels > 0.0 ? 0.7152 * 30.0 / sqrt(3.0 * cases[k].pixels) : 0.0, 1e-4);
    }
}

/* A frame's time is that without what was spent on trials, in seconds; what was spent on frames is all. The second
 * frame counts in part. */
static void a_frames_time_is_without_its_trials(void **state)
{
    const struct relight_desc light = { .direct = { .method = METHOD_AUTO, .samples = 16 } };
    const struct frame_request request = {
        .asked = &light, .target.seconds = 2.0, .frames_left = 1, .by = DECIDED_BY_MEASURES, .light = light
    };
    const struct prepared_scene_desc small = { .width = 8, .height = 8 };
    struct relight_stats stats = { .shade_ms = 500.0, .direct = { .rays = 1000 } };
    struct pilot_stats measured = { .seconds = 2.0, .pilot_seconds = 0.5 };
    struct decider d = { .pilot = NULL };
    struct prepared_scene *set = set_of(&small);
    struct relighter *r = relighter_create(set, best_kernels());
    (void)state;

    decider_learn(&d, r, &request, &stats, &measured);
    assert_near(d.cache.frame_s, 1.5, 1e-12);
    assert_near(d.cache.sample_s, 0.5e-3, 1e-12);
    assert_near(d.cache.spent_s, 2.0, 1e-12);
    measured.seconds = 3.0;
    decider_learn(&d, r, &request, &stats, &measured);
    assert_true(d.cache.frame_s > 1.5 && d.cache.frame_s < 2.5);
    assert_near(d.cache.spent_s, 5.0, 1e-12);
    stats.direct.rays = 0; /* a black sky */
    decider_learn(&d, r, &request, &stats, &measured);
    assert_int_equal(d.cache.measured_frames, 2);
    decider_finish(&d);
    relighter_destroy(r);
    set_destroy(set);
}

/* Passes of 8 x 8 pixels whose mean is m: a first image that is off by less than their noise, m / 1000, is shown as
 * it is; one that is m itself differs by nothing and has no weight, and one that is far off has little. */
static void a_first_image_within_the_noise_is_shown(void **state)
{
    enum { VALUES = 3 * 8 * 8 };
    const struct relight_desc light = { .direct = { .method = METHOD_MIS, .samples = 16 } };
    const struct prepared_scene_desc small = { .width = 8, .height = 8 };
    struct environment *e = sky_environment(sky_with_sun(64, 32, 2e3f), 32, 0.0);
    struct prepared_scene *set = set_of(&small);
    struct refiner *s = refiner_create(set, best_kernels());
    float first[VALUES] = { 0.0f }, m[VALUES] = { 0.0f }, got[VALUES];
    struct refiner_stats stats;
    (void)state;

    for (int k = 0; k < 2; k++) {
        for (int i = 0; i < VALUES; i++)
            first[i] = k == 0 ? 1e9f : 1.001f * m[i];
        refiner_begin(s, first);
        for (int pass = 0; pass < 3; pass++)
            assert_int_equal(refiner_pass(s, e, &light), ERR_OK);
        refiner_look(s, &(struct refiner_wish){ 0.0, 0 }, &stats);
        refiner_image(s, got);
        if (k == 0)
            for (int i = 0; i < VALUES; i++)
                m[i] = got[i] - (float)stats.first * 1e9f;
        printf("share of the first image %.3g\n", stats.first);
        if (k == 0)
            assert_true(stats.first < 1e-20);
        else
            assert_near(stats.first, 1.0, 1e-9);
        for (int i = 0; i < VALUES && k == 1; i++)
            assert_near((double)got[i], (double)first[i], 1e-6 * (double)first[i]);
    }
    refiner_destroy(s);
    set_destroy(set);
    environment_destroy(e);
}

/* Each light tracer has its own count: three units of 2,048 particles and five; one that is not there has none. */
static void each_light_tracer_has_its_count(void **state)
{
    static const struct relight_desc light = { .direct = { .method = METHOD_AUTO } };
    struct pilot *p = mem_alloc(1, sizeof(*p));
    (void)state;

    assert_non_null(p);
    p->light = &light;
    for (int k = 0; k < 2; k++) {
        p->offered[PILOT_AIMED + k] = true;
        p->n[PILOT_AIMED + k] = k ? 5.0 : 3.0;
    }
    struct frame_plan plan = pilot_passes(p, 9);
    struct pass *first = frame_plan_find(&plan, PASS_PARTICLES);
    assert_int_equal(first[0].light.particles, 3 * 2048);
    assert_int_equal(first[1].light.particles, 5 * 2048);
    assert_int_equal(first[1].light.pass, 9);
    p->offered[PILOT_AIMED] = false;
    plan = pilot_passes(p, 9);
    first = frame_plan_find(&plan, PASS_PARTICLES);
    assert_int_equal(first->light.particles, 5 * 2048);
    assert_int_not_equal(first[1].kind, PASS_PARTICLES);
    mem_free(p);
}

/* At any brightness: another by more than 30 %, or where more than a twenty-fifth of the light has gone to another
 * face; black before, any is another. */
static void a_sky_is_the_same_within_a_third(void **state)
{
    static const struct {
        double all, moved; /* times the sky; of a sixth of it, to another face */
        bool same;
    } cases[] = { { 1.0, 0.0, true },  { 1.25, 0.0, true }, { 1.35, 0.0, false }, { 0.8, 0.0, true },
                  { 0.7, 0.0, false }, { 1.0, 0.2, true },  { 1.0, 0.3, false },  { 0.0, 0.0, false } };
    (void)state;

    for (int dim = 0; dim < 2; dim++) {
        struct environment *e = sky_environment(sky_constant(32, 16, dim ? 1e-3f : 10.0f), 16, 0.0);
        for (size_t k = 0; k < sizeof(cases) / sizeof(cases[0]); k++) {
            double before[CUBE_FACES];
            for (int f = 0; f < CUBE_FACES; f++)
                before[f] = cases[k].all * e->energy[f];
            before[2] += cases[k].moved * e->energy[0];
            before[0] -= cases[k].moved * e->energy[0];
            if (pilot_same_sky(before, e) != cases[k].same)
                fail_msg("case %zu of %d", k, dim);
        }
        environment_destroy(e);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(each_light_tracer_has_its_count),
    cmocka_unit_test(a_sky_is_the_same_within_a_third),
    cmocka_unit_test(each_stage_has_its_share),
    cmocka_unit_test(the_error_is_that_of_25_pixels),
    cmocka_unit_test(a_frames_time_is_without_its_trials),
    cmocka_unit_test(a_first_image_within_the_noise_is_shown),
};
UNIT_MAIN(tests)
