/* Photons and virtual point lights: consistent but biased, so they are held to the path tracer by stated bounds. */
#include "light/estimators/baselines/path.h"
#include "light/estimators/worlds.h"

#include <omp.h>

enum { WIDTH = 24, HEIGHT = 18, SIZE = WIDTH * HEIGHT * 3 };

typedef enum err render_function(const struct path_world *, const struct path_desc *, float *, struct path_stats *);

/* A floor, a wall and a matte box on it. */
static void make_matte(struct world *w, uint32_t width, uint32_t height)
{
    static const float sides[2][4][3] = { { { -3, 0, -2 }, { -3, 0, 3 }, { 3, 0, 3 }, { 3, 0, -2 } },
                                          { { -3, 0, -2 }, { 3, 0, -2 }, { 3, 3, -2 }, { -3, 3, -2 } } };
    struct scene *s = scene_create();
    const uint32_t matte = add_lambert(s, 0.7f);

    add_quads(s, matte, sides[0], 2);
    add_box(s, matte, (const float[3]){ -0.8f, -0.5f, -0.7f }, (const float[3]){ 0.3f, 1.2f, 0.3f });
    world_make(w, s, &corner_camera, width, height, sky_environment(sky_overcast(64, 32), 32, 0.0));
}

/* Means over the image, and over 6 blocks, of some seeds. */
struct measured {
    struct blocks whole, blocks;
};

static struct measured measure(render_function *render, const struct world *w, uint32_t classes, uint32_t samples,
                               uint32_t seeds)
{
    static float rgb[SIZE];
    struct measured m = { .whole = { .across = 1, .down = 1 }, .blocks = { .across = 3, .down = 2 } };

    for (uint64_t seed = 0; seed < seeds; seed++) {
        const struct path_desc d = { .classes = classes, .samples = samples, .seed = seed };
        struct path_stats stats;
        assert_int_equal(render(&w->path, &d, rgb, &stats), ERR_OK);
        assert_true(render == path_render ? !stats.bias : stats.bias != NULL);
        blocks_add(&m.whole, rgb, NULL, w->view.width, w->view.height);
        blocks_add(&m.blocks, rgb, NULL, w->view.width, w->view.height);
    }
    return m;
}

/* The mean over the image within `bound` of the path tracer's, and each block within three times that; 4 standard
 * errors are forgiven, and of the image's mean they are asserted to be no more than the bound. */
static void near_path(const char *what, render_function *render, const struct world *w, uint32_t classes,
                      uint32_t samples, double bound)
{
    const struct measured got = measure(render, w, classes, samples, 8);
    const struct measured want = measure(path_render, w, classes, w->view.width < WIDTH ? 1024 : 64, 12);
    const double ratio = blocks_mean(&got.whole, 0) / blocks_mean(&want.whole, 0);
    const double error = hypot(blocks_precision(&got.whole), blocks_precision(&want.whole));

    printf("%s: %.4f of path's, standard error %.4f\n", what, ratio, error);
    assert_true(fabs(ratio - 1.0) <= bound + 4.0 * error);
    assert_true(4.0 * error <= bound);
    for (uint32_t k = 0; k < 6; k++) {
        const double a = blocks_mean(&got.blocks, k), b = blocks_mean(&want.blocks, k);
        const double slack = hypot(blocks_error(&got.blocks, k), blocks_error(&want.blocks, k));
        if (fabs(a - b) > 3.0 * bound * b + 4.0 * slack)
            printf("%s, block %u: %.5f, path %.5f +- %.5f\n", what, k, a, b, slack);
        assert_true(fabs(a - b) <= 3.0 * bound * b + 4.0 * slack);
    }
}

static void photons_bring_indirect_light(void **state)
{
    struct world w;

    (void)state;
    make_matte(&w, WIDTH, HEIGHT);
    near_path("indirect light by photons", photons_render, &w, PATH_INDIRECT, 192, 0.05);
    world_finish(&w);
}

static void photons_bring_caustics(void **state)
{
    struct world w;

    (void)state;
    world_make(&w, corner_scene(0.7f, 0.9f), &corner_camera, WIDTH, HEIGHT,
               sky_environment(sky_overcast(64, 32), 32, 0.0));
    near_path("caustics by photons", photons_render, &w, PATH_CAUSTICS, 192, 0.08);
    near_path("indirect light by photons", photons_render, &w, PATH_INDIRECT, 192, 0.08);
    world_finish(&w);
}

/* Lights are cut where they are near: too dark, and less so the more there are. All pixels share the lights, so there
 * are few pixels and many lights. */
static void point_lights_bring_indirect_light(void **state)
{
    struct world w;

    (void)state;
    make_matte(&w, 6, 4);
    near_path("indirect light by 8192 point lights", vpl_render, &w, PATH_INDIRECT, 8192, 0.05);
    const struct measured few = measure(vpl_render, &w, PATH_INDIRECT, 4, 4096);
    const struct measured want = measure(path_render, &w, PATH_INDIRECT, 1024, 12);
    const double ratio = blocks_mean(&few.whole, 0) / blocks_mean(&want.whole, 0);
    const double error = hypot(blocks_precision(&few.whole), blocks_precision(&want.whole));
    if (ratio + 5.0 * error >= 0.95)
        printf("4 lights: %.4f of path, standard error %.4f\n", ratio, error);
    assert_true(ratio + 5.0 * error < 0.95);
    world_finish(&w);
}

/* Each of 5 particles is a path from the sky; of each of 24 pixels go 5 from the eye for direct light, and as many to
 * be lit by what the particles left. */
static void point_lights_and_their_pixels_are_counted(void **state)
{
    static float rgb[SIZE];
    const struct path_desc d = { .classes = PATH_INDIRECT, .samples = 5, .seed = 1 };
    struct path_stats stats;
    struct world w;

    (void)state;
    make_matte(&w, 6, 4);
    assert_int_equal(vpl_render(&w.path, &d, rgb, &stats), ERR_OK);
    assert_int_equal(stats.samples, 5 + 2 * 24 * 5);
    world_finish(&w);
}

static render_function *const both[] = { photons_render, vpl_render };

static void background_and_direct_are_paths(void **state)
{
    static float want[SIZE], got[SIZE];
    const struct path_desc d = { .classes = PATH_BACKGROUND | PATH_DIRECT, .samples = 4, .seed = 3 };
    struct path_stats stats;
    struct world w;

    (void)state;
    make_matte(&w, WIDTH, HEIGHT);
    assert_int_equal(path_render(&w.path, &d, want, &stats), ERR_OK);
    for (int k = 0; k < 2; k++) {
        assert_int_equal(both[k](&w.path, &d, got, &stats), ERR_OK);
        assert_memory_equal(got, want, sizeof(want));
    }
    world_finish(&w);
}

/* A sky of 2^-20 lights as one of 1 does, to the bit, in every row and column. */
static void a_dim_sky_lights_as_a_bright_one_everywhere(void **state)
{
    static render_function *const all[] = { path_render, photons_render, vpl_render };
    static float sun[SIZE], dim[SIZE];
    (void)state;
    for (int k = 0; k < 3; k++) {
        for (int is_dim = 0; is_dim < 2; is_dim++) {
            const struct path_desc d = { .classes = PATH_INDIRECT, .samples = 64, .seed = 5 };
            struct path_stats stats;
            struct world w;
            world_make(&w, corner_scene(0.7f, 0.9f), &corner_camera, WIDTH, HEIGHT,
                       sky_environment(sky_constant(16, 8, is_dim ? 0x1p-20f : 1.0f), 8, 0.0));
            assert_int_equal(all[k](&w.path, &d, is_dim ? dim : sun, &stats), ERR_OK);
            world_finish(&w);
        }
        float rows[HEIGHT] = { 0 }, columns[WIDTH] = { 0 };
        for (int i = 0; i < SIZE; i++) {
            assert_true(dim[i] == sun[i] * 0x1p-20f);
            rows[i / 3 / WIDTH] += sun[i];
            columns[i / 3 % WIDTH] += sun[i];
        }
        for (int y = HEIGHT / 2; y < HEIGHT; y++) /* the upper rows may show the sky alone */
            assert_true(rows[y] > 0.0f);
        for (int x = 0; x < WIDTH; x++)
            assert_true(columns[x] > 0.0f);
    }
}

static void threads_do_not_change_a_bit(void **state)
{
    static float one[SIZE], three[SIZE];
    const struct path_desc d = { .classes = PATH_ALL, .samples = 16, .seed = 9 };
    const int threads = omp_get_max_threads();
    struct path_stats stats[2];
    struct world w;

    (void)state;
    world_make(&w, corner_scene(0.7f, 0.9f), &corner_camera, WIDTH, HEIGHT,
               sky_environment(sky_with_sun(64, 32, 100.0f), 32, 0.0));
    for (int k = 0; k < 2; k++) {
        omp_set_num_threads(1);
        assert_int_equal(both[k](&w.path, &d, one, &stats[0]), ERR_OK);
        omp_set_num_threads(3);
        assert_int_equal(both[k](&w.path, &d, three, &stats[1]), ERR_OK);
        omp_set_num_threads(threads);
        assert_memory_equal(one, three, sizeof(one));
        assert_memory_equal(&stats[0], &stats[1], sizeof(stats[0]));
    }
    world_finish(&w);
}

static void cancelled_work_and_a_black_sky_are_black(void **state)
{
    static float rgb[SIZE];
    atomic_bool cancel = true;
    struct path_stats stats;
    struct world w;

    (void)state;
    for (int k = 0; k < 4; k++) {
        const bool dark = k & 2;
        const struct path_desc d = { .classes = PATH_ALL,
                                     .samples = dark ? 4 : 1 << 12,
                                     .cancel = dark ? NULL : &cancel };
        world_make(&w, corner_scene(0.7f, 0.9f), &corner_camera, WIDTH, HEIGHT,
                   sky_environment(sky_constant(16, 8, dark ? 0.0f : 1.0f), 8, 0.0));
        rgb[7] = 7.0f;
        assert_int_equal(both[k & 1](&w.path, &d, rgb, &stats), ERR_OK);
        for (size_t i = 0; i < SIZE; i++)
            assert_true(rgb[i] == 0.0f);
        world_finish(&w);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(photons_bring_indirect_light),      cmocka_unit_test(photons_bring_caustics),
    cmocka_unit_test(point_lights_bring_indirect_light), cmocka_unit_test(point_lights_and_their_pixels_are_counted),
    cmocka_unit_test(background_and_direct_are_paths),   cmocka_unit_test(a_dim_sky_lights_as_a_bright_one_everywhere),
    cmocka_unit_test(threads_do_not_change_a_bit),       cmocka_unit_test(cancelled_work_and_a_black_sky_are_black),
};
UNIT_MAIN(tests)
