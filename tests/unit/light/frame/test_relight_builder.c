/* The thread that computes or loads both caches: what it leaves to its relighter at the end. */
#include "light/cache_direct/internal.h"
#include "light/frame/relight_cache.h"
#include "light/frame/stage.h"
#include "scene/geometry/files.h"
#include "sky/daylight/sky.h"

#include <dirent.h>
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
        light.audit = stats.cache_refused ? 20.0 : 0.0;            /* rays from before would be kept, and none traced */
        assert_int_equal(stage_run(&s, &light, &stats), ERR_OK);
        audited += stats.cache_refused ? stats.audited.rays : 0;
        estimates += stats.cache_refused && stats.error > 0.0;
    }
    printf("%.0f rays, %d estimates\n", (double)audited, estimates);
    assert_true(audited > 0 && estimates > 0); /* as of any image by auto; by a cache there are bounds only */
    stage_finish(&s);
}

/* The computed sky at a place and hour of 21 March. */
static struct environment *sky_at(double latitude, double hour)
{
    struct sky_state state;
    struct sky_desc d;
    char spec[128];
    struct reason why;

    snprintf(spec, sizeof(spec), "date=03-21,latitude=%g,hour=%g", latitude, hour);
    assert_int_equal(sky_parse(spec, &d, &why), ERR_OK);
    struct frame f = sky_constant(d.width, d.height, 0.0f);
    sky_state_at(&d, 0, &state);
    sky_render(&d, &state, f.rgb);
    return sky_environment(f, 256, 0.0);
}

static uint64_t shade_at(const struct relight_cache *c, const struct prepared_scene *set, double latitude, double hour)
{
    const struct transport_frame frame = { .end = 0 };
    struct environment *e = sky_at(latitude, hour);
    float *lo = mem_alloc(set->gbuffer->packet_count, 3 * PACKET * sizeof(*lo));
    struct transport_frame_stats stats;

    assert_int_equal(transport_shade(c->transport, e, &frame, lo, &stats), ERR_OK);
    mem_free(lo);
    environment_destroy(e);
    return stats.rays;
}

/* Of the cache's files in the folder, which are removed if `removes`. */
static int count_files(const char *path, bool removes)
{
    DIR *d = opendir(path);
    const struct dirent *f;
    int count = 0;

    assert_non_null(d);
    while ((f = readdir(d)) != NULL) {
        char name[512];
        snprintf(name, sizeof(name), "%s/%s", path, f->d_name);
        count += strlen(name) > 10 && strcmp(name + strlen(name) - 10, ".transport") == 0;
        if (removes && f->d_name[0] != '.')
            unlink(name);
    }
    closedir(d);
    return count;
}

static void begin_cache(struct relight_cache *c, const struct prepared_scene *set, const struct relight_desc *light)
{
    double ms;

    assert_int_equal(relight_cache_make(c, set, best_kernels(), light, false, &ms), ERR_OK);
    while (relight_cache_follow(c) < 1.0 || !relight_cache_is_settled(c))
        nanosleep(&(struct timespec){ .tv_nsec = 1000000 }, NULL);
}

/* Of images 15 s apart. */
static uint64_t shade_minutes(const struct relight_cache *c, const struct prepared_scene *set, double hour)
{
    uint64_t rays = 0;

    for (int k = 0; k < 24; k++)
        rays += shade_at(c, set, 50.0, hour + k / 240.0);
    return rays;
}

/* Another run, with images of that day, until all of it is known. Whether it had to ask. */
static bool asks_for_day(const struct prepared_scene *set, const struct relight_desc *light, const struct sun_day *day)
{
    struct relight_cache c = { .transport = NULL };
    char text[4096] = "";

    log_begin();
    begin_cache(&c, set, light);
    shade_at(&c, set, day->latitude * 180.0 / PI, 9.0);
    while (!strstr(text, "is known after")) {
        relight_builder_aim(c.builder, c.transport, day);
        nanosleep(&(struct timespec){ .tv_nsec = 1000000 }, NULL);
        assert_true(pread(STDERR_FILENO, text, sizeof(text) - 1, 0) >= 0);
    }
    const bool out = c.transport->sun.later.count > 0;
    assert_true(out || shade_at(&c, set, 50.0, 14.3) == 0);
    relight_cache_finish(&c);
    log_end();
    return out;
}

/* Images at 9 h tell the builder of the sun's way. It asks for all of the day, so that images of the afternoon
 * trace nothing, and keeps the answers: another run has them, and asks for another day only. */
static void the_suns_way_is_asked_for_and_kept(void **state)
{
    const struct sun_day day = { 50.0 * PI / 180.0, 80, .solar = true }, other = { 0.0, 80, .solar = true };
    struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 16 },
                                  .classes = PATH_DIRECT,
                                  .cache_background = true,
                                  .cache_file = "",
                                  .has_sun_day = true };
    struct prepared_scene *set = set_of(&(struct prepared_scene_desc){ .width = 64, .height = 36 });
    struct relight_cache c = { .transport = NULL };
    struct folder folder;
    (void)state;

    folder_make(&folder);
    light.cache_dir = folder.path;
    begin_cache(&c, set, &light);
    const uint64_t first = shade_minutes(&c, set, 9.0);
    while (count_files(folder.path, false) < 2) {
        relight_builder_aim(c.builder, c.transport, &day);
        nanosleep(&(struct timespec){ .tv_nsec = 1000000 }, NULL);
    }
    const uint32_t kept = transport_sun_tiles(c.transport);
    const uint64_t known = shade_minutes(&c, set, 14.3), unknown = shade_at(&c, set, 20.0, 14.3);
    printf("%u tiles; rays at 9 h %.0f, at 14:18 %.0f, on another way %.0f\n", kept, (double)first, (double)known,
           (double)unknown);
    assert_true(kept > 300 && first > 10000 && unknown > 10000 && known == 0);
    relight_cache_finish(&c);
    assert_false(asks_for_day(set, &light, &day));
    assert_true(asks_for_day(set, &light, &other));
    assert_false(asks_for_day(set, &light, &other));
    set_destroy(set);
    count_files(folder.path, true);
    folder_remove(&folder);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(what_has_no_room_is_refused_for_good),
    cmocka_unit_test(images_without_room_for_a_cache_are_audited),
    cmocka_unit_test(the_suns_way_is_asked_for_and_kept),
};
UNIT_MAIN(tests)
