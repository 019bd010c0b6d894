/* The stated error of live pictures (history/stated.h) against the true one. */

#include "base/rng.h"
#include "history/denoise.h"
#include "light/stage.h"
#include "history/stated.h"

#include <math.h>

enum { WIDTH = 96, HEIGHT = 54, VALUES = 3 * WIDTH * HEIGHT, SEEDS = 4, PICTURES = 3, TRUTH = 96 };

struct rig {
    struct set *set;
    struct stated *stated;
    size_t floats;
    float *half[2], *shown, *apart, *rgb;
};

static struct rig rig_make(void)
{
    struct rig r = { .set = set_of(&(struct set_desc){ .width = WIDTH, .height = HEIGHT }) };

    r.floats = (size_t)r.set->gbuffer->packet_count * 3 * PACKET;
    r.stated = stated_create(r.set->gbuffer);
    r.half[0] = mem_alloc(r.floats, sizeof(float));
    r.half[1] = mem_alloc(r.floats, sizeof(float));
    r.shown = mem_alloc(r.floats, sizeof(float));
    r.apart = mem_alloc(r.floats, sizeof(float));
    r.rgb = mem_alloc(VALUES, sizeof(float));
    assert_true(r.stated && r.half[0] && r.half[1] && r.shown && r.apart && r.rgb);
    for (size_t v = 0; v < VALUES; v++)
        r.rgb[v] = 1.0f;
    return r;
}

static void rig_finish(struct rig *r)
{
    mem_free(r->half[0]);
    mem_free(r->half[1]);
    mem_free(r->shown);
    mem_free(r->apart);
    mem_free(r->rgb);
    stated_destroy(r->stated);
    set_destroy(r->set);
}

/* A picture whose light is 1 and whose filtered halves differ by 2 x apart. */
static void see(struct rig *r, float apart)
{
    for (size_t i = 0; i < r->floats; i++) {
        r->shown[i] = 1.0f;
        r->apart[i] = apart;
    }
    stated_see(r->stated, r->rgb, &(struct stated_light){ r->shown, { r->shown, r->shown }, r->apart });
}

/* The samples' mean is 1.2, each half has noise of its own, even over +-spread. Half of the light is `more`. */
static void take(struct rig *r, float spread, struct rng *rng)
{
    for (size_t i = 0; i < r->floats; i++)
        for (int k = 0; k < 2; k++)
            r->half[k][i] = 0.6f + spread * ((float)rng_next(rng) - 0.5f);
    const float *const half[2] = { r->half[0], r->half[1] };
    stated_take(r->stated, half, half, r->shown);
}

/* The mean over all pixels of the light of a point, squared, relative to 1.01. */
static double covered(const struct set *set)
{
    const struct gbuffer *g = set->gbuffer;
    double sum = 0.0;

    for (uint32_t i = 0; i < WIDTH * HEIGHT; i++)
        for (int c = 0; c < 3; c++) {
            double w = 0.0;
            for (uint32_t k = g->entry_first[i]; k < g->entry_first[i + 1]; k++)
                w += (double)g->entries[k].weight[c];
            sum += w * w / (1.01 * VALUES);
        }
    return sum;
}

/* By hand: the error of what is shown is 0.2^2, its noise 0.04^2, where a surface is. Of the next picture, with half
 * the noise, a quarter is stated: by the ratio, not by what was measured of the picture before. The product of two
 * halves' noise, of variance 1/3 in all, over 11,700 values has a standard deviation of 0.003, the ratio of some five
 * pictures one of 1; noise itself would be 1/6. */
static void the_ratio_of_error_to_noise_is_measured(void **state)
{
    struct rig r = rig_make();
    struct rng rng = { .state = 5 };
    double sum = 0.0;
    (void)state;

    take(&r, 0.1f, &rng);
    assert_true(stated_error(r.stated) == 0.0); /* without a picture it is relative to nothing */
    see(&r, 0.04f);
    assert_true(stated_error(r.stated) == 0.0); /* nothing was measured */
    for (int k = 0; k < 24; k++) {
        take(&r, 0.1f, &rng);
        see(&r, 0.04f);
    }
    const double expected = STATED_PER * 0.04 * covered(r.set);
    print_message("stated %.4f, true %.4f\n", stated_error(r.stated), expected);
    assert_float_equal(stated_error(r.stated), expected, 0.03 * expected);
    see(&r, 0.02f);
    assert_float_equal(stated_error(r.stated), 0.25 * expected, 0.01 * expected);
    stated_forget(r.stated);
    assert_true(stated_error(r.stated) == 0.0);
    for (int k = 0; k < 24; k++) {
        see(&r, 0.04f);
        take(&r, 1.0f, &rng);
        sum += stated_error(r.stated) / 24.0;
    }
    print_message("stated %.4f with noisy samples\n", sum);
    assert_true(sum > 0.5 * expected && sum < 1.1 * expected);
    rig_finish(&r);
}

/* Samples that tell nothing leave the expected ratio, samples that agree with the picture the noise alone. */
static void without_knowledge_the_expected_ratio_counts(void **state)
{
    struct rig r = rig_make();
    struct rng rng = { .state = 6 };
    (void)state;

    see(&r, 0.01f);
    take(&r, 30.0f, &rng);
    const double noise = 0.01 * 0.01 * covered(r.set);
    assert_float_equal(stated_error(r.stated), STATED_RATIO * noise, 0.1 * noise);
    stated_forget(r.stated);
    see(&r, 0.1f);
    for (size_t i = 0; i < r.floats; i++)
        r.half[0][i] = r.half[1][i] = 0.5f;
    const float *const half[2] = { r.half[0], r.half[1] };
    stated_take(r.stated, half, half, r.shown);
    assert_float_equal(stated_error(r.stated), 0.01 * covered(r.set), 1e-3 * noise);
    rig_finish(&r);
}

/* relMSE against a truth in two halves, whose own noise cancels. */
static double error_of(const float *x, float *const half[2])
{
    double mean = 0.0, sum = 0.0;

    for (size_t v = 0; v < VALUES; v++)
        mean += 0.5 * ((double)half[0][v] + (double)half[1][v]) / VALUES;
    for (size_t v = 0; v < VALUES; v++) {
        const double t = 0.5 * ((double)half[0][v] + (double)half[1][v]);
        sum += ((double)x[v] - (double)half[0][v]) * ((double)x[v] - (double)half[1][v]) / (t * t + 1e-2 * mean * mean);
    }
    return sum / VALUES;
}

static void make_truth(struct stage *s, float *const half[2])
{
    struct relight_desc light = { .direct = { .method = METHOD_MIS, .samples = TRUTH },
                                  .classes = PATH_DIRECT | PATH_INDIRECT_LIT | PATH_BACKGROUND,
                                  .eye_paths = TRUTH };
    struct relight_stats stats;

    for (int k = 0; k < 2; k++) {
        light.direct.seed = 900 + (uint64_t)k;
        assert_int_equal(stage_run(s, &light, &stats), ERR_OK);
        memcpy(half[k], s->rgb, VALUES * sizeof(float));
    }
}

/* The second and third picture of the court under clouds, denoised, four times each: their stated errors must be within
 * 0.67 to 1.5 of the true ones in the mean of the four. The first states none. */
static void denoised_pictures_state_their_error(void **state)
{
    struct stage s = stage_make(&(struct set_desc){ .width = WIDTH, .height = HEIGHT }, sky_overcast(64, 32));
    float *half[2] = { mem_alloc(VALUES, sizeof(float)), mem_alloc(VALUES, sizeof(float)) };
    struct relight_desc light = {
        .direct = { .method = METHOD_AUTO, .samples = 8 }, .eye_paths = 2, .denoise = true, .remember = true
    };
    double is[PICTURES] = { 0.0 }, says[PICTURES] = { 0.0 };
    struct relight_stats stats;
    (void)state;

    assert_true(half[0] && half[1]);
    make_truth(&s, half);
    for (int seed = 0; seed < SEEDS; seed++) {
        light.direct.seed = (uint64_t)seed;
        light.classes = PATH_DIRECT; /* another light: the history forgets */
        light.remember = false;
        assert_int_equal(stage_run(&s, &light, &stats), ERR_OK);
        light.remember = true;
        light.classes = PATH_DIRECT | PATH_INDIRECT_LIT | PATH_BACKGROUND;
        for (int k = 0; k < PICTURES; k++) {
            assert_int_equal(stage_run(&s, &light, &stats), ERR_OK);
            is[k] += error_of(s.rgb, half) / SEEDS;
            says[k] += stats.error / SEEDS;
        }
    }
    for (int k = 0; k < PICTURES; k++)
        print_message("picture %d: states %.2e, is %.2e\n", k + 1, says[k], is[k]);
    assert_true(says[0] == 0.0);
    for (int k = 1; k < PICTURES; k++)
        assert_true(says[k] > 0.67 * is[k] && says[k] < 1.5 * is[k]);
    mem_free(half[0]);
    mem_free(half[1]);
    stage_finish(&s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(the_ratio_of_error_to_noise_is_measured),
    cmocka_unit_test(without_knowledge_the_expected_ratio_counts),
    cmocka_unit_test(denoised_pictures_state_their_error),
};
UNIT_MAIN(tests)
