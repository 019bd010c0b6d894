/* Live images while the cache is being computed, under a sky that moves with each of them. Counted in images: between
 * them the test holds the builder, or waits until it has a share. */
#include "light/estimators/points.h"
#include "light/frame/decide.h"
#include "light/frame/relighter.h"
#include "sky/daylight/sky.h"
#include "support/folder.h"
#include "support/sets.h"
#include "support/skies.h"

#include <math.h>
#include <time.h>

#define LIGHT_OFF 0.03
#define WORSE 1.5 /* under a calm sky denoised images have learnt much: 7.7e-3, the rough cache 1.1e-2 */

enum { WIDTH = 48, HEIGHT = 27, VALUES = 3 * WIDTH * HEIGHT };

struct minute {
    struct prepared_scene *set;
    struct relighter *relighter, *reference;
    struct decider decider;
    struct relight_desc light;
    const char *source;
    uint64_t frame; /* of the next image */
    bool cached;    /* the last image was by the cache */
    float rgb[VALUES], half[2][VALUES];
};

/* What an image's light has over the truth's, and its relMSE. */
struct seen {
    double light, error;
};

static struct environment *sky_of(const char *source, uint64_t frame)
{
    struct sky_desc d;
    struct sky_state s;
    struct reason why;

    assert_int_equal(sky_parse(source, &d, &why), ERR_OK);
    d.width = 256;
    d.height = 128;
    sky_state_at(&d, frame, &s);
    struct frame f = sky_constant(d.width, d.height, 0.0f);
    sky_render(&d, &s, f.rgb);
    return sky_environment(f, 0, 0.0);
}

/* scene, camera: NULL: the built-in ones. */
static void begin(struct minute *m, const char *source, const char *scene, const char *camera)
{
    *m = (struct minute){ .set = set_of(&(struct prepared_scene_desc){
                              .width = WIDTH, .height = HEIGHT, .scene = scene, .camera = camera }),
                          .source = source };
    m->relighter = relighter_create(m->set, best_kernels());
    m->reference = relighter_create(m->set, best_kernels());
    assert_true(m->relighter && m->reference);
    m->light = (struct relight_desc){ .direct = { .method = METHOD_AUTO, .samples = 16 }, .classes = PATH_ALL };
}

static void end(struct minute *m)
{
    decider_finish(&m->decider);
    relighter_destroy(m->relighter);
    relighter_destroy(m->reference);
    set_destroy(m->set);
}

static void hold(struct minute *m, bool held)
{
    atomic_store(&m->relighter->cache.urgent.until_s, held ? HUGE_VAL : 0.0);
}

static void next_image(struct minute *m)
{
    struct environment *e = sky_of(m->source, m->frame++);
    struct frame_request request = {
        .asked = &m->light, .target.seconds = 0.03, .background = true, .allow_bias = INFINITY
    };
    struct relight_stats stats;
    struct pilot_stats measured;

    decider_begin(&m->decider, m->relighter, &request);
    decide(&m->decider, &request);
    assert_int_equal(decider_run(&m->decider, m->relighter, e, &request, m->rgb, &stats, &measured), ERR_OK);
    hold(m, true);
    decider_learn(&m->decider, m->relighter, &request, &stats, &measured);
    hold(m, true);
    m->cached = request.by == DECIDED_BY_CACHE;
    environment_destroy(e);
}

/* The last image's, by two independent references with the same camera rays. */
static struct seen look(struct minute *m)
{
    struct environment *e = sky_of(m->source, m->frame - 1);
    struct relight_desc truth = m->light;
    struct relight_stats stats;
    struct seen out = { 0.0, 0.0 };
    double mean = 0.0;

    truth.direct.samples = truth.eye_paths = 24;
    for (uint64_t k = 0; k < 2; k++) {
        truth.direct.seed = 77 + k;
        assert_int_equal(relighter_run(m->reference, e, &truth, m->half[k], &stats), ERR_OK);
    }
    environment_destroy(e);
    for (int v = 0; v < VALUES; v++) {
        out.light += (double)m->rgb[v];
        mean += 0.5 * (double)(m->half[0][v] + m->half[1][v]) / VALUES;
    }
    out.light /= mean * VALUES;
    for (int v = 0; v < VALUES; v++) {
        const double x = 0.5 * (double)(m->half[0][v] + m->half[1][v]);
        out.error +=
            (double)((m->rgb[v] - m->half[0][v]) * (m->rgb[v] - m->half[1][v])) / (x * x + 1e-2 * mean * mean) / VALUES;
    }
    printf("%s, image %d%s: %.3f of the light, relMSE %.2e\n", m->source, (int)m->frame, m->cached ? " (cache)" : "",
           out.light, out.error);
    return out;
}

/* Until images can be made by the rough cache. */
static void let_build(struct minute *m, double share)
{
    while (relighter_follow(m->relighter) < share) {
        hold(m, false);
        nanosleep(&(struct timespec){ .tv_nsec = 1000000 }, NULL);
    }
    hold(m, true);
}

/* Each image has the light of its own sky, not of one some images ago, and no step makes them worse. */
static void watch(const char *source)
{
    static struct minute m;
    struct seen denoised = { 0.0, 0.0 };

    begin(&m, source, NULL, NULL);
    for (int k = 0; k < 18; k++) {
        next_image(&m);
        assert_false(m.cached);
        if (k % 9 != 8)
            continue;
        denoised = look(&m);
        assert_true(fabs(denoised.light - 1.0) < LIGHT_OFF);
    }
    let_build(&m, RELIGHT_DIRECT);
    for (int k = 0; k < 18; k++) {
        next_image(&m);
        if (k % 9 != 8)
            continue;
        const struct seen now = look(&m);
        assert_true(m.cached && fabs(now.light - 1.0) < LIGHT_OFF);
        assert_true(now.error < WORSE * denoised.error);
    }
    end(&m);
}

static void images_keep_up_with_a_moving_sky(void **state)
{
    (void)state;
    watch("");
    watch("hour=10,speed=0.25");
}

/* A room with a hole of 0.4 m in one wall, of 4 m by 6 m and 2.4 m high. */
static const char room[] = "v -2 0 -3\nv 2 0 -3\nv 2 0 3\nv -2 0 3\nv -2 2.4 -3\nv 2 2.4 -3\nv 2 2.4 3\nv -2 2.4 3\n"
                           "v 2 1 -0.2\nv 2 1 0.2\nv 2 1.4 -0.2\nv 2 1.4 0.2\n"
                           "f 1 2 3 4\nf 5 6 7 8\nf 1 2 6 5\nf 3 4 8 7\nf 1 4 8 5\n"
                           "f 2 3 10 9\nf 6 7 12 11\nf 2 9 11 6\nf 3 7 12 10\n";

/* Where little of what is in view sees the sky, no rough cache makes images. */
static void a_room_waits_for_all_of_its_indirect_light(void **state)
{
    static struct minute m;
    char path[80];
    (void)state;

    snprintf(path, sizeof(path), "%s/room.obj", folder);
    FILE *out = fopen(path, "w");
    assert_true(out && fputs(room, out) >= 0 && fclose(out) == 0);
    begin(&m, "hour=15", path, "@-1.5,1.5,2.5;1,1,-2;60");
    next_image(&m);
    let_build(&m, RELIGHT_DIRECT);
    assert_true(relighter_awaits_whole(m.relighter));
    const bool early = relighter_follow(m.relighter) < RELIGHT_WHOLE;
    next_image(&m);
    next_image(&m);
    printf("share %.3f\n", relighter_follow(m.relighter));
    assert_true(!early || !m.cached); /* not early: this process stood still while the cache went on */
    let_build(&m, RELIGHT_WHOLE);
    next_image(&m); /* by which it is learnt */
    next_image(&m);
    assert_true(m.cached);
    end(&m);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(images_keep_up_with_a_moving_sky),
    cmocka_unit_test_setup_teardown(a_room_waits_for_all_of_its_indirect_light, make_folder, remove_folder),
};
UNIT_MAIN(tests)
