/* The reference against closed forms, against the direct estimator that shares nothing with it but rays and lobes, and
 * against itself. */
#include "import/reader/reader.h"
#include "light/estimators/direct.h"
#include "light/estimators/kernels.h"
#include "light/estimators/worlds.h"

#include <omp.h>

static void render(const struct world *w, uint32_t classes, uint32_t samples, uint64_t seed, float *rgb)
{
    struct path_stats stats;
    const struct path_desc d = { .classes = classes, .samples = samples, .seed = seed };

    assert_int_equal(path_render(&w->path, &d, rgb, &stats), ERR_OK);
    assert_int_equal(stats.samples, (uint64_t)samples * w->view.width * w->view.height);
    assert_true(stats.rays >= stats.samples);
}

/* Matte surfaces of albedo 1, mirrors of 1 and glass keep all light: under a sky of 1 everything is 1, whatever stands
 * where. 12 blocks over 32 seeds in `./test --long`, |z| < 6: by chance below 1e-4 in all (t, 31 degrees of freedom).
 * The standard error of each is asserted below 0.15 %, so that a bias of 1 % stands at 6.6 of them; over 8 seeds, as
 * each commit has them, below 0.3 %, and a bias of 2 % does; of the whole image's mean it is some 0.03 %, |z| < 6
 * there too. */
static void a_white_furnace_is_white(void **state)
{
    enum { WIDTH = 32, HEIGHT = 24, FEW = 8, ALL = 32 };
    static float rgb[WIDTH * HEIGHT * 3];
    const double allowed = 1.5e-3 * seeds_blur(FEW, ALL);
    struct blocks got = { .across = 4, .down = 3 }, whole = { .across = 1, .down = 1 };
    struct world w;

    (void)state;
    world_make(&w, corner_scene(1.0f, 1.0f), &corner_camera, WIDTH, HEIGHT,
               sky_environment(sky_constant(32, 16, 1.0f), 16, 0.0));
    for (uint64_t seed = 0; seed < seeds_count(FEW, ALL); seed++) {
        render(&w, PATH_ALL, 200, seed, rgb);
        blocks_add(&got, rgb, NULL, WIDTH, HEIGHT);
        blocks_add(&whole, rgb, NULL, WIDTH, HEIGHT);
    }
    for (uint32_t k = 0; k < 12; k++) {
        const double mean = blocks_mean(&got, k), error = blocks_error(&got, k);
        if (fabs(mean - 1.0) > 6.0 * error + 1e-5 || error > allowed)
            printf("block %u: %.5f +- %.5f\n", k, mean, error);
        assert_true(fabs(mean - 1.0) <= 6.0 * error + 1e-5);
        assert_true(error <= allowed);
    }
    assert_true(fabs(blocks_mean(&whole, 0) - 1.0) <= 6.0 * blocks_error(&whole, 0));
    world_finish(&w);
}

/* Every light path belongs to one class: with the same seed the classes' images add up to that of all. A sharp
 * glossy plate (both D and S) stands in the image, and each class has something to show. */
static void classes_add_up_to_all(void **state)
{
    enum { WIDTH = 32, HEIGHT = 24, SIZE = WIDTH * HEIGHT * 3 };
    static const float plate[4][3] = {
        { -0.2f, 0.01f, 1.0f }, { 0.8f, 0.01f, 1.6f }, { 0.7f, 0.6f, 1.2f }, { -0.3f, 0.6f, 0.6f }
    };
    static float all[SIZE], part[5][SIZE];
    struct scene *s = corner_scene(0.7f, 0.9f);
    struct world w;

    (void)state;
    add_quads(
        s, add_stuff(s, (struct material){ .kind = MATERIAL_GGX, .diffuse = { 0.5f, 0.4f, 0.3f }, .roughness = 0.01f }),
        plate, 1);
    world_make(&w, s, &corner_camera, WIDTH, HEIGHT, sky_environment(sky_with_sun(64, 32, 1000.0f), 32, 0.0));
    render(&w, PATH_ALL, 16, 5, all);
    for (uint32_t k = 0; k < 5; k++) {
        double sum = 0.0;
        render(&w, 1u << k, 16, 5, part[k]);
        for (size_t i = 0; i < SIZE; i++)
            sum += part[k][i];
        assert_true(sum > 0.0);
    }
    for (size_t i = 0; i < SIZE; i++) {
        const float sum = part[0][i] + part[1][i] + part[2][i] + part[3][i] + part[4][i];
        assert_float_equal(sum, all[i], 1e-5f * all[i]);
    }
    world_finish(&w);
}

/* Mean and standard error over the seeds of the middle of an image that looks at one place. */
static double look_at_place(const struct world *w, uint32_t classes, double *error)
{
    const uint32_t seeds = seeds_count(24, 64);
    float rgb[3 * 4 * 4];
    struct blocks b = { .across = 1, .down = 1 };

    for (uint64_t seed = 0; seed < seeds; seed++) {
        render(w, classes, 1024, seed, rgb);
        blocks_add(&b, rgb, NULL, 4, 4);
    }
    *error = blocks_error(&b, 0);
    return blocks_mean(&b, 0);
}

/* |z| < 5 at a standard error below 0.2 %: a bias of 2 % is always caught. */
static void expect(const struct world *w, const char *what, uint32_t classes, double want)
{
    double error;
    const double got = look_at_place(w, classes, &error);

    if (fabs(got - want) > 5.0 * error + 1e-4 * want || error > 2e-3 * want)
        printf("%s: %.6f +- %.6f, closed form %.6f\n", what, got, error, want);
    assert_true(fabs(got - want) <= 5.0 * error + 1e-4 * want);
    assert_true(error <= 2e-3 * want + 1e-12);
}

/* A floor of albedo a meets a wall, both without end, under a sky of 1. Each sees half of its light in the other, so
 * the matte wall's radiosity is one number by self-similarity: B = a (1/2 + B/2). A mirror instead gives half the sky
 * again, times its reflectance. */
static void a_wedge_has_its_closed_form(void **state)
{
    static const float far = 1e5f;
    const float sides[2][4][3] = { { { -far, 0, 0 }, { -far, 0, far }, { far, 0, far }, { far, 0, 0 } },
                                   { { -far, 0, 0 }, { far, 0, 0 }, { far, far, 0 }, { -far, far, 0 } } };
    static const struct camera close = { "close", { 0, 1, 2 }, { 0, 0, 1 }, { 0, 1, 0 }, 0.05f };

    (void)state;
    for (int mirror = 0; mirror < 2; mirror++) {
        struct scene *s = scene_create();
        struct world w;
        add_quads(s, add_lambert(s, 0.6f), sides[0], 1);
        const uint32_t wall =
            mirror ? add_stuff(s, (struct material){ .kind = MATERIAL_MIRROR, .diffuse = { 0.8f, 0.8f, 0.8f } })
                   : add_lambert(s, 0.6f);
        add_quads(s, wall, sides[1], 1);
        world_make(&w, s, &close, 4, 4, sky_environment(sky_constant(32, 16, 1.0f), 16, 0.0));
        expect(&w, "direct", PATH_DIRECT, 0.3);
        expect(&w, "caustics", PATH_CAUSTICS, mirror ? 0.3 * 0.8 : 0.0);
        expect(&w, "indirect light", PATH_INDIRECT, mirror ? 0.0 : 0.3 / 0.7 - 0.3);
        world_finish(&w);
    }
}

/* A white card in a block of glass is lit by refraction alone, and keeps all light: with what the surface reflects the
 * eye sees 1. */
static void a_card_in_glass_is_lit_through_it(void **state)
{
    static const float q[4][3] = { { -4, 0, -4 }, { -4, 0, 4 }, { 4, 0, 4 }, { 4, 0, -4 } };
    static const struct camera above = { "above", { 0, 9, 0 }, { 0, 0, 0 }, { 0, 0, 1 }, 0.01f };
    struct scene *s = scene_create();
    struct world w;
    double error;

    (void)state;
    add_quads(s, add_lambert(s, 1.0f), q, 1);
    add_box(s, add_stuff(s, (struct material){ .kind = MATERIAL_GLASS, .diffuse = { 1, 1, 1 }, .ior = 1.5f }),
            (const float[3]){ -5, -5, -5 }, (const float[3]){ 5, 5, 5 });
    world_make(&w, s, &above, 4, 4, sky_environment(sky_constant(32, 16, 1.0f), 16, 0.0));
    const double background = look_at_place(&w, PATH_BACKGROUND, &error);
    assert_true(fabs(background - 0.04) <= 5.0 * error);
    assert_true(look_at_place(&w, PATH_DIRECT, &error) == 0.0);
    const double all = look_at_place(&w, PATH_ALL, &error);
    if (fabs(all - 1.0) > 5.0 * error)
        printf("%.5f +- %.5f\n", all, error);
    assert_true(fabs(all - 1.0) <= 5.0 * error && error < 5e-3);
    world_finish(&w);
}

/* A block of 0.4 m, square on: (1 - F)^2 a / (1 - F^2 a^2) comes through, and by one way more inside it comes back. */
static void a_block_of_dark_glass_attenuates_by_its_depth(void **state)
{
    static const struct camera above = { "above", { 0, 9, 0 }, { 0, 0, 0 }, { 0, 0, 1 }, 0.01f };
    const double f = 0.04, a = exp(-0.4 * 3.0), through = (1.0 - f) * (1.0 - f) * a / (1.0 - f * f * a * a);
    struct scene *s = scene_create();
    struct world w;

    (void)state;
    add_box(s,
            add_stuff(s,
                      (struct material){
                          .kind = MATERIAL_GLASS, .diffuse = { 1, 1, 1 }, .ior = 1.5f, .attenuation = { 3, 3, 3 } }),
            (const float[3]){ -5, -0.2f, -5 }, (const float[3]){ 5, 0.2f, 5 });
    world_make(&w, s, &above, 4, 4, sky_environment(sky_constant(32, 16, 1.0f), 16, 0.0));
    expect(&w, "background", PATH_BACKGROUND, through + f + f * a * through);
    world_finish(&w);
}

/* Where glass has no far side, what is behind it is inside: radiance there counts n^-2 at the eye, as it does in the
 * G-buffer. Square on, 0.04 comes back and 0.96 goes through. Everywhere else the factors cancel, light being outside.
 */
static void an_open_sheet_of_glass_keeps_its_index(void **state)
{
    static const float q[1][4][3] = { { { -4, 0, -4 }, { -4, 0, 4 }, { 4, 0, 4 }, { 4, 0, -4 } } };
    static const struct camera above = { "above", { 0, 9, 0 }, { 0, 0, 0 }, { 0, 0, 1 }, 0.01f };
    struct scene *s = scene_create();
    struct world w;

    (void)state;
    add_quads(s, add_stuff(s, (struct material){ .kind = MATERIAL_GLASS, .diffuse = { 1, 1, 1 }, .ior = 1.5f }), q[0],
              1);
    world_make(&w, s, &above, 4, 4, sky_environment(sky_constant(32, 16, 1.0f), 16, 0.0));
    expect(&w, "background", PATH_BACKGROUND, 0.04 + 0.96 / 2.25);
    world_finish(&w);
}

/* A pixel is the mean over its square: a mirror that hides part of the sky covers 3/4 of one column and 1/4 of one row,
 * and what it shows instead is another brightness. 4096 samples a pixel: 0.8 % is one standard error of a share. */
static void a_pixel_is_the_mean_over_its_square(void **state)
{
    enum { N = 4 };
    static const struct camera ahead = { "ahead", { 0, 0, 0 }, { 0, 0, -1 }, { 0, 1, 0 }, 0.92729522f }; /* tan = 1/2 */
    /* at distance 4 the image is 4 m, a pixel 1 m; column 1 begins at -1, row 2 ends at -1 */
    static const float card[1][4][3] = {
        { { -0.75f, -9, -4 }, { 9, -9, -4 }, { 9, -0.75f, -4 }, { -0.75f, -0.75f, -4 } }
    };
    static float rgb[N * N * 3];
    struct scene *s = scene_create();
    struct world w;

    (void)state;
    add_quads(s, add_stuff(s, (struct material){ .kind = MATERIAL_MIRROR, .diffuse = { 0.5f, 0.5f, 0.5f } }), card[0],
              1);
    world_make(&w, s, &ahead, N, N, sky_environment(sky_constant(32, 16, 1.0f), 16, 0.0));
    render(&w, PATH_ALL, 4096, 3, rgb);
    for (int y = 0; y < N; y++)
        for (int x = 0; x < N; x++) {
            const double across = x == 0 ? 0.0 : x == 1 ? 0.75 : 1.0, down = y < 2 ? 0.0 : y == 2 ? 0.25 : 1.0;
            assert_float_equal(rgb[3 * (y * N + x)], 1.0 - 0.5 * across * down, 0.02);
        }
    world_finish(&w);
}

struct hashed { /* numbers of one sample, made otherwise than path.c makes its own */
    struct numbers numbers;
    uint64_t stream;
};

static double hashed_at(struct numbers *n, uint32_t place)
{
    return rng_unit(rng_mix(((const struct hashed *)n)->stream, place));
}

/* Samples through the pixels' centres alone, as a G-buffer with one camera ray per pixel sees them. */
static void render_centres(const struct world *w, uint32_t classes, uint32_t samples, uint64_t seed, float *rgb)
{
    const uint32_t width = w->view.width, height = w->view.height;
    uint64_t rays = 0;

#pragma omp parallel for schedule(dynamic, 16) reduction(+ : rays)
    for (uint32_t i = 0; i < width * height; i++) {
        const double xy[2] = { i % width + 0.5, i / width + 0.5 };
        double sum[3] = { 0.0, 0.0, 0.0 };
        for (uint32_t k = 0; k < samples; k++) {
            struct hashed h = { { hashed_at }, rng_mix(rng_mix(seed, i), k) };
            double one[3];
            path_sample(&w->path, classes, xy, &h.numbers, one, &rays);
            for (int c = 0; c < 3; c++)
                sum[c] += one[c];
        }
        for (int c = 0; c < 3; c++)
            rgb[3 * i + (uint32_t)c] = (float)(sum[c] / samples);
    }
}

static void resolve_direct(const struct gbuffer *g, const float *lo, float *rgb)
{
    for (size_t i = 0; i < (size_t)g->width * g->height; i++)
        for (uint32_t c = 0; c < 3; c++) {
            double sum = 0.0;
            for (uint32_t q = g->entry_first[i]; q < g->entry_first[i + 1]; q++) {
                const uint32_t point = g->entries[q].point;
                sum += g->entries[q].weight[c] * lo[((size_t)(point / PACKET) * 3 + c) * PACKET + point % PACKET];
            }
            rgb[3 * i + c] = (float)sum;
        }
}

/* The class of direct light on the built-in scene, against direct_shade through a G-buffer of one camera ray per
 * pixel, which path_sample takes too. 6 x 4 blocks, |z| < 6 (t, some 40 degrees of freedom: by chance 1e-5 in all),
 * and |z| < 5 of the image's mean, whose standard error is asserted below 0.12 % by 24 seeds (`./test --long`), so
 * that a bias of 1 % is caught 99 times of 100; by the 8 of each commit below 0.21 %, and a bias of 1.7 % is. */
static void compare_direct(struct frame sky)
{
    enum { WIDTH = 64, HEIGHT = 36, FEW = 8, ALL = 24 };
    static float rgb[WIDTH * HEIGHT * 3];
    struct blocks path = { .across = 6, .down = 4 }, direct = path, path_mean = { .across = 1, .down = 1 },
                  direct_mean = path_mean;
    const double allowed = 1.2e-3 * seeds_blur(FEW, ALL);
    struct world w;
    struct scene *s = scene_create_builtin();
    struct gbuffer *g;
    struct reason why;
    const struct kernels *kernels;

    world_make(&w, s, &s->cameras[0], WIDTH, HEIGHT, sky_environment(sky, 64, 0.0));
    const struct gbuffer_desc gd = { .camera = &s->cameras[0], .width = WIDTH, .height = HEIGHT, .edge_rays = 1 };
    assert_int_equal(gbuffer_create(s, w.rays, &gd, &g, &why), ERR_OK);
    assert_int_equal(kernels_select(NULL, &kernels, &why), ERR_OK);
    struct direct *d = direct_create(kernels);
    float *lo = mem_alloc((size_t)g->packet_count * 3 * PACKET, sizeof(float));
    for (uint64_t seed = 0; seed < seeds_count(FEW, ALL); seed++) {
        struct direct_stats stats;
        const struct direct_desc dd = { .method = METHOD_MIS, .samples = 512, .seed = seed };
        assert_int_equal(direct_shade(d, g, w.rays, w.environment, &dd, lo, &stats), ERR_OK);
        resolve_direct(g, lo, rgb);
        blocks_add(&direct, rgb, NULL, WIDTH, HEIGHT);
        blocks_add(&direct_mean, rgb, NULL, WIDTH, HEIGHT);
        render_centres(&w, PATH_DIRECT, 48, seed, rgb);
        blocks_add(&path, rgb, NULL, WIDTH, HEIGHT);
        blocks_add(&path_mean, rgb, NULL, WIDTH, HEIGHT);
    }
    const double z = blocks_worst("direct", &path, &direct, 6.0);
    const double ratio = blocks_mean(&path_mean, 0) / blocks_mean(&direct_mean, 0);
    const double error = hypot(blocks_precision(&path_mean), blocks_precision(&direct_mean));
    if (z >= 6.0 || fabs(ratio - 1.0) >= 5.0 * error || error >= allowed)
        printf("worst z %.2f, ratio of means %.5f +- %.5f\n", z, ratio, error);
    assert_true(z < 6.0);
    assert_true(fabs(ratio - 1.0) < 5.0 * error);
    assert_true(error < allowed);
    mem_free(lo);
    direct_destroy(d);
    gbuffer_destroy(g);
    world_finish(&w);
}

static void direct_class_agrees_with_direct_shade_under_overcast(void **state)
{
    (void)state;
    compare_direct(sky_overcast(64, 32));
}

static void direct_class_agrees_with_direct_shade_under_a_small_sun(void **state)
{
    (void)state;
    compare_direct(sky_with_sun(128, 64, 2000.0f));
}

static void threads_do_not_change_a_bit(void **state)
{
    enum { WIDTH = 24, HEIGHT = 16 };
    static float one[WIDTH * HEIGHT * 3], three[WIDTH * HEIGHT * 3];
    const int threads = omp_get_max_threads();
    struct world w;

    (void)state;
    world_make(&w, corner_scene(0.7f, 0.9f), &corner_camera, WIDTH, HEIGHT,
               sky_environment(sky_with_sun(64, 32, 1000.0f), 32, 0.0));
    omp_set_num_threads(1);
    render(&w, PATH_ALL, 64, 9, one);
    omp_set_num_threads(3);
    render(&w, PATH_ALL, 64, 9, three);
    omp_set_num_threads(threads);
    assert_memory_equal(one, three, sizeof(one));
    render(&w, PATH_ALL, 64, 10, three);
    assert_true(memcmp(one, three, sizeof(one)) != 0);
    world_finish(&w);
}

static void cancelled_work_leaves_black_and_says_so(void **state)
{
    static float rgb[8 * 8 * 3];
    atomic_bool cancel = true;
    struct path_stats stats;
    struct world w;
    const struct path_desc d = { .classes = PATH_ALL, .samples = 1u << 30, .cancel = &cancel };

    (void)state;
    world_make(&w, corner_scene(0.7f, 0.9f), &corner_camera, 8, 8, sky_environment(sky_overcast(16, 8), 8, 0.0));
    for (size_t i = 0; i < 8 * 8 * 3; i++)
        rgb[i] = 7.0f;
    assert_int_equal(path_render(&w.path, &d, rgb, &stats), ERR_OK);
    assert_int_equal(stats.samples, 0);
    for (size_t i = 0; i < 8 * 8 * 3; i++)
        assert_true(rgb[i] == 0.0f);
    world_finish(&w);
}

static void a_black_sky_lights_nothing(void **state)
{
    static float rgb[8 * 8 * 3];
    struct path_stats stats;
    struct world w;
    const struct path_desc d = { .classes = PATH_ALL, .samples = 4 };

    (void)state;
    world_make(&w, corner_scene(0.7f, 0.9f), &corner_camera, 8, 8, sky_environment(sky_constant(16, 8, 0.0f), 8, 0.0));
    rgb[5] = 7.0f;
    assert_int_equal(path_render(&w.path, &d, rgb, &stats), ERR_OK);
    for (size_t i = 0; i < 8 * 8 * 3; i++)
        assert_true(rgb[i] == 0.0f);
    world_finish(&w);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_white_furnace_is_white),
    cmocka_unit_test(classes_add_up_to_all),
    cmocka_unit_test(a_wedge_has_its_closed_form),
    cmocka_unit_test(a_card_in_glass_is_lit_through_it),
    cmocka_unit_test(a_block_of_dark_glass_attenuates_by_its_depth),
    cmocka_unit_test(an_open_sheet_of_glass_keeps_its_index),
    cmocka_unit_test(a_pixel_is_the_mean_over_its_square),
    cmocka_unit_test(direct_class_agrees_with_direct_shade_under_overcast),
    cmocka_unit_test(direct_class_agrees_with_direct_shade_under_a_small_sun),
    cmocka_unit_test(threads_do_not_change_a_bit),
    cmocka_unit_test(cancelled_work_leaves_black_and_says_so),
    cmocka_unit_test(a_black_sky_lights_nothing),
};
UNIT_MAIN(tests)
