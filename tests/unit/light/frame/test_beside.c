/* Caustics of live images (light/frame/beside.h): they wait for nothing, are the light that other images have,
 * improve from image to image, and follow the sky. RING: docs/examples. */
#include "light/denoise/denoise.h"
#include "light/frame/frame_plan.h"
#include "light/frame/relighter.h"
#include "light/frame/stage.h"
#include "measure/compare/metrics.h"
#include "scene/geometry/files.h"
#include "support/kept.h"

enum { WIDTH = 48, HEIGHT = 27, VALUES = 3 * WIDTH * HEIGHT, IMAGES = 12 };

static struct stage ring(struct frame sky)
{
    return stage_make(&(struct prepared_scene_desc){ .scene = RING, .width = WIDTH, .height = HEIGHT }, sky);
}

static void run(struct stage *s, const struct relight_desc *light, struct relight_stats *stats)
{
    if (stage_run(s, light, stats))
        fail_msg("%s", s->why.text);
}

/* Caustics alone, and all light, as decide.c has it before there is a cache. */
static const struct relight_desc caustics = {
    .direct = { .method = METHOD_AUTO, .samples = 8 },
    .classes = PATH_CAUSTICS,
    .eye_paths = 2,
    .stored_paths = 60000,
    .renew = 64,
    .denoise = true,
    .remember = true,
};

static void under(struct stage *s, struct frame sky)
{
    environment_destroy(s->sky);
    s->sky = sky_environment(sky, 64, 0.0);
}

/* The mean of many images that are not live. */
static void converge(struct stage *s, const struct relight_desc *live, float mean[VALUES])
{
    enum { PASSES = 16 };
    struct relight_desc light = *live;
    struct relight_stats stats;

    memset(mean, 0, VALUES * sizeof(*mean));
    light.denoise = light.remember = false;
    light.caustics = PLAN_LIGHT;
    light.particles = 100000;
    light.eye_paths = 16;
    for (light.direct.pass = 0; light.direct.pass < PASSES; light.direct.pass++) {
        run(s, &light, &stats);
        for (int v = 0; v < VALUES; v++)
            mean[v] += s->rgb[v] / PASSES;
    }
}

static double brightness(const float *rgb)
{
    double sum = 0.0;

    for (int v = 0; v < VALUES; v++)
        sum += (double)rgb[v] / VALUES;
    return sum;
}

static double error_of(const struct stage *s, const float want[VALUES])
{
    struct metrics m;

    assert_true(metrics_compare(s->rgb, want, NULL, WIDTH, HEIGHT, 0.0, NULL, &m));
    return m.rel_mse;
}

static void the_store_grows_while_images_are_made(void **state)
{
    struct stage s = ring(sky_with_sun(64, 32, 2e3f)), cloud = ring(sky_overcast(64, 32));
    struct relight_desc light = caustics;
    struct relight_stats stats;
    uint32_t before = 0;
    (void)state;

    light.stored_paths = 20000000; /* more than an image has time for */
    for (light.turn = 0; light.turn < 3; light.turn++) {
        run(&s, &light, &stats);
        assert_int_equal(stats.plan.caustics, PLAN_STORED);
        assert_true(stats.stored.filled > before && stats.stored.filled < stats.stored.parts);
        assert_true(light.turn > 0 || stats.stored.filled == 2);
        before = stats.stored.filled;
    }
    run(&cloud, &light, &stats); /* eye paths, until images have the cache and the store */
    assert_int_equal(stats.plan.caustics, PLAN_EYE);
    assert_true(stats.stored.filled == 0);
    light.turn++;
    run(&cloud, &light, &stats);
    assert_true(stats.plan.caustics == PLAN_EYE && stats.stored.filled > 0);
    stage_finish(&s);
    stage_finish(&cloud);
}

static void they_are_the_light_of_other_images(void **state)
{
    static const enum plan_estimator by[] = { PLAN_STORED, PLAN_LIGHT };
    float want[VALUES];
    struct relight_stats stats;
    (void)state;

    for (int k = 0; k < 4; k++) {
        struct stage s = ring(k / 2 ? sky_with_sun(64, 32, 2e1f) : sky_overcast(64, 32));
        struct relight_desc light = caustics;
        if (k % 2 == 0) /* for both estimators of this sky */
            converge(&s, &light, want);
        light.caustics = by[k % 2];
        light.particles = 200000; /* each half in six parts */
        for (light.turn = 0; light.turn < IMAGES; light.turn++)
            run(&s, &light, &stats);
        printf("%s, %s: %+.2f %%, relMSE %.1e\n", k / 2 ? "sun" : "cloud", plan_estimator_name(by[k % 2]),
               100.0 * (brightness(s.rgb) / brightness(want) - 1.0), error_of(&s, want));
        assert_float_equal(brightness(s.rgb) / brightness(want), 1.0, 0.06);
        assert_true(error_of(&s, want) < 0.4);
        stage_finish(&s);
    }
}

static struct frame sun_at(uint32_t x)
{
    struct frame f = sky_overcast(64, 32);

    sky_paint(&f, x, 8, 2e3f, 2e3f, 2e3f);
    return f;
}

static struct relight_desc few_particles(uint64_t seed)
{
    struct relight_desc light = caustics;

    light.caustics = PLAN_LIGHT;
    light.particles = 1500;
    light.direct.seed = seed;
    return light;
}

static void converge_under(uint32_t sun, float want[VALUES])
{
    struct stage s = ring(sun_at(sun));
    const struct relight_desc light = few_particles(0);

    converge(&s, &light, want);
    stage_finish(&s);
}

/* Errors: of the first image, of one after IMAGES, of the first under another sky, and of that without a history. */
static void learn_and_forget(uint64_t seed, const float want[VALUES], const float want_other[VALUES], double error[4])
{
    struct stage s = ring(sun_at(20)), other = ring(sun_at(40));
    const struct relight_desc light = few_particles(seed);
    struct relight_stats stats;

    run(&s, &light, &stats);
    error[0] = error_of(&s, want);
    for (int k = 0; k < IMAGES; k++)
        run(&s, &light, &stats);
    error[1] = error_of(&s, want);
    under(&s, sun_at(40));
    run(&s, &light, &stats);
    error[2] = error_of(&s, want_other);
    run(&other, &light, &stats);
    error[3] = error_of(&other, want_other);
    stage_finish(&s);
    stage_finish(&other);
}

/* Few particles leave specks, so that one image's error scatters by half: geometric means over seeds. What was learnt
 * leaves 0.36 of the error; an image after another sky has 1.8 to 3.2 times that of one without a history, and would
 * have 19 times if the sky before were not forgotten. */
static void images_learn_and_forget(void **state)
{
    const uint32_t seeds = seeds_count(4, 16);
    float want[VALUES], want_other[VALUES];
    double learnt = 0.0, kept = 0.0;
    (void)state;

    converge_under(20, want);
    converge_under(40, want_other);
    for (uint32_t seed = 0; seed < seeds; seed++) {
        double error[4];
        learn_and_forget(seed, want, want_other, error);
        learnt += log(error[1] / error[0]) / seeds;
        kept += log(error[2] / error[3]) / seeds;
    }
    printf("learnt: %.2f of the error; another sky: %.2f of that without a history\n", exp(learnt), exp(kept));
    assert_true(exp(learnt) < 0.6);
    assert_true(exp(kept) < 7.0);
}

/* Under cloud, eye paths find caustics until the store has grown. Then it takes over, and they must not count twice:
 * the light that the points' history keeps has none. Caustics are 5 % of this image's light. */
static void another_estimator_takes_over(void **state)
{
    struct stage s = ring(sky_overcast(64, 32));
    struct relight_desc light = caustics;
    struct relight_stats stats;
    float want[VALUES];
    (void)state;

    light.classes = PATH_ALL;
    converge(&s, &light, want);
    for (light.turn = 0; light.turn < IMAGES; light.turn++) {
        light.caustics = light.turn < IMAGES / 2 ? PLAN_EYE : PLAN_STORED;
        run(&s, &light, &stats);
        printf("%s: %+.2f %%, relMSE %.1e\n", plan_estimator_name(stats.plan.caustics),
               100.0 * (brightness(s.rgb) / brightness(want) - 1.0), error_of(&s, want));
        assert_float_equal(brightness(s.rgb) / brightness(want), 1.0, 0.03);
    }
    stage_finish(&s);
}

/* A path that meets a sun behind glass is a speck: in live images it has a limit, and indirect light behind glass
 * joins the history of the points. */
static void paths_behind_glass_have_a_limit(void **state)
{
    struct stage s = ring(sun_at(20));
    struct relight_desc light = caustics;
    struct frame_plan plan;
    struct relight_stats stats;
    (void)state;

    light.classes = PATH_ALL;
    assert_int_equal(relighter_describe(s.relighter, s.sky, &light, &plan, &stats), ERR_OK);
    const struct eye_paths_desc *beside = &frame_plan_find(&plan, PASS_BESIDE)->eye;
    assert_float_equal(beside->most, 3.0 * 4.0 * s.sky->total_energy / PI, 1e-6 * s.sky->total_energy);
    assert_int_equal(beside->behind_classes, PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC);
    assert_int_equal(beside->classes, 0);
    assert_int_equal(frame_plan_find(&plan, PASS_EYE)->eye.behind_classes, PATH_INDIRECT_LIT);
    light.remember = false;
    assert_int_equal(relighter_describe(s.relighter, s.sky, &light, &plan, &stats), ERR_OK);
    assert_false(frame_plan_has(&plan, PASS_BESIDE));
    assert_true(frame_plan_find(&plan, PASS_EYE)->eye.most == 0.0);
    assert_int_equal(frame_plan_find(&plan, PASS_EYE)->eye.behind_classes, PATH_CAUSTICS | PATH_INDIRECT);
    stage_finish(&s);
}

static void turn_sky(struct stage *s, double degrees)
{
    environment_destroy(s->sky);
    s->sky = sky_environment(sun_at(20), 64, degrees);
}

/* Of the last image against many of its sky: its relMSE, and its brightness. */
static double error_under(struct stage *truth, double degrees, const struct stage *s, double *bright)
{
    struct relight_desc light = caustics;
    float want[VALUES];

    light.classes = PATH_DIRECT | PATH_CAUSTICS;
    light.direct.method = METHOD_CACHED;
    turn_sky(truth, degrees);
    converge(truth, &light, want);
    *bright = brightness(s->rgb) / brightness(want);
    return error_of(s, want);
}

/* An image takes one slice of a round, unless its sky is another one: then all. In four rounds of a sun
 * that moves by half a degree, what comes late is six images old: its error is like that of the first image, which
 * has no history. The limit of paths behind glass makes images 2.7 % darker; without one half of the stored paths these
 * are 3.3 %, without one of the samples 4.9 %. */
static void images_under_a_moving_sky_take_turns(void **state)
{
    struct stage s = ring(sun_at(20)), truth = ring(sun_at(20));
    struct relight_desc light = caustics;
    struct relight_stats stats;
    uint64_t particles = 0, images = 0;
    double bright[3], error[3];
    (void)state;

    light.denoise = false;
    light.classes = PATH_DIRECT | PATH_CAUSTICS;
    light.direct.method = METHOD_CACHED;
    run(&s, &light, &stats);
    const uint64_t all = stats.light.particles;
    error[0] = error_under(&truth, 0.0, &s, &bright[0]);
    for (uint32_t k = 1; k <= 20; k++) {
        turn_sky(&s, 0.5 * k);
        run(&s, &light, &stats);
        particles += stats.light.particles;
        images += stats.light.particles > 0;
    }
    assert_int_equal(images, 8);
    assert_float_equal((double)particles / (4.0 * (double)all), 1.0, 0.05);
    error[1] = error_under(&truth, 10.0, &s, &bright[1]);
    turn_sky(&s, 40.0);
    run(&s, &light, &stats);
    assert_true(stats.light.particles * 10 > all * 9);
    error[2] = error_under(&truth, 40.0, &s, &bright[2]);
    for (int k = 0; k < 3; k++)
        printf("%s: relMSE %.1e, %+.2f %%\n",
               k == 0   ? "first"
               : k == 1 ? "moving"
                        : "after a jump",
               error[k], 100.0 * (bright[k] - 1.0));
    assert_float_equal((bright[0] + bright[1] + bright[2]) / 3.0, 1.0, 0.03);
    assert_true(error[1] < 1.5 * error[0] && error[2] < 4.0 * error[0]);
    stage_finish(&s);
    stage_finish(&truth);
}

/* Another image is filtered, as bright as nothing in the scene is. */
static void filter_another(struct stage *s, float *lo)
{
    struct denoiser *d = s->relighter->denoiser;
    const float *const half[2] = { denoiser_half(d, 0), denoiser_half(d, 1) };

    for (int k = 0; k < 2; k++)
        for (size_t i = 0; i < s->set->gbuffer->packet_count * 3 * (size_t)PACKET; i++)
            denoiser_half(d, k)[i] = 1e6f;
    denoiser_filter(d, half, lo);
}

/* In a larger image the filter takes several slices, and others use it between two of them: after each of these images,
 * of which none is brighter than the first one. If a slice went on where the one before ended, some would be 200,000
 * times as bright. */
static void others_may_filter_between_slices(void **state)
{
    struct stage s =
        stage_make(&(struct prepared_scene_desc){ .scene = RING, .width = 384, .height = 216 }, sun_at(20));
    float *lo = mem_alloc(s.set->gbuffer->packet_count, 3 * PACKET * sizeof(*lo));
    struct relight_desc light = caustics;
    struct relight_stats stats;
    double first = 0.0, most = 0.0;
    (void)state;

    assert_true(s.set->gbuffer->packet_count * PACKET > 80000);
    light.denoise = false;
    light.classes = PATH_DIRECT | PATH_CAUSTICS;
    light.direct.method = METHOD_CACHED;
    for (uint32_t k = 0; k < 16; k++) {
        double sum = 0.0;
        turn_sky(&s, 0.5 * k);
        run(&s, &light, &stats);
        for (int v = 0; v < 3 * 384 * 216; v++)
            sum += (double)s.rgb[v];
        first = k == 0 ? sum : first;
        most = fmax(most, sum);
        filter_another(&s, lo);
    }
    printf("at most %.2f times as bright\n", most / first);
    assert_true(first > 0.0 && most < 1.2 * first);
    mem_free(lo);
    stage_finish(&s);
}

/* Once the builder has stored the paths of caustics, images trace none behind glass, and have the same light. Without
 * the stored paths behind glass they have 0.74 of it. */
static void the_builder_stores_what_images_trace_before(void **state)
{
    struct stage s = ring(sky_overcast(64, 32)), other = ring(sky_overcast(64, 32));
    struct relight_desc light = caustics, direct = caustics;
    struct relight_stats stats;
    float want[VALUES];
    uint64_t traced = 0;
    (void)state;

    light.classes = PATH_DIRECT | PATH_CAUSTICS;
    light.denoise = direct.denoise = direct.remember = false;
    light.direct.method = direct.direct.method = METHOD_CACHED;
    direct.classes = PATH_DIRECT;
    converge(&other, &light, want);
    run(&other, &direct, &stats);
    const double without = brightness(other.rgb);
    light.cache_background = true;
    while (!relight_cache_behind(&s.relighter->cache) || !relight_caustics_is_full(&s.relighter->caustics)) {
        run(&s, &light, &stats);
        traced += stats.eye.paths;
        light.turn++;
    }
    assert_true(traced > 0);
    for (int k = 0; k < IMAGES; k++) {
        run(&s, &light, &stats);
        assert_int_equal(stats.eye.paths, 0);
    }
    const double part = (brightness(s.rgb) - without) / (brightness(want) - without);
    printf("%.3f of the caustics' light\n", part);
    assert_float_equal(part, 1.0, 0.1);
    /* the cache may be refused, and its paths freed, while an image is made: that image lacks them */
    struct frame_plan plan;
    assert_int_equal(relighter_describe(s.relighter, s.sky, &light, &plan, &stats), ERR_OK);
    relight_cache_finish(&s.relighter->cache);
    s.relighter->cache.refused = true;
    assert_int_equal(relighter_run_plan(s.relighter, s.sky, &plan, s.rgb, &stats), ERR_OK);
    assert_null(relight_cache_behind(&s.relighter->cache));
    stage_finish(&s);
    stage_finish(&other);
}

/* Whether it is in the log, between log_begin and log_end. */
static bool is_logged(const char *part)
{
    static char text[8192];
    const ssize_t n = pread(STDERR_FILENO, text, sizeof(text) - 1, 0);

    text[n > 0 ? n : 0] = '\0';
    return strstr(text, part) != NULL;
}

/* Images, as if in another run, until all is computed or read, and kept; the log of it. */
static const char *store_all(struct stage *s, struct relight_desc light, struct eye_store_stats *behind)
{
    struct relight_stats stats = { .cache_share = 0.0 };

    relighter_destroy(s->relighter);
    log_begin();
    s->relighter = relighter_create(s->set, best_kernels());
    for (; stats.cache_share < 1.0 || !relight_cache_behind(&s->relighter->cache) ||
           !(is_logged("caustics: kept in") || is_logged("caustics: loaded"));
         light.turn++)
        run(s, &light, &stats);
    *behind = *eye_store_stats(relight_cache_behind(&s->relighter->cache)[1]);
    relighter_destroy(s->relighter);
    s->relighter = relighter_create(s->set, best_kernels());
    return log_end();
}

/* The second of two runs reads the first one's paths; the third has a damaged file, traces them again and says so. */
static void another_run_reads_them(void **state)
{
    struct stage s = ring(sky_overcast(64, 32));
    struct relight_desc light = caustics;
    struct eye_store_stats first, again;
    char folder[] = "/tmp/relight-paths-XXXXXX", name[256];
    (void)state;

    assert_non_null(mkdtemp(folder));
    light.classes = PATH_DIRECT | PATH_CAUSTICS;
    light.denoise = false;
    light.direct.method = METHOD_CACHED;
    light.cache_background = true;
    light.cache_file = "";
    light.cache_dir = folder;
    for (int k = 0; k < 3; k++) {
        if (k == 2) {
            FILE *f = fopen(name, "r+b");
            assert_true(f && fseek(f, 3000, SEEK_SET) == 0 && fwrite("?", 1, 1, f) == 1 && fclose(f) == 0);
        }
        const char *log = store_all(&s, light, k ? &again : &first);
        if (count_of(log, "caustics: loaded from") != (k == 1) || count_of(log, "caustics: kept in") != (k != 1) ||
            count_of(log, "it is computed again") != (k == 2))
            fail_msg("%s", log);
        if (k == 0) { /* the file of paths, not of direct light */
            const char *at = strstr(log, "caustics: kept in ") + strlen("caustics: kept in ");
            snprintf(name, sizeof(name), "%.*s", (int)strcspn(at, "\n"), at);
        }
        assert_true(k == 0 || memcmp(&first, &again, sizeof(first)) == 0);
        char any[256];
        assert_int_equal(kept_files(folder, any), 2);
    }
    kept_remove(folder);
    stage_finish(&s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(another_run_reads_them),
    cmocka_unit_test(the_builder_stores_what_images_trace_before),
    cmocka_unit_test(images_under_a_moving_sky_take_turns),
    cmocka_unit_test(others_may_filter_between_slices),
    cmocka_unit_test(the_store_grows_while_images_are_made),
    cmocka_unit_test(they_are_the_light_of_other_images),
    cmocka_unit_test(images_learn_and_forget),
    cmocka_unit_test(another_estimator_takes_over),
    cmocka_unit_test(paths_behind_glass_have_a_limit),
};
UNIT_MAIN(tests)
