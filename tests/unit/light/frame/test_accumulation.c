/* What images pass on to the next ones while a cache is being computed (light/denoise/accumulation.h). */

#include "base/rng.h"
#include "light/denoise/accumulation.h"
#include "light/frame/relight_indirect.h"
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
    float *cache, *lo; /* [floats] */
};

static struct rig rig_make(void)
{
    struct rig r = { .set = set_of(&(struct prepared_scene_desc){ .width = WIDTH, .height = HEIGHT }) };

    r.floats = (size_t)r.set->gbuffer->packet_count * 3 * PACKET;
    r.denoiser = denoiser_create(r.set->gbuffer, &r.set->view, NULL);
    r.accumulation = accumulation_create(r.set->gbuffer, r.denoiser);
    r.cache = mem_alloc(r.floats, sizeof(float));
    r.lo = mem_alloc(r.floats, sizeof(float));
    assert_true(r.denoiser && r.accumulation && r.cache && r.lo);
    return r;
}

static void rig_finish(struct rig *r)
{
    mem_free(r->cache);
    mem_free(r->lo);
    accumulation_destroy(r->accumulation);
    denoiser_destroy(r->denoiser);
    set_destroy(r->set);
}

/* An image of due packets that all find a and b in the two halves. cache: its light everywhere; below 0: none. */
static void image(struct rig *r, float cache, float a, float b)
{
    accumulation_begin(r->accumulation, 1, false);
    for (size_t i = 0; i < r->floats; i++)
        r->cache[i] = cache;
    if (cache >= 0.0f)
        accumulation_follow(r->accumulation, r->cache);
    for (size_t i = 0; i < r->floats; i++) {
        denoiser_half(r->denoiser, 0)[i] = a;
        denoiser_half(r->denoiser, 1)[i] = b;
    }
    accumulation_add(r->accumulation, NULL);
    accumulation_show(r->accumulation, NULL, r->lo);
}

/* Rough everywhere, with the versions of the image before. */
static void versions(struct rig *r, float final, bool changed)
{
    for (uint32_t k = 0; k < r->set->gbuffer->packet_count; k++) {
        accumulation_final(r->accumulation)[k] = final;
        accumulation_changed(r->accumulation)[k] = changed;
    }
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

    image(&r, -1.0f, 1.0f, 1.0f);
    was[1] = was[2] = shown(&r);
    accumulation_begin(r.accumulation, 1, true);
    for (size_t i = 0; i < r.floats; i++) {
        denoiser_half(r.denoiser, 0)[i] = 1.2f;
        denoiser_half(r.denoiser, 1)[i] = 1.6f;
    }
    accumulation_add(r.accumulation, NULL);
    accumulation_show(r.accumulation, NULL, r.lo);
    const float first = shown(&r) - was[2];
    assert_true(accumulation_glides(r.accumulation) && first > 0.0f && first < 0.02f);
    for (int k = 1; k < ACCUMULATION_GLIDE; k++) {
        was[0] = was[1];
        was[1] = was[2];
        was[2] = shown(&r);
        assert_true(fabsf(was[2] - 2.0f * was[1] + was[0]) <
                    0.4f * 6.0f / (ACCUMULATION_GLIDE * ACCUMULATION_GLIDE) + 1e-4f);
        assert_true(accumulation_glides(r.accumulation));
        accumulation_begin(r.accumulation, 1, true);
        accumulation_glide(r.accumulation, r.lo);
    }
    assert_false(accumulation_glides(r.accumulation));
    assert_true(shown(&r) > 1.15f && shown(&r) < 1.45f);
    accumulation_begin(r.accumulation, 2, true); /* other light is displayed at once */
    accumulation_add(r.accumulation, NULL);
    accumulation_show(r.accumulation, NULL, r.lo);
    assert_false(accumulation_glides(r.accumulation));
    rig_finish(&r);
}

static void show_halves(struct rig *r, bool still, float a, float b)
{
    accumulation_begin(r->accumulation, 1, false);
    accumulation_hold(r->accumulation, still);
    for (size_t i = 0; i < r->floats; i++) {
        denoiser_half(r->denoiser, 0)[i] = a;
        denoiser_half(r->denoiser, 1)[i] = b;
    }
    accumulation_add(r->accumulation, NULL);
    accumulation_show(r->accumulation, NULL, r->lo);
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

    image(&r, -1.0f, 1.5f, 0.5f);
    assert_float_equal(shown(&r), 1.0, 0.05);
    image(&r, -1.0f, 4.0f, 4.0f); /* V = 0: the sky is brighter, and what is known with it */
    assert_float_equal(shown(&r), 4.0, 0.05);
    image(&r, -1.0f, 5.0f, 3.0f); /* D = 0: (2 * 4 + 4) / 3 */
    assert_float_equal(shown(&r), 4.0, 0.05);
    image(&r, -1.0f, 8.0f, 3.0f); /* D = 1.5^2 < V = 2.5^2: n / (n + 1) = 3 / 4 */
    assert_float_equal(shown(&r), 4.0 + 1.5 / 4.0, 0.05);
    image(&r, -1.0f, 8.5f, 6.5f); /* 3.125 more, V = 1: 1 - 1 / 3.125^2 of it for all, then n / (n + 1) = 4 / 5 */
    assert_float_equal(shown(&r), 7.5 - 0.32 * 0.8, 0.05);
    rig_finish(&r);
}

/* What the cache says of the sky's change counts at once; what it says of its own versions does not. */
static void the_cache_predicts_what_the_sky_changes(void **state)
{
    struct rig r = rig_make();
    float *before = mem_alloc(r.floats, sizeof(float));
    size_t others = 0;
    (void)state;

    assert_non_null(before);
    versions(&r, 0.0f, false);
    /* Filtered in the eighth image, and shown in equal steps from there on. */
    for (int k = 0; k < 2 * ACCUMULATION_TURNS; k++) {
        image(&r, 1.0f, 3.0f, 3.0f);
        const double part = fmin(fmax(k + 2 - ACCUMULATION_TURNS, 0.0) / ACCUMULATION_TURNS, 1.0);
        assert_float_equal(shown(&r), 1.0 + 2.0 * part, 1e-5);
    }
    memcpy(before, r.lo, r.floats * sizeof(float));
    image(&r, 2.0f, 4.0f, 4.0f); /* one packet in ACCUMULATION_TURNS has a sample */
    for (size_t k = 0; k < r.floats; k++)
        others += fabs((double)r.lo[k] - (double)before[k] - 1.0) > 1e-3;
    assert_true(others < r.floats / 1000); /* but a few, which the filter clamps */
    versions(&r, 0.0f, true);
    image(&r, 3.5f, 4.0f, 4.0f);
    assert_float_equal(shown(&r), 4.0, 0.05);
    versions(&r, 0.25f, false); /* a quarter is the cache's own light by now */
    image(&r, 3.5f, 4.0f, 4.0f);
    assert_float_equal(shown(&r), 4.0 - 0.25 * 0.5, 0.05);
    versions(&r, 1.0f, false);
    image(&r, 3.25f, 9.0f, 9.0f);
    assert_true(accumulation_due(r.accumulation)->count == 0);
    assert_true(accumulation_beyond(r.accumulation)->count == r.set->gbuffer->packet_count);
    for (uint32_t k = 0; k < r.set->gbuffer->packet_count * 3 * PACKET; k++)
        assert_true(r.lo[k] == 3.25f);
    mem_free(before);
    rig_finish(&r);
}

enum { STAY = 24, SWEEP = 80, PER_IMAGE = 2 }; /* images; packets that the edge crosses in one */
static const float SHADOW = 0.08f, LIT = 1.0f;

/* The shadow covers the packets before the edge. */
static float light_at(size_t packet, int edge)
{
    return (int)packet < edge ? SHADOW : LIT;
}

/* A shadow's edge stays, and then moves to and fro; the cache has it some packets farther. The error of what is shown
 * beyond either light. */
static double beyond_edge(int farther)
{
    struct rig r = rig_make();
    const struct gbuffer *g = r.set->gbuffer;
    double beyond = 0.0;

    versions(&r, 0.0f, false);
    for (int turn = 0; turn < STAY + 2 * SWEEP; turn++) {
        const int step = turn < STAY ? 0 : turn < STAY + SWEEP ? turn - STAY : STAY + 2 * SWEEP - turn;
        const int edge = 20 + PER_IMAGE * step;
        accumulation_begin(r.accumulation, 1, false);
        for (size_t i = 0; i < r.floats; i++) {
            r.cache[i] = light_at(i / (3 * PACKET), edge + farther);
            denoiser_half(r.denoiser, 0)[i] = denoiser_half(r.denoiser, 1)[i] = light_at(i / (3 * PACKET), edge);
        }
        accumulation_follow(r.accumulation, r.cache);
        accumulation_add(r.accumulation, NULL);
        accumulation_show(r.accumulation, NULL, r.lo);
        for (uint32_t k = 0; k < g->entry_first[WIDTH * HEIGHT]; k++) {
            if (g->entries[k].weight[0] < 0.75f) /* others may be filtered with unlike points */
                continue;
            const float x = r.lo[(size_t)g->entries[k].point / PACKET * 3 * PACKET + g->entries[k].point % PACKET];
            beyond = fmax(beyond, fmax((double)SHADOW - x, (double)x - LIT));
        }
    }
    rig_finish(&r);
    return beyond;
}

/* A cache that misplaces a shadow leaves no contours beside its edge, darker than the shadow or brighter than light. */
static void a_misplaced_shadow_leaves_no_ghost(void **state)
{
    (void)state;
    for (int farther = -12; farther <= 12; farther += 8) {
        const double beyond = beyond_edge(farther);
        print_message("a shadow %d packets too far: %.4f beyond either light\n", farther, beyond);
        assert_true(beyond < 0.02);
    }
}

/* Beside a cache every packet has its turn, once in ACCUMULATION_TURNS images; without one it is all of them at once.
 */
static void packets_take_turns(void **state)
{
    struct rig r = rig_make();
    const uint32_t packets = r.set->gbuffer->packet_count;
    uint8_t *turns = mem_alloc(packets, 1);
    (void)state;

    assert_non_null(turns);
    image(&r, -1.0f, 1.0f, 1.0f);
    assert_true(accumulation_due(r.accumulation)->count == packets);
    versions(&r, 0.0f, false);
    for (int k = 0; k < ACCUMULATION_TURNS; k++) {
        image(&r, 1.0f, 1.0f, 1.0f);
        for (uint32_t i = 0; i < accumulation_due(r.accumulation)->count; i++)
            turns[accumulation_due(r.accumulation)->index[i]]++;
    }
    for (uint32_t i = 0; i < packets; i++)
        assert_true(turns[i] == 1);
    assert_true(accumulation_turn(r.accumulation) == ACCUMULATION_TURNS + 1);
    mem_free(turns);
    rig_finish(&r);
}

/* Light of other classes is another light. */
static void another_key_forgets_all(void **state)
{
    struct rig r = rig_make();
    (void)state;

    image(&r, -1.0f, 8.0f, 2.0f);
    accumulation_begin(r.accumulation, 2, false);
    for (size_t i = 0; i < r.floats; i++)
        denoiser_half(r.denoiser, 0)[i] = denoiser_half(r.denoiser, 1)[i] = 1.0f;
    accumulation_add(r.accumulation, NULL);
    accumulation_show(r.accumulation, NULL, r.lo);
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

/* Mean squared error of what is shown after eight turns beside a cache that says 2 everywhere, where the samples' mean
 * is `truth` and each half of a packet is off by up to 1.7, evenly: V = 0.5. */
static double error_beside_cache(float truth)
{
    struct rig r = rig_make();
    struct rng rng = { .state = 11 };
    double sum = 0.0;

    versions(&r, 0.0f, false);
    for (size_t i = 0; i < r.floats; i++)
        r.cache[i] = 2.0f;
    for (int turn = 0; turn < 9 * ACCUMULATION_TURNS - 1;
         turn++) { /* the last ones until the eighth filter's output shows */
        accumulation_begin(r.accumulation, 1, false);
        accumulation_follow(r.accumulation, r.cache);
        for (size_t i = 0; i < r.floats; i += 3 * PACKET)
            for (int half = 0; half < 2; half++) {
                const float off = 1.732f * (float)(2.0 * rng_next(&rng) - 1.0);
                for (size_t k = i; k < i + 3 * PACKET; k++)
                    denoiser_half(r.denoiser, half)[k] = truth + off;
            }
        accumulation_add(r.accumulation, NULL);
        accumulation_show(r.accumulation, NULL, r.lo);
    }
    for (size_t i = 0; i < r.floats; i++)
        sum += ((double)r.lo[i] - truth) * ((double)r.lo[i] - truth) / (double)r.floats;
    rig_finish(&r);
    return sum;
}

/* Where the cache is right, by its weight; where it is wrong by 1 and by 4, by eight samples' mean. One sample is off
 * by 0.5. Without the cache as B to begin with, the first would be as the last; without samples the others would be 1
 * and 16. */
static void samples_beside_a_cache_weigh_as_they_deserve(void **state)
{
    const double right = error_beside_cache(2.0f), wrong = error_beside_cache(3.0f), far = error_beside_cache(6.0f);
    (void)state;

    print_message("squared errors: %.3f %.3f %.3f\n", right, wrong, far);
    assert_true(right < 0.05);
    assert_true(wrong < 0.15);
    assert_true(far < 0.35);
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
    struct relight_stats stats;
    (void)state;

    assert_non_null(last);
    for (int complete = 0; complete < 3 * RELIGHT_INDIRECT_FADE;) {
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
    cmocka_unit_test(samples_under_a_still_sky_do_not_flicker),
    cmocka_unit_test(noise_becomes_the_plain_mean),
    cmocka_unit_test(the_cache_predicts_what_the_sky_changes),
    cmocka_unit_test(a_misplaced_shadow_leaves_no_ghost),
    cmocka_unit_test(packets_take_turns),
    cmocka_unit_test(another_key_forgets_all),
    cmocka_unit_test(images_of_a_still_sky_converge),
    cmocka_unit_test(images_with_a_ground_converge),
    cmocka_unit_test(samples_beside_a_cache_weigh_as_they_deserve),
    cmocka_unit_test(a_history_ends_with_the_finished_cache),
};
UNIT_MAIN(tests)
