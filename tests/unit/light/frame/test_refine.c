/* A sky that stands still: passes that are right in the mean, weighed against the image that was shown first. Random
 * numbers are fixed, so that each claim was looked at once with other seeds than those it is made with here. */
#include "light/estimators/points.h"
#include "light/frame/refine.h"
#include "light/resolve/resolve.h"
#include "measure/compare/metrics.h"
#include "support/sets.h"

#include <math.h>
#include <omp.h>
#include <pthread.h>
#include <time.h>

enum { WIDTH = 64, HEIGHT = 36, VALUES = 3 * WIDTH * HEIGHT }; /* at most */

struct stage {
    struct prepared_scene *set;
    int width, height, values;
    struct relighter *relighter;
    struct environment *sky;
    struct refiner *refiner;
    uint8_t mask[WIDTH * HEIGHT];
    float first[VALUES], want[VALUES], got[VALUES];
    struct reason why;
};

static struct stage *stage_make_of(uint32_t width, uint32_t height)
{
    const struct prepared_scene_desc desc = { .width = width, .height = height };
    struct stage *s = mem_alloc(1, sizeof(*s));

    assert_non_null(s);
    s->width = (int)width;
    s->height = (int)height;
    s->values = (int)(3 * width * height);
    s->sky = sky_environment(sky_with_sun(64, 32, 2e3f), 64, 0.0);
    s->set = set_of(&desc);
    s->relighter = relighter_create(s->set, best_kernels());
    s->refiner = refiner_create(s->set, best_kernels());
    assert_true(s->relighter && s->refiner);
    resolve_mask(s->set->gbuffer, s->mask);
    return s;
}

static struct stage *stage_make(void)
{
    return stage_make_of(WIDTH, HEIGHT);
}

static void stage_finish(struct stage *s)
{
    refiner_destroy(s->refiner);
    relighter_destroy(s->relighter);
    set_destroy(s->set);
    environment_destroy(s->sky);
    mem_free(s);
}

static void make(struct stage *s, const struct relight_desc *light, float *rgb)
{
    struct relight_stats stats;

    assert_int_equal(relighter_run(s->relighter, s->sky, light, rgb, &stats), ERR_OK);
}

/* That auto is right is shown elsewhere (test_estimators.c). */
static void make_reference(struct stage *s, uint32_t classes, uint32_t samples, uint32_t passes)
{
    struct relight_desc light = { .direct = { .method = METHOD_AUTO, .samples = samples, .seed = 4711 },
                                  .classes = classes };
    static double sum[VALUES];

    memset(sum, 0, sizeof(sum));
    for (; light.direct.pass < passes; light.direct.pass++) {
        make(s, &light, s->got);
        for (int i = 0; i < s->values; i++)
            sum[i] += (double)s->got[i];
    }
    for (int i = 0; i < s->values; i++)
        s->want[i] = (float)(sum[i] / passes);
}

static void pass(struct stage *s, const struct relight_desc *light, uint32_t count)
{
    while (count-- > 0)
        assert_int_equal(refiner_pass(s->refiner, s->sky, light), ERR_OK);
}

static double error_of(const struct stage *s, const float *rgb, const float *reference)
{
    struct metrics m;

    assert_true(metrics_compare(rgb, reference, s->mask, s->width, s->height, 0.0, NULL, &m));
    return m.rel_mse;
}

/* How far one image has left another, by the reference's light. */
static double left_of(struct stage *s, const float *rgb, const float *first)
{
    static float moved[VALUES];

    for (int i = 0; i < s->values; i++)
        moved[i] = s->want[i] + rgb[i] - first[i];
    return error_of(s, moved, s->want);
}

static double mean_of(const struct stage *s, const float *rgb)
{
    double sum = 0.0;

    for (int i = 0; i < s->values; i++)
        sum += s->mask[i / 3] ? (double)rgb[i] : 0.0;
    return sum;
}

/* Eight means of 64 passes each, of numbers of their own, against one of 16 passes of 1024 samples. The means scatter
 * by 0.5 to 0.8 %, since all points share light samples, and the reference by 0.2 %: off by 2.5 % of the light is
 * caught in 99 of 100 cases. The first image is black, and has a share of less than a fiftieth, which is taken out.
 */
static void the_mean_of_passes_is_the_reference(void **state)
{
    const struct refiner_wish wish = { 0.0, 0 };
    struct stage *s = stage_make_of(16, 9);
    struct refiner_stats stats;
    double sum = 0.0, square = 0.0;
    (void)state;

    make_reference(s, 0, 1024, 16);
    const double want = mean_of(s, s->want);
    for (uint64_t k = 0; k < 8; k++) {
        const struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 16, .seed = 100 + k } };
        refiner_begin(s->refiner, s->first);
        pass(s, &light, 64);
        refiner_look(s->refiner, &wish, &stats);
        assert_true(stats.first < 2e-2);
        refiner_image(s->refiner, s->got);
        const double ratio = mean_of(s, s->got) / (want * (1.0 - stats.first)) - 1.0;
        sum += ratio;
        square += ratio * ratio;
    }
    const double mean = sum / 8.0, scatter = sqrt((square / 8.0 - mean * mean) / 7.0);
    if (fabs(mean) > 4.0 * scatter + 5e-3 || scatter > 4e-3)
        fail_msg("off by %.5f, which is known within %.5f", mean, scatter);
    stage_finish(s);
}

/* On the way it is nearer to the truth than the cached image and than the passes' mean (a half is allowed for
 * what the weights do not know), it leaves the cached one by less than that is wrong, and says within a factor of 1.5
 * how far it is. The cached image is one whose sun is blurred over its cells; in the end a seventh of its error is
 * left. */
static void a_cached_image_goes_over_to_the_unbiased_one(void **state)
{
    const struct refiner_wish wish = { 0.0, 0 };
    const struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 16, .seed = 3 } };
    struct relight_desc blurred = light;
    struct stage *s = stage_make_of(48, 27);
    struct refiner_stats stats;
    (void)state;

    make_reference(s, 0, 512, seeds_count(12, 24));
    blurred.unsplit = true;
    make(s, &blurred, s->first);
    const double biased = error_of(s, s->first, s->want);
    double error = biased;
    refiner_begin(s->refiner, s->first);
    refiner_image(s->refiner, s->got);
    assert_memory_equal(s->got, s->first, (size_t)s->values * sizeof(float));
    for (uint32_t n = 2; n <= 64; n *= 2) {
        pass(s, &light, n == 2 ? 2 : n / 2);
        refiner_look(s->refiner, &wish, &stats);
        refiner_image(s->refiner, s->got);
        error = error_of(s, s->got, s->want);
        const double left = left_of(s, s->got, s->first);
        if (error > 1.5 * fmin(biased, stats.mean) || left > 1.1 * biased)
            fail_msg("%u passes: error %.2e, the first's %.2e, of the mean %.2e, left %.2e", n, error, biased,
                     stats.mean, left);
        if (n >= 8 && (stats.error > 1.5 * error || error > 1.5 * stats.error))
            fail_msg("%u passes: an error of %.2e is said to be %.2e", n, error, stats.error);
    }
    if (error > 0.15 * biased)
        fail_msg("an error of %.2e is left of %.2e", error, biased);
    stage_finish(s);
}

/* All light, the first image of few samples: what the weights come to is the mean with the first image in it as one
 * pass more, and the error is what it is said to be. */
static void a_noisy_image_becomes_a_clean_one(void **state)
{
    const uint32_t classes = PATH_BACKGROUND | PATH_DIRECT | PATH_INDIRECT | PATH_CAUSTICS;
    const struct relight_desc light = { .direct = { .method = METHOD_AUTO, .samples = 16 }, .classes = classes };
    const struct refiner_wish wish = { 0.0, 0 };
    struct stage *s = stage_make_of(32, 18);
    struct refiner_stats stats;
    (void)state;

    make_reference(s, classes, 128, seeds_count(16, 32));
    make(s, &light, s->first);
    const double noisy = error_of(s, s->first, s->want);
    refiner_begin(s->refiner, s->first);
    for (uint32_t n = 8; n <= 16; n *= 2) {
        pass(s, &light, n == 8 ? 8 : n / 2);
        refiner_look(s->refiner, &wish, &stats);
        refiner_image(s->refiner, s->got);
        const double error = error_of(s, s->got, s->want), want = 1.0 / (n + 1.0);
        if (stats.error > 1.5 * error || error > 1.5 * stats.error || error > 1.5 * noisy * want)
            fail_msg("%u passes: an error of %.2e is said to be %.2e; the first's was %.2e", n, error, stats.error,
                     noisy);
        if (stats.first > 2.0 * want || stats.first < 0.5 * want)
            fail_msg("%u passes: the first image has a share of %.3f", n, stats.first);
    }
    stage_finish(s);
}

static void *cancel_soon(void *arg)
{
    nanosleep(&(struct timespec){ .tv_nsec = 50000000 }, NULL);
    atomic_store((atomic_bool *)arg, true);
    return NULL;
}

/* A pass of half an hour, if nobody ended it. It leaves nothing behind: the next ones are those that would have been.
 */
static void a_pass_that_is_ended_does_not_count(void **state)
{
    static float want[VALUES];
    const struct refiner_wish wish = { 0.0, 0 };
    struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 16 } };
    struct stage *s = stage_make();
    struct refiner_stats stats;
    atomic_bool cancel = false;
    pthread_t thread;
    (void)state;

    for (int ended = 0; ended < 2; ended++) {
        refiner_begin(s->refiner, s->first);
        pass(s, &light, 2);
        if (ended) {
            struct relight_desc long_one = light;
            long_one.direct.samples = 1u << 20;
            long_one.direct.cancel = &cancel;
            assert_int_equal(pthread_create(&thread, NULL, cancel_soon, &cancel), 0);
            pass(s, &long_one, 1);
            pthread_join(thread, NULL);
        }
        pass(s, &light, 2);
        refiner_look(s->refiner, &wish, &stats);
        assert_int_equal(stats.passes, 4);
        refiner_image(s->refiner, ended ? s->got : want);
    }
    assert_memory_equal(s->got, want, sizeof(want));
    stage_finish(s);
}

static void any_number_of_threads_gives_the_same_bits(void **state)
{
    static float want[VALUES];
    const struct refiner_wish wish = { 0.0, 0 };
    const struct relight_desc light = { .direct = { .method = METHOD_AUTO, .samples = 16 } };
    const int threads = omp_get_max_threads();
    struct stage *s = stage_make();
    struct refiner_stats one, more;
    (void)state;

    make(s, &light, s->first);
    for (int k = 1; k <= 3; k += 2) {
        omp_set_num_threads(k);
        refiner_begin(s->refiner, s->first);
        pass(s, &light, 3);
        refiner_look(s->refiner, &wish, k == 1 ? &one : &more);
        refiner_image(s->refiner, k == 1 ? want : s->got);
    }
    omp_set_num_threads(threads);
    assert_memory_equal(s->got, want, sizeof(want));
    assert_memory_equal(&one, &more, sizeof(one));
    stage_finish(s);
}

/* One pass says nothing of its own error. */
static void it_is_good_enough_by_error_or_by_passes(void **state)
{
    const struct relight_desc light = { .direct = { .method = METHOD_AUTO, .samples = 16 } };
    struct stage *s = stage_make();
    struct refiner_stats stats;
    (void)state;

    make(s, &light, s->first);
    refiner_begin(s->refiner, s->first);
    pass(s, &light, 1);
    refiner_look(s->refiner, &(struct refiner_wish){ 1.0, 0 }, &stats);
    assert_true(!stats.converged && stats.error == 0.0 && stats.first == 1.0);
    pass(s, &light, 3);
    refiner_look(s->refiner, &(struct refiner_wish){ 1e-9, 0 }, &stats);
    assert_true(!stats.converged && stats.error > 0.0);
    const double error = stats.error;
    refiner_look(s->refiner, &(struct refiner_wish){ 1.05 * error, 0 }, &stats);
    assert_true(stats.converged);
    refiner_look(s->refiner, &(struct refiner_wish){ 1e-9, 5 }, &stats);
    assert_false(stats.converged);
    refiner_look(s->refiner, &(struct refiner_wish){ 1e-9, 4 }, &stats);
    assert_true(stats.converged);
    stage_finish(s);
}

/* The first live images are denoised and have a history, and a few are audited: none of that is for passes. */
static void passes_are_those_of_an_image_without_a_filter(void **state)
{
    struct stage *s = stage_make();
    struct relight_desc light = { .direct = { .method = METHOD_AUTO, .samples = 16 }, .classes = PATH_ALL };
    const struct refiner_wish wish = { .error = 1e-9, .passes = 100 };
    struct refiner_stats stats;
    (void)state;

    light.eye_paths = 1;
    make(s, &light, s->first);
    for (int k = 0; k < 2; k++) {
        light.denoise = light.remember = k == 1;
        refiner_begin(s->refiner, s->first);
        for (int i = 0; i < 3; i++)
            assert_int_equal(refiner_pass(s->refiner, s->sky, &light), ERR_OK);
        refiner_look(s->refiner, &wish, &stats);
        refiner_image(s->refiner, k ? s->got : s->want);
    }
    assert_memory_equal(s->got, s->want, (size_t)s->values * sizeof(float));
    stage_finish(s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(passes_are_those_of_an_image_without_a_filter),
    cmocka_unit_test(the_mean_of_passes_is_the_reference),
    cmocka_unit_test(a_cached_image_goes_over_to_the_unbiased_one),
    cmocka_unit_test(a_noisy_image_becomes_a_clean_one),
    cmocka_unit_test(a_pass_that_is_ended_does_not_count),
    cmocka_unit_test(any_number_of_threads_gives_the_same_bits),
    cmocka_unit_test(it_is_good_enough_by_error_or_by_passes),
};
UNIT_MAIN(tests)
