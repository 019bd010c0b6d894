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
    float *half[2], *shown, *rgb;
};

static struct rig rig_make(void)
{
    struct rig r = { .set = set_of(&(struct set_desc){ .width = WIDTH, .height = HEIGHT }) };

    r.floats = (size_t)r.set->gbuffer->packet_count * 3 * PACKET;
    r.stated = stated_create(r.set->gbuffer);
    r.half[0] = mem_alloc(r.floats, sizeof(float));
    r.half[1] = mem_alloc(r.floats, sizeof(float));
    r.shown = mem_alloc(r.floats, sizeof(float));
    r.rgb = mem_alloc(VALUES, sizeof(float));
    assert_true(r.stated && r.half[0] && r.half[1] && r.shown && r.rgb);
    for (size_t v = 0; v < VALUES; v++)
        r.rgb[v] = 1.0f;
    return r;
}

static void rig_finish(struct rig *r)
{
    mem_free(r->half[0]);
    mem_free(r->half[1]);
    mem_free(r->shown);
    mem_free(r->rgb);
    stated_destroy(r->stated);
    set_destroy(r->set);
}

/* A picture whose light is 1. */
static void see(struct rig *r)
{
    for (size_t i = 0; i < r->floats; i++)
        r->shown[i] = 1.0f;
    stated_see(r->stated, r->rgb, &(struct stated_light){ r->shown, { r->shown, r->shown } });
}

/* The samples' mean is 1.2, each half has noise of its own, even over +-spread, and both are brighter by `tint` in
 * packets of even sets and darker in others. Half of the light is `more`. */
static void take(struct rig *r, float spread, float tint, struct rng *rng)
{
    for (size_t i = 0; i < r->floats; i++)
        for (int k = 0; k < 2; k++)
            r->half[k][i] = 0.6f + spread * ((float)rng_next(rng) - 0.5f) +
                            (packet_set((uint32_t)(i / (3 * PACKET))) % 2 ? -0.5f : 0.5f) * tint;
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

/* By hand: the error of what is shown is 0.2^2 where a surface is; the next picture has three times the samples. */
static void the_error_is_measured(void **state)
{
    struct rig r = rig_make();
    struct rng rng = { .state = 5 };
    const double was = 0.04 * covered(r.set), is = was / pow(3.0, STATED_FALL);
    (void)state;

    take(&r, 0.1f, 0.0f, &rng);
    assert_true(stated_error(r.stated) == 0.0); /* without a picture it is relative to nothing */
    see(&r);
    assert_true(stated_error(r.stated) == 0.0); /* nothing was measured */
    take(&r, 0.1f, 0.0f, &rng);
    see(&r);
    print_message("stated %.4f, true %.4f\n", stated_error(r.stated), is);
    assert_float_equal(stated_error(r.stated), is, 0.05 * is);
    stated_forget(r.stated);
    assert_true(stated_error(r.stated) == 0.0);
    rig_finish(&r);
}

/* The product of the tints, 0.3^2, is more than twice the error. */
static void tints_of_shared_samples_are_no_error(void **state)
{
    struct rig r = rig_make();
    struct rng rng = { .state = 6 };
    const double is = 0.04 * covered(r.set) / pow(3.0, STATED_FALL);
    (void)state;

    see(&r);
    take(&r, 0.1f, 0.3f, &rng);
    see(&r);
    print_message("stated %.4f, true %.4f\n", stated_error(r.stated), is);
    assert_float_equal(stated_error(r.stated), is, 0.1 * is);
    rig_finish(&r);
}

/* Samples that tell nothing. */
static void in_doubt_nothing_is_stated(void **state)
{
    struct rig r = rig_make();
    struct rng rng = { .state = 7 };
    (void)state;

    see(&r);
    take(&r, 30.0f, 0.0f, &rng);
    see(&r);
    assert_true(stated_error(r.stated) == 0.0);
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

/* The second and third picture of the court under clouds, denoised, four times each: of those that state an error, half
 * of them or more, it must be within 0.67 to 1.5 of the true one in the mean. The first states none. */
static void denoised_pictures_state_their_error(void **state)
{
    struct stage s = stage_make(&(struct set_desc){ .width = WIDTH, .height = HEIGHT }, sky_overcast(64, 32));
    float *half[2] = { mem_alloc(VALUES, sizeof(float)), mem_alloc(VALUES, sizeof(float)) };
    struct relight_desc light = {
        .direct = { .method = METHOD_AUTO, .samples = 8 }, .eye_paths = 2, .denoise = true, .remember = true
    };
    double is[PICTURES] = { 0.0 }, says[PICTURES] = { 0.0 };
    int stated = 0;
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
            is[k] += stats.error > 0.0 ? error_of(s.rgb, half) : 0.0;
            says[k] += stats.error;
            stated += stats.error > 0.0;
        }
    }
    for (int k = 0; k < PICTURES; k++)
        print_message("picture %d: %d in all state %.2e, are %.2e\n", k + 1, stated, says[k], is[k]);
    assert_true(says[0] == 0.0 && 2 * stated >= SEEDS * (PICTURES - 1));
    for (int k = 1; k < PICTURES; k++)
        assert_true(says[k] >= 0.67 * is[k] && says[k] <= 1.5 * is[k]);
    mem_free(half[0]);
    mem_free(half[1]);
    stage_finish(&s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(the_error_is_measured),
    cmocka_unit_test(tints_of_shared_samples_are_no_error),
    cmocka_unit_test(in_doubt_nothing_is_stated),
    cmocka_unit_test(denoised_pictures_state_their_error),
};
UNIT_MAIN(tests)
