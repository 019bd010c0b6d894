/* The store of light paths: what it keeps, how skies light it, and what a turn replaces.
 *
 * Statistical claims compare means over stores (seeds), each drawn without a look at a sky, with means over runs of
 * the light tracer, which test_light_tracer.c holds to closed forms. They differ where they are more than 4.5 joint
 * standard errors apart over the image, 6.5 in one of its sixteenths (few splats: further from normal). Of each
 * comparison the joint error over the image by 24 seeds (`./test --long`) is asserted, as a share of it: 0.4 %,
 * under the narrow skies 0.7 %; by the 8 of each commit, of half as many paths, it may be 2.45 times that, and five
 * errors apart. A bias of five times what is allowed is caught in 7 of 10 by one comparison if the error is as large as
 * that, and where it is four fifths of it, as measured, in 96 of 100; there are five. Whether every splat is kept with
 * the right light is asserted by itself, far more sharply. The seeds are fixed. */
#include "light/estimators/tracing.h"
#include "light/estimators/worlds.h"

#include "light/estimators/caustic_store.h"
#include "light/estimators/light_tracer.h"
#include "light/estimators/packed.h"
#include "sky/tables/sky_split.h"

#include <omp.h>

enum { SEEDS_FEW = 8, SEEDS_ALL = 24, SIDE = 8, VALUES = 3 * SIDE * SIDE };

/* Each commit draws half of the paths and particles. */
static uint32_t part(void)
{
    return seeds_count(2, 1);
}

#define BOTH (PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC)

static struct caustic_store *store_make(const struct stage *s, const struct caustic_store_desc *desc)
{
    struct caustic_store *out;
    struct reason why;

    assert_int_equal(caustic_store_create(s->scene, s->rays, &s->view, desc, &out, &why), ERR_OK);
    return out;
}

static void turn(struct caustic_store *s, uint64_t number)
{
    assert_int_equal(caustic_store_turn(s, number, NULL, NULL), ERR_OK);
    assert_true(caustic_store_is_complete(s));
}

static void light(struct caustic_store *s, const struct environment *e, float level, float rgb[VALUES])
{
    memset(rgb, 0, VALUES * sizeof(*rgb));
    assert_int_equal(caustic_store_light(s, e, level, rgb), ERR_OK);
}

/* Light tracer: the whole sky, or its sun alone. */
static void traced(const struct stage *s, const struct environment *e, const struct sky_split *sun, uint64_t seed,
                   float rgb[VALUES])
{
    struct light_tracer *t = light_tracer_create(s->scene, s->rays, &s->view);
    const struct light_tracer_desc d = { .classes = BOTH, .particles = 80000 / part(), .seed = seed, .sun = sun };
    struct light_tracer_stats stats;

    assert_non_null(t);
    memset(rgb, 0, VALUES * sizeof(*rgb));
    assert_int_equal(light_tracer_run(t, e, &d, rgb, &stats), ERR_OK);
    light_tracer_destroy(t);
}

static void assert_same_mean(const char *what, const struct blocks *got, const struct blocks *want, double allowed)
{
    double mean[2] = { 0.0 }, error = 0.0;

    for (uint32_t k = 0; k < got->across * got->down; k++) {
        mean[0] += blocks_mean(got, k);
        mean[1] += blocks_mean(want, k);
        error += pow(blocks_error(got, k), 2.0) + pow(blocks_error(want, k), 2.0);
    }
    error = sqrt(error);
    const double worst = blocks_worst(what, got, want, 6.5);
    printf("%s: %+.3f %%, joint error %.3f %%, z %+.2f, blocks up to %.2f\n", what, 100.0 * (mean[0] / mean[1] - 1.0),
           100.0 * error / mean[1], (mean[0] - mean[1]) / error, worst);
    fflush(stdout);
    assert_true(mean[1] > 0.0 && error <= allowed * seeds_blur(SEEDS_FEW, SEEDS_ALL) * sqrt(part()) * mean[1]);
    assert_true(fabs(mean[0] - mean[1]) <= seeds_count(50, 45) / 10.0 * error && worst <= 6.5);
}

/* A sky that is dark but for a broad lobe about an azimuth: caustics of it lie on one side. */
static struct environment *lobe_sky(double rotation_degrees)
{
    struct frame f = sky_constant(32, 16, 0.02f);

    for (uint32_t y = 2; y < 8; y++)
        for (uint32_t x = 6; x < 12; x++)
            sky_paint(&f, x, y, 1.0f, 0.8f, 0.5f);
    return sky_environment(f, 32, rotation_degrees);
}

static const struct blocks sixteenths = { .across = 4, .down = 4 };

/* The very same stores under an overcast sky, a lobe, and the lobe turned by 130 degrees. */
static void one_store_lights_each_sky_as_tracing_does(void **state)
{
    struct stage s = busy_stage();
    struct environment *skies[] = { sky_environment(sky_overcast(64, 32), 64, 0.0), lobe_sky(0.0), lobe_sky(130.0) };
    static const char *const names[] = { "overcast", "lobe", "lobe turned" };
    struct blocks got[3] = { sixteenths, sixteenths, sixteenths }, want[3] = { sixteenths, sixteenths, sixteenths };
    float rgb[VALUES];
    (void)state;

    for (uint64_t seed = 0; seed < seeds_count(SEEDS_FEW, SEEDS_ALL); seed++) {
        const struct caustic_store_desc desc = { .classes = BOTH, .paths = 120000 / part(), .parts = 3, .seed = seed };
        struct caustic_store *store = store_make(&s, &desc);
        turn(store, seed % 5);
        for (int k = 0; k < 3; k++) {
            light(store, skies[k], INFINITY, rgb);
            blocks_add(&got[k], rgb, NULL, SIDE, SIDE);
            traced(&s, skies[k], NULL, seed, rgb);
            blocks_add(&want[k], rgb, NULL, SIDE, SIDE);
        }
        caustic_store_destroy(store);
    }
    for (int k = 0; k < 3; k++)
        assert_same_mean(names[k], &got[k], &want[k], k ? 7e-3 : 4e-3);
    assert_true(blocks_worst("the lobe turned is another picture", &got[1], &got[2], INFINITY) > 20.0);
    for (int k = 0; k < 3; k++)
        environment_destroy(skies[k]);
    stage_free(&s);
}

/* Not far above the level, so that the lower part has much of it as well. */
static struct frame wide_sun(void)
{
    struct frame f = sky_overcast(64, 32);

    for (uint32_t y = 8; y < 11; y++)
        for (uint32_t x = 20; x < 24; x++)
            sky_paint(&f, x, y, 25.0f, 22.0f, 18.0f);
    return f;
}

/* A wide dim sun over an overcast sky, and one of a texel that has nine tenths of the light. */
static void the_store_and_the_bright_part_add_up(void **state)
{
    struct stage s = busy_stage();
    struct sky_split sun = { 0 };
    (void)state;

    for (int k = 0; k < 2; k++) {
        struct environment *e = sky_environment(k ? sky_with_sun(64, 32, 6000.0f) : wide_sun(), 64, 0.0);
        struct blocks got = sixteenths, want = sixteenths;
        assert_int_equal(sky_split_take(&sun, e), ERR_OK);
        assert_true(sun.sun_count > 0 && sun.level > 0.0f);
        printf("the sun has %.3f of the energy, level %.2f\n", sun.sun_energy / e->total_energy,
               (double)sun.level);
        for (uint64_t seed = 0; seed < seeds_count(SEEDS_FEW, SEEDS_ALL); seed++) {
            float lower[VALUES], upper[VALUES], whole[VALUES];
            const struct caustic_store_desc desc = {
                .classes = BOTH, .paths = 120000 / part(), .parts = 2, .seed = seed
            };
            struct caustic_store *store = store_make(&s, &desc);
            turn(store, 0);
            light(store, e, sun.level, lower);
            traced(&s, e, &sun, seed, upper);
            traced(&s, e, NULL, seed + 1000, whole);
            for (int i = 0; i < VALUES; i++)
                lower[i] += upper[i];
            blocks_add(&got, lower, NULL, SIDE, SIDE);
            blocks_add(&want, whole, NULL, SIDE, SIDE);
            caustic_store_destroy(store);
        }
        assert_same_mean(k ? "a strong sun" : "a wide sun", &got, &want, 4e-3);
        environment_destroy(e);
    }
    sky_split_finish(&sun);
    stage_free(&s);
}

/* The sun alone: nothing of it is the store's, and its own particles light a floor by a mirror as the mirror's image of
 * it would (test_light_tracer.c has the scene's closed form). */
static double floor_cosine(const double w[3], const void *user)
{
    (void)user;
    return w[1] > 0.0 ? w[1] : 0.0;
}

static void a_sun_by_itself_is_all_bright(void **state)
{
    struct environment *e = sky_sun_only(45.0, 90.0, 1000.0f);
    struct sky_split sun = { 0 };
    struct tally pixels[PICTURE_MAX];
    struct scene *scene = scene_create();
    float rgb[VALUES];
    (void)state;

    add_wall(scene, add_kind(scene, MATERIAL_LAMBERT, 0.5f, 0.5f, 0.5f, 0.0f), 1, 0.0f, (const float[2]){ -1.0f, 0.0f },
             (const float[2]){ 1.0f, 3.0f });
    add_wall(scene, add_kind(scene, MATERIAL_MIRROR, 0.9f, 0.8f, 0.4f, 0.0f), 0, 0.0f, (const float[2]){ 0.3f, -0.2f },
             (const float[2]){ 0.7f, 0.2f });
    struct stage s = stage_make(scene, vec3_make(2.0f, 2.0f, 0.0f), vec3_make(0.5f, 0.0f, 0.0f), 2.5, SIDE, SIDE);
    assert_int_equal(sky_split_take(&sun, e), ERR_OK);
    assert_true(fabs(sun.sun_energy / e->total_energy - 1.0) < 1e-6);
    struct caustic_store *store = store_make(&s, &(struct caustic_store_desc){ .classes = BOTH, .paths = 20000 });
    turn(store, 0);
    light(store, e, sun.level, rgb);
    for (int i = 0; i < VALUES; i++)
        assert_true(rgb[i] == 0.0f);
    const struct light_tracer_desc d = { .classes = PATH_CAUSTICS, .particles = 1 << 16, .sun = &sun };
    const struct tally whole = stage_trace(&s, e, d, 16, pixels);
    const double want = 0.5 / PI * (0.9 + 0.8 + 0.4) / 3.0 * sky_integral(e, floor_cosine, NULL);
    printf("%.6f +- %.6f, closed form %.6f\n", tally_mean(&whole), tally_error(&whole), want);
    assert_true(fabs(tally_mean(&whole) - want) <= 4.5 * tally_error(&whole) && tally_error(&whole) < 1.5e-3 * want);
    caustic_store_destroy(store);
    sky_split_finish(&sun);
    stage_free(&s);
    environment_destroy(e);
}

/* ---- What is kept ---- */

struct sums { /* of a run's splats under a sky, and the most that rounding may change of them */
    const struct environment *environment;
    double rgb[VALUES], rounding[VALUES], count;
};

static enum err sum_splats(void *user, const struct particle_splat *splats, size_t count)
{
    struct sums *s = user;
    const uint32_t n = s->environment->n, shift = DIRECTION_BITS - 5;

    assert_int_equal(n, 32);
    for (size_t k = 0; k < count; k++) {
        const uint32_t from = splats[k].from, face = from >> 28, row = from >> 14 & 16383, column = from & 16383;
        const struct texel *t = &s->environment->texels[(face * n + (row >> shift)) * n + (column >> shift)];
        const float l[3] = { t->r, t->g, t->b };
        const double most = fmax(splats[k].rgb[0], fmax(splats[k].rgb[1], splats[k].rgb[2]));
        for (uint32_t c = 0; c < 3; c++) {
            s->rgb[3 * splats[k].pixel + c] += (double)splats[k].rgb[c] * (double)l[c];
            s->rounding[3 * splats[k].pixel + c] += most / 127.5 * (double)l[c];
        }
        s->count += 1.0;
    }
    return ERR_OK;
}

/* Each pixel is the sum over its splats, by one texel of the sky each, but for the rounding of a splat to 8 bits; over
 * the image that, being by chance, all but cancels: of some 10^4 splats 0.3 % each leave 3e-5, and 2e-4 is allowed.
 */
static void pixels_are_the_sums_of_their_splats(void **state)
{
    struct stage s = busy_stage();
    struct environment *e = sky_environment(sky_overcast(64, 32), 32, 20.0);
    struct caustic_store *store =
        store_make(&s, &(struct caustic_store_desc){ .classes = BOTH, .paths = 100000, .parts = 1, .seed = 3 });
    const uint64_t paths = caustic_store_stats(store)->paths;
    struct particles particles;
    struct particle_run run = {
        .shown = BOTH, .classes = BOTH, .particles = paths, .seed = rng_mix(3, BOTH), .per_particle = 1.0
    };
    struct sums want = { .environment = e };
    struct light_tracer_stats stats = { 0 };
    float rgb[VALUES];
    double sum[2] = { 0.0 };
    (void)state;

    turn(store, 2);
    light(store, e, INFINITY, rgb);
    assert_true(particles_init(&particles, s.scene, s.rays, &s.view));
    particles_aim(&particles, true, &run);
    run.first_direction = 2 * (paths / STARTS_PER_DIRECTION);
    assert_int_equal(particles_trace(&particles, &run, sum_splats, &want, &stats), ERR_OK);
    assert_true(want.count > 1e4);
    assert_int_equal(caustic_store_stats(store)->splats, stats.splats);
    for (int i = 0; i < VALUES; i++) {
        assert_true(fabs((double)rgb[i] * (double)paths - want.rgb[i]) <= want.rounding[i] + 1e-5 * want.rgb[i]);
        sum[0] += (double)rgb[i] * (double)paths;
        sum[1] += want.rgb[i];
    }
    printf("sum %.6f, %.6f without rounding: %+.2e\n", sum[0], sum[1], sum[0] / sum[1] - 1.0);
    assert_true(fabs(sum[0] / sum[1] - 1.0) < 2e-4);
    particles_finish(&particles);
    caustic_store_destroy(store);
    environment_destroy(e);
    stage_free(&s);
}

static void twice_the_light_is_exactly_twice_the_image(void **state)
{
    struct stage s = busy_stage();
    struct environment *one = sky_environment(sky_with_sun(64, 32, 50.0f), 64, 0.0);
    struct environment *two = environment_create(&(struct environment_desc){ .n = 64, .scale_stops = 1.0 });
    struct frame f = sky_with_sun(64, 32, 50.0f);
    struct caustic_store *store = store_make(&s, &(struct caustic_store_desc){ .classes = BOTH, .paths = 50000 });
    float a[VALUES], b[VALUES];
    struct reason why;
    double sum = 0.0;
    (void)state;

    assert_int_equal(environment_update(two, &f, &why), ERR_OK);
    turn(store, 0);
    for (int k = 0; k < 2; k++) {
        const float level = k ? INFINITY : 4.0f;
        light(store, one, level, a);
        light(store, two, 2.0f * level, b);
        for (int i = 0; i < VALUES; i++) {
            assert_true(b[i] == 2.0f * a[i]);
            sum += (double)a[i];
        }
    }
    assert_true(sum > 0.0);
    frame_finish(&f);
    caustic_store_destroy(store);
    environment_destroy(one);
    environment_destroy(two);
    stage_free(&s);
}

/* ---- Turns ---- */

/* A store of four parts holds at each turn four stores of one part that follow each other. */
static void a_turn_replaces_the_oldest_part_and_no_other(void **state)
{
    enum { PARTS = 4, TURNS = 7 };
    struct stage s = busy_stage();
    struct environment *e = sky_environment(sky_overcast(64, 32), 64, 0.0);
    struct caustic_store *one =
        store_make(&s, &(struct caustic_store_desc){ .classes = BOTH, .paths = 20000, .parts = 1, .seed = 8 });
    struct caustic_store *four =
        store_make(&s, &(struct caustic_store_desc){ .classes = BOTH, .paths = 80000, .parts = PARTS, .seed = 8 });
    float part[TURNS + PARTS][VALUES], got[VALUES], again[VALUES];
    (void)state;

    assert_int_equal(caustic_store_stats(four)->paths, PARTS * caustic_store_stats(one)->paths);
    for (uint64_t k = 0; k < TURNS + PARTS; k++) {
        turn(one, k);
        light(one, e, INFINITY, part[k]);
    }
    for (uint64_t t = 0; t < TURNS; t += 1 + t / 3) { /* 0 1 2 3 5: the last is two at once */
        turn(four, t);
        assert_int_equal(caustic_store_stats(four)->renewed, t == 0 ? PARTS : t == 5 ? 2 : 1);
        light(four, e, INFINITY, got);
        for (int i = 0; i < VALUES; i++) {
            const double want = ((double)part[t][i] + part[t + 1][i] + part[t + 2][i] + part[t + 3][i]) / PARTS;
            assert_true(fabs((double)got[i] - want) <= 1e-5 * want);
        }
    }
    caustic_store_destroy(four);
    four = store_make(&s, &(struct caustic_store_desc){ .classes = BOTH, .paths = 80000, .parts = PARTS, .seed = 8 });
    turn(four, 5); /* at once, without those before */
    light(four, e, INFINITY, again);
    assert_memory_equal(again, got, sizeof(got));
    turn(four, 5);
    assert_int_equal(caustic_store_stats(four)->renewed, 0);
    assert_int_equal(caustic_store_stats(four)->rays, 0);
    caustic_store_destroy(four);
    caustic_store_destroy(one);
    environment_destroy(e);
    stage_free(&s);
}

/* The mean over turns that share nothing of one seed: of 16 its squared error is a 16th of one's if paths are
 * independent, less as they belong to one sequence; below a quarter is asserted, over some 60 pixels, each of which has
 * some 100 splats. */
static void the_mean_over_turns_converges(void **state)
{
    struct stage s = busy_stage();
    struct environment *e = sky_environment(sky_overcast(64, 32), 64, 0.0);
    struct caustic_store *few =
        store_make(&s, &(struct caustic_store_desc){ .classes = PATH_CAUSTICS, .paths = 10000, .parts = 4, .seed = 8 });
    struct caustic_store *many = store_make(
        &s, &(struct caustic_store_desc){ .classes = PATH_CAUSTICS, .paths = 2000000, .parts = 1, .seed = 9 });
    float rgb[VALUES], want[VALUES];
    double mean[VALUES] = { 0.0 }, one = 0.0, all = 0.0;
    (void)state;

    turn(many, 0);
    light(many, e, INFINITY, want);
    for (uint64_t t = 0; t < 64; t++) {
        turn(few, t);
        light(few, e, INFINITY, rgb);
        for (int i = 0; i < VALUES; i++) {
            mean[i] += (double)rgb[i] / 64.0;
            one += pow((double)rgb[i] - (double)want[i], 2.0) / 64.0;
        }
    }
    for (int i = 0; i < VALUES; i++)
        all += pow(mean[i] - (double)want[i], 2.0);
    printf("squared error of one turn %.3e, of the mean over 64 %.3e\n", one, all);
    assert_true(all < 0.25 * one);
    caustic_store_destroy(few);
    caustic_store_destroy(many);
    environment_destroy(e);
    stage_free(&s);
}

static void one_thread_and_two_give_the_same_bits(void **state)
{
    struct stage s = busy_stage();
    struct environment *e = sky_environment(sky_with_sun(64, 32, 50.0f), 64, 0.0);
    float rgb[2][VALUES];
    struct caustic_store_stats stats[2];
    (void)state;

    for (int k = 0; k < 2; k++) {
        omp_set_num_threads(k + 1);
        struct caustic_store *store =
            store_make(&s, &(struct caustic_store_desc){ .classes = BOTH, .paths = 300000, .parts = 2, .seed = 1 });
        turn(store, 3);
        turn(store, 4);
        light(store, e, 3.0f, rgb[k]);
        stats[k] = *caustic_store_stats(store);
        caustic_store_destroy(store);
    }
    assert_memory_equal(rgb[0], rgb[1], sizeof(rgb[0]));
    assert_memory_equal(&stats[0], &stats[1], sizeof(stats[0]));
    assert_true(stats[0].splats > 0 && stats[0].bytes > 10 * stats[0].splats && stats[0].renewed == 1);
    environment_destroy(e);
    stage_free(&s);
}

/* ---- Limits ---- */

static void memory_is_kept_to(void **state)
{
    struct stage s = busy_stage();
    struct caustic_store_desc d = { .classes = BOTH, .paths = 400000, .parts = 8, .max_bytes = 100000 };
    struct caustic_store *store = store_make(&s, &d);
    struct reason why;
    (void)state;

    const struct caustic_store_stats *stats = caustic_store_stats(store);
    for (uint64_t t = 0; t < 40; t++) {
        turn(store, t);
        assert_true(stats->bytes <= d.max_bytes);
    }
    printf("%llu of %llu paths, %llu bytes\n", (unsigned long long)stats->paths, (unsigned long long)stats->requested,
           (unsigned long long)stats->bytes);
    assert_true(stats->paths < stats->requested && stats->bytes > d.max_bytes / 2);
    caustic_store_destroy(store);
    d.max_bytes = 400;
    assert_int_equal(caustic_store_create(s.scene, s.rays, &s.view, &d, &store, &why), ERR_RANGE);
    assert_null(store);
    assert_non_null(strstr(why.text, "MB"));
    stage_free(&s);
}

static void a_turn_that_is_cancelled_is_made_up_for(void **state)
{
    struct stage s = busy_stage();
    struct environment *e = sky_environment(sky_overcast(64, 32), 64, 0.0);
    const struct caustic_store_desc d = { .classes = BOTH, .paths = 100000, .parts = 4 };
    struct caustic_store *store = store_make(&s, &d), *other = store_make(&s, &d);
    float rgb[VALUES], want[VALUES];
    atomic_bool cancel = true;
    (void)state;

    turn(store, 0);
    assert_int_equal(caustic_store_turn(store, 1, NULL, &cancel), ERR_OK);
    assert_false(caustic_store_is_complete(store));
    turn(store, 1);
    light(store, e, INFINITY, rgb);
    turn(other, 1);
    light(other, e, INFINITY, want);
    assert_memory_equal(rgb, want, sizeof(rgb));
    caustic_store_destroy(other);
    caustic_store_destroy(store);
    environment_destroy(e);
    stage_free(&s);
}

static double mean_of(const float rgb[VALUES])
{
    double sum = 0.0;

    for (int i = 0; i < VALUES; i++)
        sum += (double)rgb[i] / VALUES;
    return sum;
}

/* Two parts give as much light as sixteen, but for noise, and both halves of all of them the image of the whole. */
static void it_lights_while_it_grows(void **state)
{
    struct stage s = busy_stage();
    struct environment *e = sky_environment(sky_overcast(64, 32), 64, 0.0);
    const struct caustic_store_desc d = { .classes = BOTH, .paths = 1600000, .parts = 16 };
    struct caustic_store *store = store_make(&s, &d), *other = store_make(&s, &d);
    float half[2][VALUES] = { 0 }, want[VALUES];
    (void)state;

    turn(other, 3);
    light(other, e, INFINITY, want);
    assert_int_equal(caustic_store_light_half(store, e, INFINITY, 0, half[0]), ERR_OK);
    assert_true(mean_of(half[0]) == 0.0);
    assert_int_equal(caustic_store_grow(store, 3, 2, NULL), ERR_OK);
    assert_true(caustic_store_stats(store)->filled == 2 && !caustic_store_is_complete(store));
    for (uint32_t k = 0; k < 2; k++) {
        assert_int_equal(caustic_store_light_half(store, e, INFINITY, k, half[k]), ERR_OK);
        assert_float_equal(mean_of(half[k]) / mean_of(want), 1.0, 0.05);
    }
    for (int k = 0; k < 7; k++)
        assert_int_equal(caustic_store_grow(store, 3, 2, NULL), ERR_OK);
    assert_true(caustic_store_stats(store)->filled == 16 && caustic_store_is_complete(store));
    memset(half, 0, sizeof(half));
    for (uint32_t k = 0; k < 2; k++)
        assert_int_equal(caustic_store_light_half(store, e, INFINITY, k, half[k]), ERR_OK);
    for (int i = 0; i < VALUES; i++)
        assert_float_equal(0.5 * (half[0][i] + half[1][i]), want[i], 1e-5 * want[i]);
    assert_int_equal(caustic_store_grow(store, 4, 2, NULL), ERR_OK); /* the part that turn 4 lacks */
    assert_int_equal(caustic_store_stats(store)->renewed, 1);
    turn(other, 4);
    light(other, e, INFINITY, want);
    light(store, e, INFINITY, half[0]);
    assert_memory_equal(half[0], want, sizeof(want));
    caustic_store_destroy(other);
    caustic_store_destroy(store);
    environment_destroy(e);
    stage_free(&s);
}

static void a_scene_without_casters_stores_nothing(void **state)
{
    struct environment *e = sky_environment(sky_overcast(64, 32), 64, 0.0);
    struct scene *scene = scene_create();
    float rgb[VALUES];
    (void)state;

    add_wall(scene, add_kind(scene, MATERIAL_LAMBERT, 0.5f, 0.5f, 0.5f, 0.0f), 1, 0.0f,
             (const float[2]){ -1.0f, -1.0f }, (const float[2]){ 1.0f, 1.0f });
    struct stage s = stage_make(scene, vec3_make(0.0f, 1.0f, 2.0f), vec3_make(0, 0, 0), 30.0, SIDE, SIDE);
    struct caustic_store *store = store_make(&s, &(struct caustic_store_desc){ .classes = BOTH, .paths = 1000 });
    turn(store, 0);
    light(store, e, INFINITY, rgb);
    for (int i = 0; i < VALUES; i++)
        assert_true(rgb[i] == 0.0f);
    assert_int_equal(caustic_store_stats(store)->paths, 0);
    caustic_store_destroy(store);
    environment_destroy(e);
    stage_free(&s);
}

/* By hand: 0.75 is 192 units of 2^-8, 0.5 are 128 and 0.1 is 25.6, the one byte that u rounds up or down. */
static void numbers_share_a_power_of_two(void **state)
{
    static const float rgb[3] = { 0.75f, 0.5f, 0.1f };
    (void)state;

    assert_int_equal(power_pack(rgb, 0.3), 192 | 128 << 8 | 25 << 16 | (127 - 8) << 24);
    assert_int_equal(power_pack(rgb, 0.5), 192 | 128 << 8 | 26 << 16 | (127 - 8) << 24);
    assert_true(power_unit(power_pack(rgb, 0.5)) == 0x1p-8f);
    assert_int_equal(power_pack((const float[3]){ 0, 0, 0 }, 0.9), 0);
    assert_int_equal(power_pack((const float[3]){ 0x1p-120f, 0, 0 }, 0.9), 0);            /* below 2^-126 units */
    assert_int_equal(power_pack((const float[3]){ 0x1p-119f, 0, 0 }, 0.0), 128 | 1 << 24); /* the least power */
    assert_int_equal(power_pack((const float[3]){ 1e30f, 0, 1 }, 0.0), 255u | 200u << 24);
}

/* Its mean over u is the number: also where the largest is 255.5 of 256 parts, which a byte of its own power cannot
 * hold, and takes 127.75 units of the next. */
static void the_mean_of_what_is_packed_is_exact(void **state)
{
    static const float most[4] = { 0x1.0p0f, 0x1.fdp0f, 0x1.fep0f, 0x1.ffp0f }; /* 128, 254.5, 255, 255.5 parts */
    enum { STEPS = 64 };
    (void)state;

    for (int k = 0; k < 4; k++) {
        const float rgb[3] = { 0.3f * most[k], most[k], most[k] };
        double sum[3] = { 0.0 };
        for (int i = 0; i < STEPS; i++) {
            const uint32_t packed = power_pack(rgb, (i + 0.5) / STEPS);
            for (int c = 0; c < 3; c++)
                sum[c] += (double)(packed >> 8 * c & 255u) * (double)power_unit(packed) / STEPS;
            assert_int_equal(packed >> 24, 127 - 7 + (k == 3));
        }
        assert_true(fabs(sum[0] - (double)rgb[0]) < 0x1p-7 / STEPS);
        assert_true(sum[1] == (double)most[k] && sum[2] == sum[1]);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(one_store_lights_each_sky_as_tracing_does),
    cmocka_unit_test(the_store_and_the_bright_part_add_up),
    cmocka_unit_test(a_sun_by_itself_is_all_bright),
    cmocka_unit_test(pixels_are_the_sums_of_their_splats),
    cmocka_unit_test(twice_the_light_is_exactly_twice_the_image),
    cmocka_unit_test(a_turn_replaces_the_oldest_part_and_no_other),
    cmocka_unit_test(the_mean_over_turns_converges),
    cmocka_unit_test(one_thread_and_two_give_the_same_bits),
    cmocka_unit_test(memory_is_kept_to),
    cmocka_unit_test(a_turn_that_is_cancelled_is_made_up_for),
    cmocka_unit_test(it_lights_while_it_grows),
    cmocka_unit_test(a_scene_without_casters_stores_nothing),
    cmocka_unit_test(numbers_share_a_power_of_two),
    cmocka_unit_test(the_mean_of_what_is_packed_is_exact),
};
UNIT_MAIN(tests)
