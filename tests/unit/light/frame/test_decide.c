/* auto and the cache of light transport: what the relighter is told to do, and what becomes of the frames. */
#include "light/denoise/denoise.h"
#include "light/estimators/points.h"
#include "light/frame/decide.h"
#include "support/kept.h"

#include <time.h>
#include <unistd.h>

enum { WIDTH = 24, HEIGHT = 14, VALUES = 3 * WIDTH * HEIGHT };

static struct prepared_scene *set;
static struct environment *sky;
static const struct relight_desc sampled = { .direct = { .method = METHOD_AUTO, .samples = 64 } };

static int set_up(void **state)
{
    const struct prepared_scene_desc desc = { .width = WIDTH, .height = HEIGHT };
    struct reason why;
    (void)state;

    sky = sky_environment(sky_with_sun(64, 32, 2e3f), 64, 0.0);
    return set_create(&desc, &set, &why) != ERR_OK;
}

static int tear_down(void **state)
{
    (void)state;
    set_destroy(set);
    environment_destroy(sky);
    return 0;
}

static struct relighter *make(void)
{
    struct relighter *r = relighter_create(set, best_kernels());
    assert_non_null(r);
    return r;
}

static void run(struct relighter *r, const struct relight_desc *light, float *rgb, struct relight_stats *stats)
{
    assert_int_equal(relighter_run(r, sky, light, rgb, stats), ERR_OK);
}

static bool is_cached(double allow_bias, struct relight_desc light)
{
    struct relighter *r = make();
    struct decider d = { .pilot = NULL };
    double ms;

    assert_int_equal(decider_prepare(&d, r, allow_bias, false, &light, &ms), ERR_OK);
    assert_true(d.cache.last.yes == (light.direct.method == METHOD_CACHED));
    relighter_destroy(r);
    return d.cache.last.yes;
}

/* And whoever says how auto is to sample means that it does. */
static void bias_is_allowed_and_wishes_are_kept_to(void **state)
{
    struct relight_desc light = sampled;
    (void)state;

    assert_true(is_cached(COST_BIAS, light));
    assert_false(is_cached(0.99 * COST_BIAS, light));
    assert_false(is_cached(0.0, light));
    light.direct.method = METHOD_MIS;
    assert_false(is_cached(1.0, light));
    light = sampled;
    light.direct.cells = 4;
    assert_false(is_cached(1.0, light));
    light = sampled;
    light.direct.no_visibility = true;
    assert_false(is_cached(1.0, light));
    light = sampled;
    light.classes = PATH_INDIRECT;
    assert_false(is_cached(1.0, light));
    light = sampled;
    light.cache_bytes = 1000; /* there is no room for it */
    assert_false(is_cached(1.0, light));
}

/* The image is that of --method cached. */
static void its_images_are_those_of_the_cache(void **state)
{
    static float want[VALUES], got[VALUES];
    struct relight_desc light = sampled, cached = sampled;
    struct relighter *one = make(), *other = make();
    struct decider d = { .pilot = NULL };
    struct relight_stats stats;
    double ms;
    (void)state;

    assert_int_equal(decider_prepare(&d, one, 1.0, false, &light, &ms), ERR_OK);
    run(one, &light, got, &stats);
    cached.direct.method = METHOD_CACHED;
    cached.cache_if_kept = true;
    assert_int_equal(relighter_prepare(other, &cached, false, &ms), ERR_OK);
    assert_true(relighter_follow(other) == 0.0);
    cached.cache_if_kept = false;
    run(other, &cached, want, &stats);
    assert_memory_equal(got, want, sizeof(want));
    relighter_destroy(one);
    relighter_destroy(other);
}

static const struct frame_request in_time = { .asked = &sampled, .target.seconds = 0.1, .allow_bias = 1.0 };

/* What is decided for a frame, after another that was measured: its light took a second, of 2000 samples a point. The
 * cache is to take a little more than one. */
static struct frame_request step(struct decider *d, struct relighter *r, double error,
                                 const struct frame_request *request)
{
    const struct pilot_stats measured = { .seconds = 1.0, .error = error };
    struct relight_stats stats = { .shade_ms = 1e3 };
    struct frame_request decided = *request;

    stats.direct.rays = 2000 * set->gbuffer->point_count;
    decide(d, &decided);
    decider_learn(d, r, &decided, &stats, &measured);
    decide(d, &decided);
    return decided;
}

/* Who decides: a named method, counts, a time, and whether the cache is there. */
static void each_request_has_one_answer(void **state)
{
    struct decider d = { .pilot = NULL };
    struct relight_desc light = sampled;
    struct frame_request request = { .asked = &light };
    (void)state;

    decide(&d, &request);
    assert_int_equal(request.by, DECIDED_BY_RULE);
    request.target.seconds = 0.1;
    decide(&d, &request);
    assert_int_equal(request.by, DECIDED_BY_MEASURES);
    d.cache.ready = true;
    decide(&d, &request);
    assert_int_equal(request.by, DECIDED_BY_CACHE);
    assert_int_equal(request.light.direct.method, METHOD_CACHED);
    light.direct.no_visibility = true; /* which the cache has not */
    decide(&d, &request);
    assert_int_equal(request.by, DECIDED_BY_MEASURES);
    d.cache.ready = false;
    light.direct.method = METHOD_MIS;
    decide(&d, &request);
    assert_int_equal(request.by, DECIDED_BY_REQUEST);
    assert_int_equal(request.light.direct.method, METHOD_MIS);
}

/* Beside the frames, once they have cost as much; then frames are made by it: grainy ones by its coarse blocks. */
static void gets_it_in_the_background(double error)
{
    static float rgb[VALUES];
    double share = 0.0;
    struct frame_request request = in_time;
    struct frame_request decision = in_time;
    struct relighter *r = make();
    struct decider d = { .pilot = NULL };
    struct relight_stats stats;
    uint32_t steps = 0;

    request.background = true;
    for (; !d.cache.begun && steps < 100; steps++)
        decision = step(&d, r, error, &request);
    assert_int_equal(steps, COST_MADE); /* a second for the computation, and some frames to believe it */
    assert_int_equal(decision.by, DECIDED_BY_MEASURES);
    for (steps = 0; decision.by != DECIDED_BY_CACHE && steps < 150000;
         steps++) { /* some minutes: a sanitizer may have it slow */
        nanosleep(&(struct timespec){ .tv_nsec = 2000000 }, NULL);
        decision = step(&d, r, error, &request);
    }
    assert_int_equal(decision.by, DECIDED_BY_CACHE);
    assert_true(decision.light.cache_background);
    for (steps = 0; share < 1.0 && steps < 30000; steps++) {
        nanosleep(&(struct timespec){ .tv_nsec = 50000000 }, NULL); /* leaves the processor to the cache */
        run(r, &decision.light, rgb, &stats);
        share = stats.cache_share;
        assert_true(share >= RELIGHT_COARSE && stats.cache_ms == 0.0 && stats.cache.bytes > 0);
        assert_true(steps > 0 || error > COST_BIAS_COARSE ? true : share == 1.0);
    }
    assert_true(share == 1.0);
    assert_int_equal(step(&d, r, error, &request).by, DECIDED_BY_CACHE);
    stats.cache_refused = true; /* its memory is gone */
    decider_learn(&d, r, &decision, &stats, &(struct pilot_stats){ .seconds = 0.0 });
    assert_int_equal(step(&d, r, error, &request).by, DECIDED_BY_MEASURES);
    assert_true(d.cache.refused);
    relighter_destroy(r);
}

static void a_stream_of_frames_gets_it_in_the_background(void **state)
{
    (void)state;
    gets_it_in_the_background(1e-2);
    gets_it_in_the_background(0.9 * COST_BIAS_COARSE);
}

/* The first live image takes few samples and waits for no audit, and the second follows it at once; then the cache
 * needs the processors. */
static void first_images_hurry(void **state)
{
    struct relight_desc light = sampled;
    struct frame_request request = { .asked = &light, .target.seconds = 0.1, .allow_bias = 1.0, .background = true };
    struct relight_stats stats = { .shade_ms = 1.0 };
    struct relighter *r = make();
    struct decider d = { .pilot = NULL };
    struct frame_request first, next;
    (void)state;

    light.classes = PATH_ALL;
    light.audit = 0.05;
    first = next = request;
    decider_begin(&d, r, &request);
    decide(&d, &first);
    assert_true(first.by == DECIDED_BY_RULE && first.light.denoise && first.light.remember);
    decider_learn(&d, r, &first, &stats, &(struct pilot_stats){ .seconds = 0.0 });
    assert_true(d.cache.begun && decider_interval_s(&d) == 0.0);
    decide(&d, &next);
    assert_true(next.light.denoise && next.light.direct.samples == 2 * first.light.direct.samples);
    assert_true(first.light.audit == 0.0 && next.light.audit == light.audit);
    for (stats.glides = ACCUMULATION_GLIDE;
         stats.glides-- > 0;) { /* its light is displayed step by step, at any rate */
        decider_learn(&d, r, &next, &stats, &(struct pilot_stats){ .seconds = 0.0 });
        assert_true(d.cache.ready || (stats.glides > 0) == (decider_interval_s(&d) == 0.0));
        decide(&d, &next);
        assert_true(d.cache.ready || next.light.audit == light.audit);
    }
    relighter_destroy(r);
}

/* What some earlier run has left is taken after the first frame; a better image than it can make is not given up. */
static void a_file_is_taken_after_one_frame(void **state)
{
    struct frame_request known = in_time, strict = in_time, last = in_time;
    struct relight_desc cached = sampled, kept = sampled;
    struct relighter *r = make();
    struct decider d = { .pilot = NULL };
    char folder[32] = "/tmp/relight-decide-XXXXXX";
    double ms;
    (void)state;

    assert_non_null(mkdtemp(folder));
    kept.cache_file = cached.cache_file = "";
    kept.cache_dir = cached.cache_dir = folder;
    known.asked = strict.asked = last.asked = &kept;
    known.frames_left = 1;
    strict.frames_left = 1000;
    strict.target.error = 1e-4;
    last.no_cache = true;
    step(&d, r, 1e-2, &known); /* no file: two frames are no reason to compute it */
    assert_false(d.cache.ready || d.cache.begun);
    cached.direct.method = METHOD_CACHED;
    assert_int_equal(relighter_prepare(r, &cached, false, &ms), ERR_OK);
    relighter_destroy(r);
    r = make();
    d = (struct decider){ .pilot = NULL };
    step(&d, r, 1e-2, &strict);
    step(&d, r, 1e-2, &last);
    assert_false(d.cache.ready || d.cache.looked_for);
    assert_int_equal(step(&d, r, 1e-2, &known).by, DECIDED_BY_CACHE);
    relighter_destroy(r);
    kept_remove(folder);
}

/* All of it, indirect light too: reading it takes less time than one image by other means. */
static void a_kept_cache_makes_the_first_image(void **state)
{
    struct relight_desc light = sampled, cached;
    struct frame_request request = { .asked = &light, .target.seconds = 0.1, .allow_bias = 1.0, .background = true };
    struct relighter *r = make();
    char folder[32] = "/tmp/relight-decide-XXXXXX";
    struct decider d = { .pilot = NULL };
    double ms;
    (void)state;

    assert_non_null(mkdtemp(folder));
    light.classes = PATH_ALL;
    light.cache_file = "";
    light.cache_dir = folder;
    cached = light;
    cached.direct.method = METHOD_CACHED;
    assert_int_equal(relighter_prepare(r, &cached, false, &ms), ERR_OK);
    relighter_destroy(r);
    r = make();
    decider_begin(&d, r, &request);
    decide(&d, &request);
    assert_int_equal(request.by, DECIDED_BY_CACHE);
    assert_false(decider_is_computing(&d, r));
    relighter_destroy(r);
    kept_remove(folder);
}

/* A cache without room is given up once, with a warning in the log: the frames' requests succeed, so that their reason
 * stays as it is. */
static void what_has_no_room_is_no_ones_error(void **state)
{
    struct reason why = { "as it was" };
    struct relight_desc light = sampled;
    struct frame_request request = in_time;
    struct decider d = { .pilot = NULL };
    struct relighter *r = make();
    (void)state;

    light.direct.why = &why;
    light.cache_bytes = 1000;
    request.asked = &light;
    request.frames_left = 1000;
    for (uint32_t k = 0; k < COST_MADE; k++)
        assert_int_equal(step(&d, r, 1e-2, &request).by, DECIDED_BY_MEASURES);
    assert_true(d.cache.looked_for && d.cache.last.yes && d.cache.refused);
    assert_false(d.cache.begun || d.cache.ready);
    assert_string_equal(why.text, "as it was");
    relighter_destroy(r);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(each_request_has_one_answer),
    cmocka_unit_test_setup_teardown(bias_is_allowed_and_wishes_are_kept_to, set_up, tear_down),
    cmocka_unit_test_setup_teardown(its_images_are_those_of_the_cache, set_up, tear_down),
    cmocka_unit_test_setup_teardown(a_stream_of_frames_gets_it_in_the_background, set_up, tear_down),
    cmocka_unit_test_setup_teardown(first_images_hurry, set_up, tear_down),
    cmocka_unit_test_setup_teardown(a_kept_cache_makes_the_first_image, set_up, tear_down),
    cmocka_unit_test_setup_teardown(a_file_is_taken_after_one_frame, set_up, tear_down),
    cmocka_unit_test_setup_teardown(what_has_no_room_is_no_ones_error, set_up, tear_down),
};
UNIT_MAIN(tests)
