/* What images pass on to the next ones before a cache makes them (light/denoise/denoise.h). */

#include "base/rng.h"
#include "light/denoise/denoise.h"
#include "light/frame/relight_cache.h"
#include "light/frame/stage.h"
#include "measure/compare/metrics.h"

#include <math.h>
#include <time.h>

enum { WIDTH = 64, HEIGHT = 36 };

struct rig {
    struct prepared_scene *set;
    struct denoiser *denoiser;
    struct accumulation *accumulation;
    size_t floats;
    float *lo; /* [floats] */
};

static struct rig rig_make(void)
{
    struct rig r = { .set = set_of(&(struct prepared_scene_desc){ .width = WIDTH, .height = HEIGHT }) };

    r.floats = (size_t)r.set->gbuffer->packet_count * 3 * PACKET;
    r.denoiser = denoiser_create(r.set->gbuffer, &r.set->view, NULL);
    r.accumulation = accumulation_create(r.set->gbuffer, r.denoiser);
    r.lo = mem_alloc(r.floats, sizeof(float));
    assert_true(r.denoiser && r.accumulation && r.lo);
    return r;
}

static void rig_finish(struct rig *r)
{
    mem_free(r->lo);
    accumulation_destroy(r->accumulation);
    denoiser_destroy(r->denoiser);
    set_destroy(r->set);
}

/* An image of packets that all find a and b in the two halves. */
static void image(struct rig *r, float a, float b)
{
    accumulation_begin(r->accumulation, 1, 0);
    for (size_t i = 0; i < r->floats; i++) {
        denoiser_half(r->denoiser, 0)[i] = a;
        denoiser_half(r->denoiser, 1)[i] = b;
    }
    accumulation_add(r->accumulation, NULL, NULL);
    accumulation_show(r->accumulation, r->lo);
}

/* A point that pixels show: others are not filtered. */
static float shown(const struct rig *r)
{
    return r->lo[(size_t)r->set->gbuffer->entries[0].point / PACKET * 3 * PACKET +
                 r->set->gbuffer->entries[0].point % PACKET];
}

/* From 1 to 1.4 in ACCUMULATION_GLIDE images; the smooth step's second differences are at most 6 over their square.
 * Both halves differ from the light before by less than their noise, so that they weigh a half. */
static void light_without_a_cache_glides(void **state)
{
    struct rig r = rig_make();
    float was[3] = { 1.0f, 1.0f, 1.0f };
    (void)state;

    image(&r, 1.0f, 1.0f);
    was[1] = was[2] = shown(&r);
    accumulation_begin(r.accumulation, 1, ACCUMULATION_GLIDE);
    for (size_t i = 0; i < r.floats; i++) {
        denoiser_half(r.denoiser, 0)[i] = 1.2f;
        denoiser_half(r.denoiser, 1)[i] = 1.6f;
    }
    accumulation_add(r.accumulation, NULL, NULL);
    accumulation_show(r.accumulation, r.lo);
    const float first = shown(&r) - was[2];
    assert_true(accumulation_glides(r.accumulation) && first > 0.0f && first < 0.02f);
    for (int k = 1; k < ACCUMULATION_GLIDE; k++) {
        was[0] = was[1];
        was[1] = was[2];
        was[2] = shown(&r);
        assert_true(fabsf(was[2] - 2.0f * was[1] + was[0]) <
                    0.4f * 6.0f / (ACCUMULATION_GLIDE * ACCUMULATION_GLIDE) + 1e-4f);
        assert_true(accumulation_glides(r.accumulation));
        accumulation_begin(r.accumulation, 1, ACCUMULATION_GLIDE);
        accumulation_glide(r.accumulation, r.lo);
    }
    assert_false(accumulation_glides(r.accumulation));
    assert_true(shown(&r) > 1.15f && shown(&r) < 1.45f);
    accumulation_begin(r.accumulation, 2, ACCUMULATION_GLIDE); /* other light is displayed at once */
    accumulation_add(r.accumulation, NULL, NULL);
    accumulation_show(r.accumulation, r.lo);
    assert_false(accumulation_glides(r.accumulation));
    rig_finish(&r);
}

static void show_halves(struct rig *r, bool still, float a, float b)
{
    accumulation_begin(r->accumulation, 1, still ? ACCUMULATION_STEADY : 0);
    accumulation_hold(r->accumulation, still);
    for (size_t i = 0; i < r->floats; i++) {
        denoiser_half(r->denoiser, 0)[i] = a;
        denoiser_half(r->denoiser, 1)[i] = b;
    }
    accumulation_add(r->accumulation, NULL, NULL);
    accumulation_show(r->accumulation, r->lo);
}

/* Without a cache each image adds its samples, of 1 and then of 2, to the plain mean of all; the light that it
 * displays goes a quarter of the way to that. Another sky's goes all of it. */
static void samples_under_a_still_sky_do_not_flicker(void **state)
{
    struct rig r = rig_make();
    double mean = 1.0, want = 1.0;
    (void)state;

    show_halves(&r, false, 1.0f, 1.0f);
    assert_float_equal(shown(&r), 1.0, 1e-5);
    for (int n = 2; n <= 32; n++) {
        show_halves(&r, true, 2.0f, 2.0f);
        mean += (2.0 - mean) / n;
        want += 0.25 * (mean - want);
        assert_float_equal(shown(&r), want, 1e-3);
    }
    assert_float_equal(shown(&r), 2.0, 0.05);
    show_halves(&r, false, 4.0f, 4.0f);
    assert_float_equal(shown(&r), 4.0, 0.05);
    rig_finish(&r);
}

/* By hand: halves m + x and m - x give V = x^2. Where surfaces differ the filter takes some hundredths of x. */
static void noise_becomes_the_plain_mean(void **state)
{
    struct rig r = rig_make();
    (void)state;

    image(&r, 1.5f, 0.5f);
    assert_float_equal(shown(&r), 1.0, 0.05);
    image(&r, 4.0f, 4.0f); /* V = 0: the sky is brighter, and what is known with it */
    assert_float_equal(shown(&r), 4.0, 0.05);
    image(&r, 5.0f, 3.0f); /* D = 0: (2 * 4 + 4) / 3 */
    assert_float_equal(shown(&r), 4.0, 0.05);
    image(&r, 8.0f, 3.0f);                               /* D = 1.5^2 < V = 2.5^2: n / (n + 1) = 3 / 4 */
    assert_float_equal(shown(&r), 4.0 + 1.5 / 4.0, 0.1); /* the nearest wrong weight, 2 / 3, gives 4.5 */
    image(&r, 8.5f, 6.5f); /* 3.125 more, V = 1: 1 - 1 / 3.125^2 of it for all, then n / (n + 1) = 4 / 5 */
    assert_float_equal(shown(&r), 7.5 - 0.32 * 0.8, 0.15); /* the mean of all samples is 4.4 */
    rig_finish(&r);
}

/* In another number of steps each is the same part of the way, and without steps left the light stays. */
static void a_glide_of_a_round_is_even(void **state)
{
    enum { STEPS = 5 };
    struct rig r = rig_make();
    float at[STEPS + 1];
    (void)state;

    image(&r, 1.0f, 1.0f);
    at[0] = shown(&r);
    accumulation_begin(r.accumulation, 1, STEPS);
    for (size_t i = 0; i < r.floats; i++) {
        denoiser_half(r.denoiser, 0)[i] = 1.2f;
        denoiser_half(r.denoiser, 1)[i] = 1.6f;
    }
    accumulation_add(r.accumulation, NULL, NULL);
    accumulation_show(r.accumulation, r.lo);
    for (int k = 1; k <= STEPS; k++) {
        at[k] = shown(&r);
        assert_int_equal(accumulation_glides(r.accumulation), STEPS - k);
        accumulation_glide(r.accumulation, r.lo);
    }
    assert_true(at[STEPS] > 1.15f && shown(&r) == at[STEPS]);
    for (int k = 1; k <= STEPS; k++)
        assert_float_equal(at[k] - at[k - 1], (at[STEPS] - at[0]) / STEPS, 1e-5f);
    rig_finish(&r);
}

/* The cache's light, 2, takes over from 1 in ACCUMULATION_GLIDE images without a jump, and is shown as it is. */
static void the_cache_takes_over_without_a_jump(void **state)
{
    struct rig r = rig_make();
    float was[3] = { 1.0f, 1.0f, 1.0f };
    unsigned left = ACCUMULATION_GLIDE;
    (void)state;

    image(&r, 1.0f, 1.0f);
    while (left-- > 0) {
        was[0] = was[1];
        was[1] = was[2];
        accumulation_begin(r.accumulation, 1, ACCUMULATION_GLIDE);
        for (size_t i = 0; i < r.floats; i++)
            r.lo[i] = 2.0f;
        assert_int_equal(accumulation_leave(r.accumulation, true, r.lo), left);
        was[2] = shown(&r);
        assert_true(fabsf(was[2] - 2.0f * was[1] + was[0]) < 6.0f / (ACCUMULATION_GLIDE * ACCUMULATION_GLIDE) + 1e-4f);
    }
    for (size_t k = 0; k < r.floats; k++)
        assert_true(r.lo[k] == 2.0f);
    accumulation_begin(r.accumulation, 2, ACCUMULATION_GLIDE); /* other light is not left slowly */
    r.lo[0] = 5.0f;
    assert_true(accumulation_leave(r.accumulation, true, r.lo) == 0 && r.lo[0] == 5.0f);
    rig_finish(&r);
}

/* Until the cache is complete the glide does not end, so that a part of it, from 2 to 3, goes a quarter of its way in
 * an image. */
static void parts_of_the_cache_appear_without_a_jump(void **state)
{
    struct rig r = rig_make();
    double want = 2.0;
    (void)state;

    image(&r, 1.0f, 1.0f);
    for (int k = 0; k < 100; k++) {
        accumulation_begin(r.accumulation, 1, ACCUMULATION_GLIDE);
        for (size_t i = 0; i < r.floats; i++)
            r.lo[i] = k < 60 ? 2.0f : 3.0f;
        assert_int_equal(accumulation_leave(r.accumulation, k > 90, r.lo) > 0, k < 93);
        want += k < 60 ? 0.0 : 0.25 * (3.0 - want);
        if (k >= 50 && k < 90)
            assert_float_equal(shown(&r), want, 1e-3);
    }
    for (size_t k = 0; k < r.floats; k++)
        assert_true(r.lo[k] == 3.0f);
    rig_finish(&r);
}

/* Light of other classes is another light. */
static void another_key_forgets_all(void **state)
{
    struct rig r = rig_make();
    (void)state;

    image(&r, 8.0f, 2.0f);
    accumulation_begin(r.accumulation, 2, 0);
    for (size_t i = 0; i < r.floats; i++)
        denoiser_half(r.denoiser, 0)[i] = denoiser_half(r.denoiser, 1)[i] = 1.0f;
    accumulation_add(r.accumulation, NULL, NULL);
    accumulation_show(r.accumulation, r.lo);
    assert_float_equal(shown(&r), 1.0, 1e-5);
    rig_finish(&r);
}

static double relmse(const float *x, const float *truth)
{
    struct metrics m;

    assert_true(metrics_compare(x, truth, NULL, WIDTH, HEIGHT, 0.05, NULL, &m));
    return m.rel_mse_trimmed;
}

/* Error of images 1, 4 and 16 under a still sky, against 256 samples. Plain means of 16 have a sixteenth of the
 * variance; the filter takes less from them, since it sees less noise: 0.5 after 4 and 0.25 after 16 leave room for
 * that, and a history that keeps nothing gives 1. */
static void converge(bool ground)
{
    struct stage s = stage_make(&(struct prepared_scene_desc){ .width = WIDTH, .height = HEIGHT, .ground = ground },
                                sky_with_sun(64, 32, 2e3f));
    struct relight_desc light = { .direct = { .method = METHOD_MIS, .samples = 256 },
                                  .classes = PATH_ALL,
                                  .eye_paths = 64 };
    const size_t values = (size_t)3 * WIDTH * HEIGHT;
    float *truth = mem_alloc(values, sizeof(float));
    double error[16];
    struct relight_stats stats;

    assert_non_null(truth);
    assert_int_equal(stage_run(&s, &light, &stats), ERR_OK);
    memcpy(truth, s.rgb, values * sizeof(float));
    light.direct.samples = 8;
    light.direct.method = METHOD_AUTO;
    light.eye_paths = 2;
    light.denoise = light.remember = true;
    for (int k = 0; k < 16; k++) {
        assert_int_equal(stage_run(&s, &light, &stats), ERR_OK);
        error[k] = relmse(s.rgb, truth);
    }
    print_message("relMSE of images 1, 4, 16: %.2e %.2e %.2e\n", error[0], error[3], error[15]);
    assert_true(error[3] < 0.5 * error[0]);
    assert_true(error[15] < 0.25 * error[0]);
    light.remember = false; /* as the first one, but for the random numbers, which are those of pass 0 again */
    assert_int_equal(stage_run(&s, &light, &stats), ERR_OK);
    assert_float_equal(relmse(s.rgb, truth), error[0], 1e-6);
    mem_free(truth);
    stage_finish(&s);
}

static void images_of_a_still_sky_converge(void **state)
{
    (void)state;
    converge(false);
}

/* A shadow catcher has a history as well. */
static void images_with_a_ground_converge(void **state)
{
    (void)state;
    converge(true);
}

/* An image of the complete cache is that of the cache alone, to the bit. */
static void a_history_ends_with_the_finished_cache(void **state)
{
    struct stage s = stage_make(&(struct prepared_scene_desc){ .width = 16, .height = 9 }, sky_with_sun(64, 32, 2e3f));
    struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 64 },
                                  .classes = PATH_DIRECT | PATH_INDIRECT_LIT | PATH_BACKGROUND,
                                  .cache_background = true,
                                  .remember = true };
    const size_t bytes = (size_t)3 * 16 * 9 * sizeof(float);
    float *last = mem_alloc(bytes, 1);
    struct relight_desc first = light;
    struct relight_stats stats;
    (void)state;

    assert_non_null(last);
    first.direct.method = METHOD_AUTO;
    first.denoise = true;
    assert_int_equal(stage_run(&s, &first, &stats), ERR_OK);
    for (int complete = 0; complete < 2 * ACCUMULATION_GLIDE;) {
        assert_int_equal(stage_run(&s, &light, &stats), ERR_OK);
        complete += stats.cache_share == 1.0;
        nanosleep(&(struct timespec){ .tv_nsec = 100000000 }, NULL); /* leaves the processor to the cache */
    }
    memcpy(last, s.rgb, bytes);
    light.remember = light.cache_background = false;
    assert_int_equal(stage_run(&s, &light, &stats), ERR_OK);
    assert_memory_equal(last, s.rgb, bytes);
    mem_free(last);
    stage_finish(&s);
}

/* BRDF samples of each shade point, half of all, in a denoised image of two samples. */
static uint64_t lobes_of_two(uint32_t classes, bool remember)
{
    struct stage s = stage_make(&(struct prepared_scene_desc){ .width = 32, .height = 18 }, sky_with_sun(64, 32, 2e3f));
    const struct relight_desc light = { .direct = { .method = METHOD_AUTO, .samples = 2, .seed = 5 },
                                        .classes = classes,
                                        .denoise = true,
                                        .remember = remember };
    struct relight_stats stats;

    assert_int_equal(stage_run(&s, &light, &stats), ERR_OK);
    const uint64_t lobes = stats.direct.lobes / s.set->gbuffer->point_count;
    stage_finish(&s);
    return lobes;
}

/* Whose two halves have at least eight samples; other light costs more, and live images add up. */
static void few_samples_of_direct_light_alone_are_not_halved(void **state)
{
    (void)state;
    assert_int_equal(lobes_of_two(PATH_BACKGROUND | PATH_DIRECT, false), 2 * 4);
    assert_int_equal(lobes_of_two(PATH_BACKGROUND | PATH_DIRECT, true), 2 * 1);
    assert_int_equal(lobes_of_two(PATH_ALL, false), 2 * 1);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(few_samples_of_direct_light_alone_are_not_halved),
    cmocka_unit_test(light_without_a_cache_glides),
    cmocka_unit_test(a_glide_of_a_round_is_even),
    cmocka_unit_test(samples_under_a_still_sky_do_not_flicker),
    cmocka_unit_test(noise_becomes_the_plain_mean),
    cmocka_unit_test(the_cache_takes_over_without_a_jump),
    cmocka_unit_test(parts_of_the_cache_appear_without_a_jump),
    cmocka_unit_test(another_key_forgets_all),
    cmocka_unit_test(images_of_a_still_sky_converge),
    cmocka_unit_test(images_with_a_ground_converge),
    cmocka_unit_test(a_history_ends_with_the_finished_cache),
};
UNIT_MAIN(tests)
