/* The relighter's indirect light by a cache: who takes which light when there is one, so that none is taken twice. */
#include "light/frame/stage.h"
#include "scene/geometry/files.h"

#include <time.h>
#include <unistd.h>

enum { WIDTH = 48, HEIGHT = 27, SMALL_WIDTH = 16, SMALL_HEIGHT = 9 };

static struct stage court(uint32_t width, uint32_t height)
{
    return stage_make(&(struct prepared_scene_desc){ .width = width, .height = height }, sky_with_sun(64, 32, 2e3f));
}

/* The sum over the shade points. */
static double run(struct stage *s, const struct relight_desc *light, struct relight_stats *stats)
{
    double sum = 0.0;

    assert_int_equal(stage_run(s, light, stats), ERR_OK);
    for (size_t i = 0; i < (size_t)s->set->gbuffer->packet_count * 3 * PACKET; i++)
        sum += (double)relighter_points(s->relighter)[i];
    return sum;
}

/* In the built-in court a fifth of the light is indirect light: taken twice, or not at all, it is ten times what is
 * allowed here. 32 eye paths of each of 10 000 points, 0.15 % of noise in the sum. None of its
 * lobes is so narrow that eye paths have to follow it. */
static void each_light_is_taken_once(void **state)
{
    struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 64 },
                                  .classes = PATH_DIRECT | PATH_INDIRECT };
    struct stage s = court(WIDTH, HEIGHT);
    struct relight_stats stats, again;
    (void)state;

    const double cached = run(&s, &light, &stats);
    assert_int_equal(stats.plan.indirect, PLAN_CACHE);
    assert_true(stats.indirect.records > 0 && stats.indirect.bytes > 0);
    assert_true(stats.cache.narrow > 0 && stats.eye.paths == 0);
    assert_non_null(strstr(stats.bias, "records"));
    assert_true(run(&s, &light, &again) == cached && again.cache_ms == 0.0);
    light.classes = PATH_DIRECT;
    const double direct = run(&s, &light, &stats);
    assert_true(stats.indirect.records == 0 && !strstr(stats.bias, "records"));
    light.classes = PATH_DIRECT | PATH_INDIRECT;
    light.indirect = PLAN_EYE;
    light.eye_paths = 32;
    const double by_eye = run(&s, &light, &stats);
    assert_int_equal(stats.plan.indirect, PLAN_EYE);
    assert_true(stats.indirect.records == 0);
    printf("direct %.1f, with indirect light %.1f, by eye paths %.1f\n", direct, cached, by_eye);
    assert_true(by_eye > 1.1 * direct);
    assert_true(fabs((cached - direct) / (by_eye - direct) - 1.0) < 0.03);
    stage_finish(&s);
}

/* Both caches share what they may take; what is left to the second does not suffice here, and eye paths do its work. */
static void what_has_no_room_is_left_to_eye_paths(void **state)
{
    struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 16 }, .classes = PATH_DIRECT };
    struct stage s = court(SMALL_WIDTH, SMALL_HEIGHT);
    struct relight_stats stats;
    (void)state;

    run(&s, &light, &stats);
    light.cache_bytes = stats.cache.bytes + 10000;
    light.eye_paths = 1;
    light.classes = PATH_DIRECT | PATH_INDIRECT;
    run(&s, &light, &stats);
    assert_int_equal(stats.plan.indirect, PLAN_EYE);
    assert_true(stats.indirect.records == 0 && stats.eye.paths > 0);
    stage_finish(&s);
}

/* What one run has made, direct light first and then both, the next one loads, and has the same bits; a run for direct
 * light alone leaves the file as it is. */
static void another_run_loads_what_one_has_gathered(void **state)
{
    struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 16 },
                                  .classes = PATH_DIRECT | PATH_INDIRECT };
    struct relight_stats stats;
    struct folder folder;
    float *first = NULL;
    (void)state;

    folder_make(&folder);
    light.cache_file = folder_write(&folder, "kept", "", 0);
    for (int k = 0; k < 3; k++) {
        struct stage s = court(SMALL_WIDTH, SMALL_HEIGHT);
        const size_t size = (size_t)SMALL_WIDTH * SMALL_HEIGHT * 3 * sizeof(float);
        light.classes = k == 1 ? PATH_DIRECT : PATH_DIRECT | PATH_INDIRECT;
        run(&s, &light, &stats);
        assert_true(stats.cache_loaded == (k > 0) && stats.indirect_loaded == (k == 2));
        if (k == 0)
            memcpy(first = mem_alloc(size, 1), s.rgb, size);
        if (k == 2)
            assert_memory_equal(first, s.rgb, size);
        stage_finish(&s);
    }
    mem_free(first);
    folder_remove(&folder);
}

/* Killed once indirect light is computed: the next run loads that, computes direct light, and has the same bits. */
static void a_killed_run_leaves_what_it_has(void **state)
{
    struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 16 },
                                  .classes = PATH_DIRECT | PATH_INDIRECT };
    const struct prepared_scene_desc small = { .width = SMALL_WIDTH, .height = SMALL_HEIGHT };
    const size_t size = (size_t)3 * SMALL_WIDTH * SMALL_HEIGHT * sizeof(float);
    struct stage s = stage_make(&small, sky_with_sun(64, 32, 2e3f));
    struct relight_stats stats;
    struct folder folder;
    double ms;
    (void)state;

    folder_make(&folder);
    const char *file = folder_write(&folder, "kept", "", 0);
    assert_int_equal(unlink(file), 0);
    float *want = mem_alloc(size, 1);
    run(&s, &light, &stats);
    memcpy(want, s.rgb, size);
    stage_finish(&s);
    light.cache_file = file;
    light.cache_background = true;
    s = stage_make(&small, sky_with_sun(64, 32, 2e3f));
    assert_int_equal(relighter_prepare(s.relighter, &light, false, &ms), ERR_OK);
    while (access(file, F_OK) != 0)
        nanosleep(&(struct timespec){ .tv_nsec = 1000000 }, NULL);
    stage_finish(&s);
    s = stage_make(&small, sky_with_sun(64, 32, 2e3f));
    assert_int_equal(relighter_prepare(s.relighter, &light, false, &ms), ERR_OK);
    light.cache_background = false;
    run(&s, &light, &stats);
    assert_true(!stats.cache_loaded && stats.indirect_loaded);
    assert_memory_equal(want, s.rgb, size);
    stage_finish(&s);
    s = stage_make(&small, sky_with_sun(64, 32, 2e3f)); /* the file has both by now */
    run(&s, &light, &stats);
    assert_true(stats.cache_loaded && stats.indirect_loaded);
    assert_memory_equal(want, s.rgb, size);
    mem_free(want);
    stage_finish(&s);
    folder_remove(&folder);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(each_light_is_taken_once),
    cmocka_unit_test(what_has_no_room_is_left_to_eye_paths),
    cmocka_unit_test(another_run_loads_what_one_has_gathered),
    cmocka_unit_test(a_killed_run_leaves_what_it_has),
};
UNIT_MAIN(tests)
