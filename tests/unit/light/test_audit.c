/* audit/audit.h against pictures whose error is known: t is a formula, and e has noise of a known variance. */
#include "base/rng.h"
#include "audit/audit.h"
#include "light/stage.h"

#include <math.h>

#define WIDTH 32
#define HEIGHT 24
#define PIXELS (WIDTH * HEIGHT)

struct world {
    float picture[PIXELS][3], half[2][PIXELS][3];
    double noise; /* relative standard deviation of a path */
    double error; /* relMSE of the picture, exactly */
};

static double truth(uint32_t pixel, int c)
{
    return (pixel % 7 == 3 ? 0.2 : 1.0) * (1.0 + 0.25 * c) * (pixel / WIDTH < 4 ? 0.5 : 2.0);
}

/* The mean of so many numbers that are t times 1 + noise or 1 - noise, each with a probability of one half. */
static void trace(void *self, const struct audit_question *q, struct audit_light *out)
{
    const struct world *w = self;
    struct rng r = { q->seed };

    *out = (struct audit_light){ .rays = q->paths };
    for (uint32_t i = 0; i < q->paths; i++) {
        const double x = rng_next(&r) < 0.5 ? 1.0 - w->noise : 1.0 + w->noise;
        for (int c = 0; c < 3; c++)
            out->rgb[c] += truth(q->pixel, c) * x / q->paths;
    }
    for (int c = 0; c < 3; c++)
        out->variance[c] = pow(w->noise * truth(q->pixel, c), 2.0) / q->paths;
}

static double error_against_truth(const struct world *w)
{
    double mean = 0.0, sum = 0.0;

    for (uint32_t i = 0; i < PIXELS; i++)
        for (int c = 0; c < 3; c++)
            mean += (double)w->picture[i][c] / (3.0 * PIXELS);
    for (uint32_t i = 0; i < PIXELS; i++)
        for (int c = 0; c < 3; c++)
            sum += pow((double)w->picture[i][c] - truth(i, c), 2.0) / (pow(truth(i, c), 2.0) + 1e-2 * mean * mean);
    return sum / (3.0 * PIXELS);
}

/* A picture whose pixels are off by `bias` of the truth, and by `more` of it in pixel `one`. */
static struct world *make(double noise, double bias, double more, uint32_t one)
{
    struct world *w = mem_alloc(1, sizeof(*w));

    assert_non_null(w);
    w->noise = noise;
    for (uint32_t i = 0; i < PIXELS; i++)
        for (int c = 0; c < 3; c++) {
            const double off = (i % 2 ? bias : -bias) + (i == one ? more : 0.0);
            w->picture[i][c] = (float)(truth(i, c) * (1.0 + off));
            w->half[0][i][c] = w->half[1][i][c] = i == one ? (float)truth(i, c) : w->picture[i][c];
        }
    w->error = error_against_truth(w);
    return w;
}

static struct audit_result run(struct audit *a, struct world *w, uint64_t seed, uint64_t rays, bool halves)
{
    const struct audit_desc desc = {
        .trace = trace,
        .self = w,
        .half = { halves ? w->half[0][0] : NULL, halves ? w->half[1][0] : NULL },
        .key = 1,
        .seed = seed,
        .rays = rays,
    };
    struct audit_result out;

    audit_picture(a, &desc, w->picture[0], &out);
    return out;
}

/* The mean of estimates over `seeds` seeds, with its standard error. */
static double mean_of(struct world *w, int seeds, uint64_t rays, double *deviation, int *within)
{
    double sum = 0.0, square = 0.0;

    *within = 0;
    for (int k = 0; k < seeds; k++) {
        struct audit *a = audit_create(WIDTH, HEIGHT);
        assert_non_null(a);
        const struct audit_result r = run(a, w, 100 + (uint64_t)k, rays, false);
        sum += r.error;
        square += r.error * r.error;
        *within += fabs(r.error - w->error) <= 2.0 * r.deviation;
        audit_destroy(a);
    }
    *deviation = sqrt(fmax(square / seeds - sum * sum / seeds / seeds, 0.0) / (seeds - 1));
    return sum / seeds;
}

/* Noise of one estimate is twice the error and more, so that none alone says anything: the mean of the products is the
 * error. */
static void the_mean_over_seeds_is_the_error(void **state)
{
    struct world *w = make(1.5, 0.1, 0.0, 0);
    double deviation;
    int within;

    (void)state;
    const double mean = mean_of(w, 100, 120000, &deviation, &within);
    print_message("error %.4e, mean %.4e +- %.1e, %d of 100 within two standard errors\n", w->error, mean, deviation,
                  within);
    assert_true(deviation < 0.04 * w->error);
    assert_true(fabs(mean - w->error) < 3.0 * deviation + 0.03 * w->error);
    assert_in_range(within, 85, 100);
    mem_free(w);
}

/* Without noise: a picture with the bias states it, one without states nothing above 0. */
static void a_planted_bias_is_found(void **state)
{
    struct world *biased = make(0.5, 0.2, 0.0, 0), *right = make(0.5, 0.0, 0.0, 0);
    struct audit *a = audit_create(WIDTH, HEIGHT), *b = audit_create(WIDTH, HEIGHT);

    (void)state;
    assert_true(a && b);
    const struct audit_result found = run(a, biased, 1, 1000000, false), none = run(b, right, 1, 200000, false);
    print_message("bias %.3e: states %.3e; none: at most %.1e\n", biased->error, found.states, none.at_most);
    assert_true(found.states > 0.67 * biased->error && found.states < 1.5 * biased->error);
    assert_true(found.at_most == 0.0);
    assert_true(none.states == 0.0 && none.at_most > 0.0 && none.at_most < 0.05 * biased->error);
    audit_destroy(a);
    audit_destroy(b);
    mem_free(biased);
    mem_free(right);
}

/* A single pixel that a filter made six times too bright has nine tenths of the error. The halves know it, and even
 * without them no pixel is impossible: the mean is right, and no single audit states a tenth. */
static void one_wrong_pixel_counts(void **state)
{
    struct world *w = make(0.3, 0.02, 5.0, 7 * WIDTH + 12);
    double sum = 0.0;

    (void)state;
    for (uint64_t k = 0; k < 40; k++) {
        struct audit *a = audit_create(WIDTH, HEIGHT);
        assert_non_null(a);
        const struct audit_result r = run(a, w, k, 2000000, true);
        assert_true(r.states == 0.0 || r.states > 0.5 * w->error);
        sum += r.error / 40.0;
        audit_destroy(a);
    }
    print_message("error %.3e, mean %.3e\n", w->error, sum);
    assert_true(fabs(sum / w->error - 1.0) < 0.1);
    mem_free(w);
}

/* The lower half is flat where the truth is not: neither scatter nor halves point at it. */
static void errors_where_nothing_shows_are_found(void **state)
{
    struct world *w = make(0.3, 0.0, 0.0, 0);
    double sum = 0.0;

    (void)state;
    for (uint32_t i = PIXELS / 2; i < PIXELS; i++)
        for (int c = 0; c < 3; c++)
            w->picture[i][c] = 1.5f;
    w->error = error_against_truth(w);
    for (uint64_t k = 0; k < 20; k++) {
        struct audit *a = audit_create(WIDTH, HEIGHT);
        assert_non_null(a);
        sum += run(a, w, k, 1000000, false).error / 20.0;
        audit_destroy(a);
    }
    print_message("error %.3e, mean %.3e\n", w->error, sum);
    assert_true(fabs(sum / w->error - 1.0) < 0.1);
    mem_free(w);
}

/* What was traced for one picture judges the next one of the same truth, without a ray; of another truth it does not.
 */
static void answers_are_kept_under_one_key(void **state)
{
    struct world *w = make(0.5, 0.2, 0.0, 0), *better = make(0.5, 0.1, 0.0, 0);
    struct audit *a = audit_create(WIDTH, HEIGHT);

    (void)state;
    assert_non_null(a);
    run(a, w, 1, 1000000, false);
    const struct audit_result next = run(a, better, 1, 0, false);
    assert_int_equal(next.rays, 0);
    assert_true(fabs(next.error / better->error - 1.0) < 0.4);
    audit_forget(a);
    const struct audit_result none = run(a, better, 1, 0, false);
    assert_int_equal(none.pixels, 0);
    assert_true(none.error == 0.0 && none.states == 0.0 && none.at_most == 0.0);
    audit_destroy(a);
    mem_free(w);
    mem_free(better);
}

/* The same seed gives the same bits, and another one others. */
static void the_seed_decides_the_bits(void **state)
{
    struct world *w = make(1.0, 0.1, 0.0, 0);
    double error[3];

    (void)state;
    for (int k = 0; k < 3; k++) {
        struct audit *a = audit_create(WIDTH, HEIGHT);
        assert_non_null(a);
        error[k] = run(a, w, k == 2, 100000, false).error;
        audit_destroy(a);
    }
    assert_true(error[0] == error[1] && error[0] != error[2]);
    mem_free(w);
}

enum { WIDE = 48, HIGH = 27, VALUES = 3 * WIDE * HIGH, TRUTH = 96, SEEDS = 3 };

/* The relMSE of a picture against a truth that was computed twice. */
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

static void make_truth(struct stage *s, uint32_t classes, float *const half[2])
{
    struct relight_desc light = { .direct = { .method = METHOD_MIS, .samples = TRUTH },
                                  .classes = classes,
                                  .eye_paths = TRUTH };
    struct relight_stats stats;

    for (int k = 0; k < 2; k++) {
        light.direct.seed = 900 + (uint64_t)k;
        assert_int_equal(stage_run(s, &light, &stats), ERR_OK);
        assert_true(stats.error == 0.0 && stats.error_at_most == 0.0); /* nothing was paid for it */
        memcpy(half[k], s->rgb, VALUES * sizeof(float));
    }
}

/* The court under clouds, with few samples and denoised: relighter_run's statistics state what the pictures' difference
 * from the truth by other estimators is. */
static void pictures_state_their_error(void **state)
{
    static const uint32_t classes = PATH_DIRECT | PATH_INDIRECT_LIT | PATH_BACKGROUND;
    struct stage s = stage_make(&(struct set_desc){ .width = WIDE, .height = HIGH }, sky_overcast(64, 32));
    float *half[2] = { mem_alloc(VALUES, sizeof(float)), mem_alloc(VALUES, sizeof(float)) };
    (void)state;

    assert_true(half[0] && half[1]);
    make_truth(&s, classes, half);
    for (int denoise = 0; denoise < 2; denoise++) {
        double is = 0.0, says = 0.0;
        for (uint64_t seed = 0; seed < SEEDS; seed++) {
            struct relight_desc light = { .direct = { .method = METHOD_MIS, .samples = 8, .seed = seed },
                                          .classes = classes,
                                          .eye_paths = 2,
                                          .denoise = denoise,
                                          .audit = 40.0 };
            struct relight_stats stats;
            assert_int_equal(stage_run(&s, &light, &stats), ERR_OK);
            assert_true(stats.error > 0.0 && stats.error_at_most == 0.0);
            is += error_of(s.rgb, half);
            says += stats.error;
        }
        print_message("%s: %d pictures in all state %.2e, are %.2e\n", denoise ? "denoised" : "noisy", SEEDS, says, is);
        assert_true(says >= 0.75 * is && says <= 1.33 * is);
    }
    mem_free(half[0]);
    mem_free(half[1]);
    stage_finish(&s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(the_mean_over_seeds_is_the_error), cmocka_unit_test(a_planted_bias_is_found),
    cmocka_unit_test(one_wrong_pixel_counts),           cmocka_unit_test(errors_where_nothing_shows_are_found),
    cmocka_unit_test(answers_are_kept_under_one_key),   cmocka_unit_test(the_seed_decides_the_bits),
    cmocka_unit_test(pictures_state_their_error),
};
UNIT_MAIN(tests)
