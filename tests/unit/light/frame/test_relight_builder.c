/* The thread that computes or loads both caches: what it leaves to its relighter at the end. */
#include "light/frame/relight_cache.h"
#include "light/frame/stage.h"
#include "scene/geometry/files.h"

#include <time.h>

/* Loaded where only direct light has room: indirect light is refused for good, so that no image waits for another try,
 * and direct light serves. With room, both are there. */
static void what_has_no_room_is_refused_for_good(void **state)
{
    const struct prepared_scene_desc small = { .width = 8, .height = 8 };
    struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 16 },
                                  .classes = PATH_DIRECT | PATH_INDIRECT };
    struct stage s = stage_make(&small, sky_with_sun(64, 32, 2e3f));
    struct relight_stats stats;
    struct folder folder;
    double ms;
    (void)state;

    folder_make(&folder);
    light.cache_file = folder_write(&folder, "kept", "", 0);
    assert_int_equal(stage_run(&s, &light, &stats), ERR_OK);
    assert_true(stats.cache.bytes > 0 && stats.indirect.bytes > 10000);
    light.cache_background = true;
    for (int room = 0; room < 2; room++) {
        struct relight_cache c = { .transport = NULL };
        light.cache_bytes = stats.cache.bytes + (room ? 2 * stats.indirect.bytes : 10000);
        assert_int_equal(relight_cache_make(&c, s.set, best_kernels(), &light, false, &ms), ERR_OK);
        while (relight_cache_follow(&c) < 1.0)
            nanosleep(&(struct timespec){ .tv_nsec = 1000000 }, NULL);
        assert_true(c.loaded && c.transport && !c.refused);
        assert_int_equal(c.indirect.refused, !room);
        assert_int_equal(c.indirect.loaded, room);
        assert_int_equal(c.indirect.indirect != NULL, room);
        relight_cache_finish(&c);
    }
    stage_finish(&s);
    folder_remove(&folder);
}

/* A cache that finds no room leaves nothing behind, also for the audit of a live image. */
static void images_without_room_for_a_cache_are_audited(void **state)
{
    struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 16 },
                                  .classes = PATH_DIRECT,
                                  .cache_bytes = 1,
                                  .cache_background = true,
                                  .audit_live = true };
    struct stage s = stage_make(&(struct prepared_scene_desc){ .width = 32, .height = 18 }, sky_constant(64, 32, 1.0f));
    struct relight_stats stats = { .cache_refused = false };
    uint64_t audited = 0;
    int estimates = 0;
    (void)state;

    for (int after = 0; after < 8; after += stats.cache_refused) { /* several pay for an audit together */
        light.audit = stats.cache_refused ? 20.0 : 0.0; /* rays from before would be kept, and none traced */
        assert_int_equal(stage_run(&s, &light, &stats), ERR_OK);
        audited += stats.cache_refused ? stats.audited.rays : 0;
        estimates += stats.cache_refused && stats.error > 0.0;
    }
    printf("%.0f rays, %d estimates\n", (double)audited, estimates);
    assert_true(audited > 0 && estimates > 0); /* as of any image by auto; by a cache there are bounds only */
    stage_finish(&s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(what_has_no_room_is_refused_for_good),
    cmocka_unit_test(images_without_room_for_a_cache_are_audited),
};
UNIT_MAIN(tests)
