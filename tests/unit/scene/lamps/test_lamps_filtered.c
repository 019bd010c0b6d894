/* Filtered light of lamps against a long run: less error at the same samples, the same light, and the long run itself
 * as samples grow. */
#include "scene/lamps/rooms_lit.h"

#include <omp.h>

enum { WIDTH = 48, HEIGHT = 36, PIXELS = WIDTH * HEIGHT };

/* Samples of the long run. */
static uint32_t samples_of_long_run(void)
{
    return seeds_count(256, 512);
}

/* A closed room with a panel, a spot on one wall, and a box. */
static void room_make(struct lit *l)
{
    static const float walls[6][4][3] = {
        { { -3, 0, -4 }, { -3, 0, 4 }, { 3, 0, 4 }, { 3, 0, -4 } },
        { { -3, 3, -4 }, { 3, 3, -4 }, { 3, 3, 4 }, { -3, 3, 4 } },
        { { -3, 0, -4 }, { 3, 0, -4 }, { 3, 3, -4 }, { -3, 3, -4 } },
        { { -3, 0, 4 }, { -3, 3, 4 }, { 3, 3, 4 }, { 3, 0, 4 } },
        { { -3, 0, -4 }, { -3, 3, -4 }, { -3, 3, 4 }, { -3, 0, 4 } },
        { { 3, 0, -4 }, { 3, 0, 4 }, { 3, 3, 4 }, { 3, 3, -4 } },
    };
    static const float x[2] = { -1, 1 }, z[2] = { -2.5f, -1.5f };
    static const struct camera inside = { "inside", { -0.5f, 1.6f, 3.6f }, { 0.1f, 1.2f, -4 }, { 0, 1, 0 }, 1.0f };
    struct punctual_light spot = { .kind = LIGHT_SPOT,
                                   .position = { 1.5f, 2.7f, 0 },
                                   .direction = { -0.50702f, -0.40562f, -0.76053f },
                                   .intensity = { 9, 8, 7 } };
    struct scene *s = scene_create();

    light_set_cone(&spot, 12.0 * PI / 180.0, 18.0 * PI / 180.0);
    add_quads(s, add_lambert(s, 0.6f), walls[0], 6);
    add_box(s, add_lambert(s, 0.3f), (const float[3]){ -1.2f, -0.1f, -2.2f }, (const float[3]){ -0.2f, 1.1f, -1.2f });
    add_panel(s, add_glowing(s, 0.5f, vec3_make(8, 7, 6)), x, 2.9f, z);
    add_light(s, spot);
    lit_make(l, s, &inside, WIDTH, HEIGHT, true);
}

static void render(struct lit *l, uint32_t samples, uint64_t seed, bool denoise, float *rgb)
{
    l->denoise = denoise;
    lit_render(l, samples, seed, rgb);
}

static double mean_of(const float *rgb)
{
    double sum = 0.0;

    for (size_t i = 0; i < 3 * PIXELS; i++)
        sum += rgb[i];
    return sum / (3 * PIXELS);
}

static double rel_mse(const float *rgb, const float *truth)
{
    const double mean = mean_of(truth);
    double sum = 0.0;

    for (size_t i = 0; i < 3 * PIXELS; i++)
        sum += pow(rgb[i] - truth[i], 2.0) / (pow(truth[i], 2.0) + 1e-2 * mean * mean);
    return sum / (3 * PIXELS);
}

/* Also in the first images of a live view, of 2 and 4 samples: they are better than unfiltered ones of 16 and more. */
static void filtered_light_is_nearer_to_the_truth(void **state)
{
    static const uint32_t samples[] = { 2, 4, 16, 64 };
    static float truth[3 * PIXELS], plain[3 * PIXELS], filtered[3 * PIXELS];
    double before = INFINITY;
    struct lit l;

    (void)state;
    room_make(&l);
    render(&l, samples_of_long_run(), 100, false, truth);
    for (size_t k = 0; k < sizeof(samples) / sizeof(samples[0]); k++) {
        render(&l, samples[k], 1, false, plain);
        render(&l, samples[k], 1, true, filtered);
        const double p = rel_mse(plain, truth), f = rel_mse(filtered, truth);
        const double energy = mean_of(filtered) / mean_of(truth) - 1.0, own = mean_of(plain) / mean_of(truth) - 1.0;
        printf("%u samples: relMSE %.5f, filtered %.5f; mean %+.4f, filtered %+.4f\n", samples[k], p, f, own, energy);
        assert_true(f < 0.5 * p && f < before);
        assert_true(fabs(energy) < 0.06 / sqrt(samples[k])); /* of the noise's size: unfiltered 0.03 by two samples */
        before = f;
    }
    lit_finish(&l);
}

/* By as many samples as the truth has, an unfiltered image differs from it as much as another one does. The mean is
 * held to 0.2 %, by half of the samples, as in each commit, to 0.28 %. */
static void filtered_light_converges_to_the_unfiltered(void **state)
{
    static float truth[3 * PIXELS], plain[3 * PIXELS], filtered[3 * PIXELS];
    struct lit l;

    (void)state;
    room_make(&l);
    render(&l, samples_of_long_run(), 100, false, truth);
    render(&l, samples_of_long_run(), 1, false, plain);
    render(&l, samples_of_long_run(), 1, true, filtered);
    const double p = rel_mse(plain, truth), f = rel_mse(filtered, truth);
    printf("%u samples: relMSE %.6f, filtered %.6f; mean %+.5f\n", samples_of_long_run(), p, f,
           mean_of(filtered) / mean_of(truth) - 1.0);
    assert_true(f < p);
    assert_float_equal(mean_of(filtered), mean_of(truth), 2e-3 * seeds_blur(256, 512) * mean_of(truth));
    lit_finish(&l);
}

/* Eleven samples: each half takes six. The part still reports eleven. */
static void filtered_light_has_the_same_bits_on_any_threads(void **state)
{
    static float one[3 * PIXELS], many[3 * PIXELS], beside[3 * PIXELS];
    const int before = omp_get_max_threads();
    struct lit l;

    (void)state;
    room_make(&l);
    omp_set_num_threads(1);
    render(&l, 11, 5, true, one);
    omp_set_num_threads(3);
    render(&l, 12, 5, true, many);
    omp_set_num_threads(before);
    assert_memory_equal(one, many, sizeof(one));
    lit_render_beside(&l, 11, 5, beside);
    assert_memory_equal(one, beside, sizeof(one));
    lit_finish(&l);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(filtered_light_is_nearer_to_the_truth),
    cmocka_unit_test(filtered_light_converges_to_the_unfiltered),
    cmocka_unit_test(filtered_light_has_the_same_bits_on_any_threads),
};

UNIT_MAIN(tests)
