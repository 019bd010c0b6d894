/* The error that the pilot says, held to the truth: relMSE against a converged image of the same G-buffer; and its
 * choice of a technique and of where samples go, held to all techniques with even counts at the same price. Images
 * of 48 x 27 of the built-in court.
 *
 * Points share light samples, so that one image's error scatters by a fifth or so, and what a pilot has learnt is off
 * by an eighth for all of its images: means over images of several pilots, each with numbers of its own, are compared;
 * their standard error is printed. Sixteen pilots say 27 % too much under cloud, 17 % with indirect light, and 14 % too
 * little under a sun (standard error 9 %). The reference has 2048 samples and 256 eye paths a point, about a fifteenth
 * of the errors here (twice as many in `./test --long`: a thirtieth). A limit of 40 % would see an error forgotten or
 * counted twice, and half of the squared difference taken for the whole.
 *
 * Samples are dealt by where it is hard: the light of the images must be the reference's all the same, within 4
 * standard errors (printed) of the mean. */
#include "light/frame/pilots.h"
#include "light/resolve/resolve.h"
#include "measure/compare/metrics.h"

#include <math.h>

enum { WIDTH = 48, HEIGHT = 27, PIXELS = WIDTH * HEIGHT, LEARNING = 24, FEW = 8, ALL = 16, MANY = 64 };

static float rgb[3 * PIXELS], reference[3 * PIXELS];
static uint8_t mask[PIXELS];

static void converge(const struct prepared_scene *set, const struct environment *e, uint32_t classes)
{
    static double sum[3 * PIXELS];
    struct relight_desc light = {
        .direct = { .method = METHOD_AUTO, .samples = 512 }, .classes = classes, .eye_paths = 64, .caustics = PLAN_EYE
    };
    const struct kernels *k;
    const uint32_t seeds = seeds_count(4, 8);
    struct relight_stats stats;
    struct reason why;

    assert_int_equal(kernels_select(NULL, &k, &why), ERR_OK);
    struct relighter *r = relighter_create(set, k);
    memset(sum, 0, sizeof(sum));
    for (uint64_t seed = 0; seed < seeds; seed++) {
        light.direct.seed = 1000 + seed;
        assert_int_equal(relighter_run(r, e, &light, rgb, &stats), ERR_OK);
        for (size_t i = 0; i < 3 * (size_t)PIXELS; i++)
            sum[i] += rgb[i] / (double)seeds;
    }
    for (size_t i = 0; i < 3 * (size_t)PIXELS; i++)
        reference[i] = (float)sum[i];
    relighter_destroy(r);
    resolve_mask(set->gbuffer, mask);
}

static double rel_mse(void)
{
    struct metrics m;

    assert_true(metrics_compare(rgb, reference, mask, WIDTH, HEIGHT, 0.0, NULL, &m));
    return m.rel_mse;
}

static double light_of(const float *image)
{
    double sum = 0.0;

    for (size_t i = 0; i < 3 * (size_t)PIXELS; i++)
        sum += mask[i / 3] ? (double)image[i] : 0.0;
    return sum;
}

static struct budget_target in_time(double seconds)
{
    return (struct budget_target){ .seconds = seconds };
}

struct outcome {
    double said, truth, deviation; /* mean over the images; standard error of the truth, as a share */
    double light, light_deviation; /* over the reference's; its standard error */
    struct pilot_stats last;
};

/* Adds the images of a pilot who has learnt, with other numbers each. */
static void add_images(const struct prepared_scene *set, const struct environment *e, struct relight_desc light,
                       struct budget_target target, uint32_t images, struct outcome *o)
{
    struct pilot *p = pilot_of(set);
    struct relight_stats stats;

    for (light.direct.pass = 0; light.direct.pass < LEARNING + images; light.direct.pass++) {
        fly(p, e, &light, target, 1, rgb, &stats, &o->last);
        const double error = rel_mse(), one = light_of(rgb) / light_of(reference);
        if (light.direct.pass < LEARNING)
            continue;
        o->said += o->last.error;
        o->truth += error;
        o->deviation += error * error;
        o->light += one;
        o->light_deviation += one * one;
    }
    pilot_end(p);
}

/* As many pilots, each with numbers of its own: what one has learnt is off by an eighth for all of its images. */
static struct outcome measure(const struct prepared_scene *set, const struct environment *e, uint32_t classes,
                              struct budget_target target, uint32_t pilots, uint32_t images)
{
    struct relight_desc light = { .classes = classes };
    struct outcome o = { 0 };
    const double n = (double)pilots * images;

    for (; light.direct.seed < pilots; light.direct.seed++)
        add_images(set, e, light, target, images, &o);
    o.said /= n;
    o.truth /= n;
    o.light /= n;
    o.deviation = sqrt(fmax(0.0, o.deviation / n - o.truth * o.truth) / (n - 1.0)) / o.truth;
    o.light_deviation = sqrt(fmax(0.0, o.light_deviation / n - o.light * o.light) / (n - 1.0));
    return o;
}

static void compare(struct environment *e, uint32_t classes, struct budget_target target, const char *sky)
{
    struct prepared_scene *set = set_of(&(struct prepared_scene_desc){ .width = WIDTH, .height = HEIGHT });

    converge(set, e, classes);
    const struct outcome o = measure(set, e, classes, target, seeds_count(4, 16), FEW / 2);
    printf("%s: said %.4g, true %.4g +- %.0f %%, light %.4f +- %.4f\n", sky, o.said, o.truth, 100.0 * o.deviation,
           o.light, o.light_deviation);
    assert_true(fabs(o.said / o.truth - 1.0) < 0.4);
    assert_true(fabs(o.light - 1.0) < 4.0 * o.light_deviation + 0.001);
    environment_destroy(e);
    set_destroy(set);
}

static void the_error_said_is_true_under_cloud(void **state)
{
    (void)state;
    compare(sky_environment(sky_overcast(64, 32), 32, 0.0), PATH_BACKGROUND | PATH_DIRECT, in_time(0.015),
            "overcast, direct");
}

static void the_error_said_is_true_under_a_sun(void **state)
{
    (void)state;
    compare(sky_environment(sky_with_sun(64, 32, 1e4f), 32, 0.0), PATH_BACKGROUND | PATH_DIRECT, in_time(0.015),
            "sun, direct");
}

static void the_error_said_is_true_with_indirect_light(void **state)
{
    (void)state;
    compare(sky_environment(sky_overcast(64, 32), 32, 0.0), PATH_ALL, (struct budget_target){ .error = 0.05 },
            "overcast, all");
}

/* However short the time, all light is there: the mean of the images is the reference's within 3 %. Without indirect
 * light it would be 10 % lower and more. So few pixels lose 2 % to the filter (at 320x180 0.2 %); the standard error of
 * the mean is held to a third of a per cent. */
static void no_light_is_missing_in_haste(void **state)
{
    static const double seconds[] = { 0.0001, 0.0032, 0.02 };
    struct environment *e = sky_environment(sky_with_sun(64, 32, 1e4f), 32, 0.0);
    struct prepared_scene *set = set_of(&(struct prepared_scene_desc){ .width = WIDTH, .height = HEIGHT });
    (void)state;

    converge(set, e, PATH_ALL);
    for (size_t k = 0; k < sizeof(seconds) / sizeof(seconds[0]); k++) {
        const struct outcome o = measure(set, e, PATH_ALL, in_time(seconds[k]), 1, MANY);
        printf("%.1f ms: light %.4f +- %.4f, relMSE %.3g, denoised %d\n", 1e3 * seconds[k], o.light, o.light_deviation,
               o.truth, o.last.denoised);
        assert_true(o.light_deviation < 0.0033);
        assert_true(fabs(o.light - 1.0) < 0.03);
    }
    environment_destroy(e);
    set_destroy(set);
}

/* Each technique for all surfaces, with as many samples as take the time; mean over seeds, in each commit half of them:
 * a standard error below 11 %, where the limit below is 20 %. */
static double by_technique(const struct prepared_scene *set, const struct environment *e, struct direct_desc desc,
                           double seconds)
{
    const struct kernels *k;
    const uint32_t seeds = seeds_count(FEW, ALL);
    struct reason why;
    double sum = 0.0;

    assert_int_equal(kernels_select(NULL, &k, &why), ERR_OK);
    struct relighter *r = relighter_create(set, k);
    desc.samples = 16;
    for (uint64_t seed = 0; seed <= seeds; seed++) {
        const struct relight_desc light = { .direct = desc };
        struct relight_stats stats;
        assert_int_equal(relighter_run(r, e, &light, rgb, &stats), ERR_OK);
        const struct pilot_work work = { PILOT_DIRECT, set->gbuffer->point_count, stats.direct.rays, desc.samples };
        if (seed == 0) /* the first only says what a sample costs */
            desc.samples = (uint32_t)fmax(1.0, floor(desc.samples * seconds / price_list(&work)));
        else
            sum += rel_mse() / seeds;
        desc.seed = seed + 1;
    }
    relighter_destroy(r);
    return sum;
}

static void weigh_choice(struct environment *e, const char *sky)
{
    static const struct {
        const char *name;
        struct direct_desc desc;
    } fixed[] = {
        { "uniform", { .method = METHOD_UNIFORM } },
        { "brdf", { .method = METHOD_BRDF } },
        { "light", { .method = METHOD_LIGHT } },
        { "faces", { .method = METHOD_FACES } },
        { "mis", { .method = METHOD_MIS } },
        { "mis, sun, compensated", { .method = METHOD_AUTO } },
        { "faces, sun", { .method = METHOD_FACES, .sun = true } },
        { "faces, 8 x 8 cells, sun", { .method = METHOD_FACES, .cells = 8, .sun = true } },
    };
    const double seconds = 0.025;
    struct prepared_scene *set = set_of(&(struct prepared_scene_desc){ .width = WIDTH, .height = HEIGHT });
    double least = INFINITY;

    converge(set, e, PATH_BACKGROUND | PATH_DIRECT);
    for (size_t k = 0; k < sizeof(fixed) / sizeof(fixed[0]); k++) {
        const double error = by_technique(set, e, fixed[k].desc, seconds);
        printf("  %-26s %.4g\n", fixed[k].name, error);
        least = fmin(least, error);
    }
    const struct outcome o = measure(set, e, PATH_BACKGROUND | PATH_DIRECT, in_time(seconds), 1, seeds_count(FEW, ALL));
    const double chosen = o.truth;
    printf("%s: the pilot (%s) %.4g, %.2f of the best\n", sky, o.last.part[PILOT_DIRECT].name, chosen, chosen / least);
    assert_true(chosen < 0.9 * least);
    environment_destroy(e);
    set_destroy(set);
}

static void the_choice_is_near_the_best_of_all_under_cloud(void **state)
{
    (void)state;
    weigh_choice(sky_environment(sky_overcast(64, 32), 32, 0.0), "overcast");
}

static void the_choice_is_near_the_best_of_all_under_a_sun(void **state)
{
    (void)state;
    weigh_choice(sky_environment(sky_with_sun(64, 32, 1e5f), 32, 0.0), "sun");
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(the_error_said_is_true_under_cloud),
    cmocka_unit_test(the_error_said_is_true_under_a_sun),
    cmocka_unit_test(the_error_said_is_true_with_indirect_light),
    cmocka_unit_test(no_light_is_missing_in_haste),
    cmocka_unit_test(the_choice_is_near_the_best_of_all_under_cloud),
    cmocka_unit_test(the_choice_is_near_the_best_of_all_under_a_sun),
};
UNIT_MAIN(tests)
