/* Metropolis against the path tracer below it, class by class, and its own rules. */
#include "light/estimators/baselines/path.h"
#include "light/estimators/worlds.h"

#include <omp.h>

enum { WIDTH = 24, HEIGHT = 18, SIZE = WIDTH * HEIGHT * 3 };

/* An overcast sky with a patch of that brightness, 11 by 11 degrees. */
static struct environment *patchy_sky(float sun)
{
    struct frame f = sky_overcast(64, 32);

    for (uint32_t y = 8; y < 10; y++)
        for (uint32_t x = 20; x < 22; x++)
            sky_paint(&f, x, y, sun, 0.8f * sun, 0.6f * sun);
    return sky_environment(f, 32, 0.0);
}

static void make(struct world *w, float sun)
{
    static const float plate[4][3] = {
        { -0.2f, 0.01f, 1.0f }, { 0.8f, 0.01f, 1.6f }, { 0.7f, 0.6f, 1.2f }, { -0.3f, 0.6f, 0.6f }
    };
    struct scene *s = corner_scene(0.7f, 0.9f);
    const struct material glossy = { .kind = MATERIAL_GGX, .diffuse = { 0.5f, 0.4f, 0.3f }, .roughness = 0.01f };

    add_quads(s, add_stuff(s, glossy), plate, 1);
    world_make(w, s, &corner_camera, WIDTH, HEIGHT, patchy_sky(sun));
}

/* 12 blocks for each of four classes and for all together, over SEEDS seeds each; |z| < 6 (t, some 40 degrees of
 * freedom: by chance 2e-5 in all). For the image's mean |z| < 5 where `limit` is asserted of its relative standard
 * error: a bias of 7 times that is caught 97 times of 100, so 2.5 % of direct light and of all together, 6 % of the
 * others, most of whose error is the normalisation's. */
static void compare(uint32_t classes, float sun, uint32_t samples, double limit)
{
    enum { SEEDS = 24 };
    static float rgb[SIZE];
    struct blocks path = { .across = 4, .down = 3 }, mlt = path, path_mean = { .across = 1, .down = 1 },
                  mlt_mean = path_mean;
    struct world w;

    make(&w, sun);
    for (uint64_t seed = 0; seed < SEEDS; seed++) {
        struct path_desc d = { .classes = classes, .samples = samples, .seed = seed };
        struct path_stats stats;
        assert_int_equal(path_render(&w.path, &d, rgb, &stats), ERR_OK);
        blocks_add(&path, rgb, NULL, WIDTH, HEIGHT);
        blocks_add(&path_mean, rgb, NULL, WIDTH, HEIGHT);
        d.seed += 1000;
        assert_int_equal(mlt_render(&w.path, &d, rgb, &stats), ERR_OK);
        assert_true(stats.samples >= (uint64_t)samples * WIDTH * HEIGHT && stats.rays >= stats.samples);
        blocks_add(&mlt, rgb, NULL, WIDTH, HEIGHT);
        blocks_add(&mlt_mean, rgb, NULL, WIDTH, HEIGHT);
    }
    const double z = blocks_worst("mlt", &mlt, &path, 6.0), mean_z = blocks_worst("mean", &mlt_mean, &path_mean, 5.0);
    const double precision = hypot(blocks_precision(&mlt_mean), blocks_precision(&path_mean));
    if (z >= 6.0 || mean_z >= 5.0 || precision >= limit)
        printf("classes %u: worst z %.2f, of the mean %.2f, precision %.5f (mlt %.5f)\n", classes, z, mean_z, precision,
               blocks_precision(&mlt_mean));
    assert_true(z < 6.0 && mean_z < 5.0);
    assert_true(precision < limit);
    world_finish(&w);
}

static void background_agrees_with_path(void **state)
{
    (void)state;
    compare(PATH_BACKGROUND, 1.0f, 64, 8e-3);
}

static void direct_agrees_with_path(void **state)
{
    (void)state;
    compare(PATH_DIRECT, 60.0f, 32, 3e-3);
}

static void caustics_agree_with_path(void **state)
{
    (void)state;
    compare(PATH_CAUSTICS, 1.0f, 48, 1e-2);
}

static void indirect_light_agrees_with_path(void **state)
{
    (void)state;
    compare(PATH_INDIRECT, 1.0f, 48, 8e-3);
}

static void all_classes_together_agree_with_path(void **state)
{
    (void)state;
    compare(PATH_ALL, 30.0f, 32, 3.5e-3);
}

static void threads_do_not_change_a_bit(void **state)
{
    static float one[SIZE], three[SIZE];
    const int threads = omp_get_max_threads();
    struct path_desc d = { .classes = PATH_ALL, .samples = 8, .seed = 9 };
    struct path_stats stats[2];
    struct world w;

    (void)state;
    make(&w, 60.0f);
    omp_set_num_threads(1);
    assert_int_equal(mlt_render(&w.path, &d, one, &stats[0]), ERR_OK);
    omp_set_num_threads(3);
    assert_int_equal(mlt_render(&w.path, &d, three, &stats[1]), ERR_OK);
    omp_set_num_threads(threads);
    assert_memory_equal(one, three, sizeof(one));
    assert_memory_equal(&stats[0], &stats[1], sizeof(stats[0]));
    d.pass = 1;
    assert_int_equal(mlt_render(&w.path, &d, three, &stats[1]), ERR_OK);
    assert_true(memcmp(one, three, sizeof(one)) != 0);
    world_finish(&w);
}

static void cancelled_work_leaves_black(void **state)
{
    static float rgb[SIZE];
    atomic_bool cancel = true;
    const struct path_desc d = { .classes = PATH_ALL, .samples = 1u << 16, .cancel = &cancel };
    struct path_stats stats;
    struct world w;

    (void)state;
    make(&w, 60.0f);
    rgb[7] = 7.0f;
    assert_int_equal(mlt_render(&w.path, &d, rgb, &stats), ERR_OK);
    assert_int_equal(stats.samples, 0);
    for (size_t i = 0; i < SIZE; i++)
        assert_true(rgb[i] == 0.0f);
    world_finish(&w);
}

/* A black sky, and a class that no path of the scene belongs to. */
static void nothing_to_find_is_black(void **state)
{
    static float rgb[SIZE];
    const struct path_desc d = { .classes = PATH_CAUSTICS, .samples = 4 };
    struct path_stats stats;
    struct world w;

    (void)state;
    for (int dark = 0; dark < 2; dark++) {
        struct scene *s = scene_create();
        add_box(s, add_lambert(s, 0.5f), (const float[3]){ -1, -1, -1 }, (const float[3]){ 1, 1, 1 });
        world_make(&w, s, &corner_camera, WIDTH, HEIGHT,
                   sky_environment(sky_constant(16, 8, dark ? 0.0f : 1.0f), 8, 0.0));
        rgb[7] = 7.0f;
        assert_int_equal(mlt_render(&w.path, &d, rgb, &stats), ERR_OK);
        for (size_t i = 0; i < SIZE; i++)
            assert_true(rgb[i] == 0.0f);
        world_finish(&w);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(background_agrees_with_path),
    cmocka_unit_test(direct_agrees_with_path),
    cmocka_unit_test(caustics_agree_with_path),
    cmocka_unit_test(indirect_light_agrees_with_path),
    cmocka_unit_test(all_classes_together_agree_with_path),
    cmocka_unit_test(threads_do_not_change_a_bit),
    cmocka_unit_test(cancelled_work_leaves_black),
    cmocka_unit_test(nothing_to_find_is_black),
};
UNIT_MAIN(tests)
