/* Some packets instead of all, counts of their own, and tables that are kept: the same bits as by the ordinary way. */
#include "light/estimators/eye_paths.h"
#include "light/estimators/points.h"
#include "light/frame/relight.h"
#include "base/rng.h"
#include "light/frame/frame_plan.h"
#include "support/sets.h"

#include <math.h>

enum { WIDTH = 48, HEIGHT = 27 };

struct court {
    struct prepared_scene *set;
    struct environment *sky;
    struct direct *direct;
    size_t values;
    float *all, *some;
    uint32_t *index;
    struct packet_list list;
};

/* Every third packet of the built-in court. */
static struct court court_make(void)
{
    const struct prepared_scene_desc desc = { .width = WIDTH, .height = HEIGHT };
    struct court c = { .sky = sky_environment(sky_with_sun(64, 32, 1e4f), 32, 0.0),
                       .direct = direct_create(best_kernels()) };

    c.set = set_of(&desc);
    const uint32_t packets = c.set->gbuffer->packet_count;
    c.values = (size_t)packets * 3 * PACKET;
    c.all = mem_alloc(c.values, sizeof(float));
    c.some = mem_alloc(c.values, sizeof(float));
    c.index = mem_alloc(packets, sizeof(*c.index));
    for (uint32_t i = 1; i < packets; i += 3)
        c.index[c.list.count++] = i;
    c.list.index = c.index;
    return c;
}

static void court_finish(struct court *c)
{
    mem_free(c->all);
    mem_free(c->some);
    mem_free(c->index);
    direct_destroy(c->direct);
    environment_destroy(c->sky);
    set_destroy(c->set);
}

/* Listed packets as in the whole, the others untouched. */
static void assert_only_listed(const struct court *c)
{
    for (size_t i = 0; i < c->values; i++) {
        const float want = i / (3 * PACKET) % 3 == 1 ? c->all[i] : -1.0f;
        assert_memory_equal(&c->some[i], &want, sizeof(want));
    }
}

static void listed_packets_have_the_bits_of_the_whole(void **state)
{
    static const enum method methods[] = { METHOD_MIS, METHOD_BRDF, METHOD_LIGHT, METHOD_AUTO };
    struct court c = court_make();
    const struct gbuffer *g = c.set->gbuffer;
    (void)state;

    for (size_t k = 0; k < sizeof(methods) / sizeof(methods[0]); k++) {
        struct direct_desc desc = { .method = methods[k], .samples = 9, .seed = 4 };
        struct direct_stats all, some;
        assert_int_equal(direct_shade(c.direct, g, c.set->rays, c.sky, &desc, c.all, &all), ERR_OK);
        for (size_t i = 0; i < c.values; i++)
            c.some[i] = -1.0f;
        desc.only = &c.list;
        assert_int_equal(direct_shade(c.direct, g, c.set->rays, c.sky, &desc, c.some, &some), ERR_OK);
        assert_only_listed(&c);
        assert_true(some.rays > 0 && some.rays < all.rays);
        assert_true(all.lobes == 0 ? some.lobes == 0 : some.lobes < all.lobes);
    }
    court_finish(&c);
}

static void kept_tables_give_the_bits_of_new_ones(void **state)
{
    static const struct direct_desc descs[] = {
        { .method = METHOD_AUTO },
        { .method = METHOD_MIS },
        { .method = METHOD_MIS, .cells = 4, .sun = true, .compensate = COMPENSATE_ON },
        { .method = METHOD_FACES, .cells = 8 },
        { .method = METHOD_BRDF, .cells = 4 },
        { .method = METHOD_LATLONG },
    };
    struct court c = court_make();
    (void)state;

    for (size_t k = 0; k < sizeof(descs) / sizeof(descs[0]); k++) {
        struct direct_desc desc = descs[k];
        struct direct_stats new, kept;
        desc.samples = 8;
        for (desc.seed = 0; desc.seed < 2; desc.seed++) { /* the first builds what the second keeps */
            desc.keep = desc.seed > 0;
            assert_int_equal(direct_shade(c.direct, c.set->gbuffer, c.set->rays, c.sky, &desc, c.some, &kept), ERR_OK);
        }
        desc.seed = 1;
        desc.keep = false;
        assert_int_equal(direct_shade(c.direct, c.set->gbuffer, c.set->rays, c.sky, &desc, c.all, &new), ERR_OK);
        assert_memory_equal(c.all, c.some, c.values * sizeof(float));
        assert_int_equal(new.strata, kept.strata);
    }
    court_finish(&c);
}

static void listed_packets_alone_get_eye_paths(void **state)
{
    struct court c = court_make();
    struct eye_paths_desc desc = { .classes = PATH_INDIRECT, .behind_classes = PATH_INDIRECT, .paths = 2, .seed = 8 };
    struct eye_paths_stats all, some;
    (void)state;

    assert_int_equal(eye_paths_shade(c.set->scene, c.set->rays, c.set->gbuffer, c.sky, &desc, c.all, &all), ERR_OK);
    for (size_t i = 0; i < c.values; i++)
        c.some[i] = i / (3 * PACKET) % 3 == 1 ? 0.0f : -1.0f;
    desc.only = &c.list;
    assert_int_equal(eye_paths_shade(c.set->scene, c.set->rays, c.set->gbuffer, c.sky, &desc, c.some, &some), ERR_OK);
    assert_only_listed(&c);
    assert_true(some.paths > 0 && some.paths < all.paths);
    court_finish(&c);
}

static const uint32_t dealt[3] = { 2, 8, 5 }; /* counts, to packets in turn */

static uint32_t *deal(const struct court *c)
{
    uint32_t *counts = mem_alloc(c->set->gbuffer->packet_count, sizeof(*counts));
    for (uint32_t i = 0; i < c->set->gbuffer->packet_count; i++)
        counts[i] = dealt[i % 3];
    return counts;
}

static void packets_with_counts_of_their_own_have_the_bits_of_images_with_these(void **state)
{
    static const struct direct_desc descs[] = {
        { .method = METHOD_MIS },  { .method = METHOD_AUTO },    { .method = METHOD_FACES, .sun = true },
        { .method = METHOD_BRDF }, { .method = METHOD_LATLONG }, { .method = METHOD_LIGHT },
    };
    struct court c = court_make();
    uint32_t *counts = deal(&c);
    (void)state;

    for (size_t k = 0; k < sizeof(descs) / sizeof(descs[0]); k++) {
        struct direct_desc desc = descs[k];
        struct direct_stats own, same[3];
        desc.seed = 4;
        desc.samples = 8;
        desc.counts = counts;
        assert_int_equal(direct_shade(c.direct, c.set->gbuffer, c.set->rays, c.sky, &desc, c.some, &own), ERR_OK);
        desc.counts = NULL;
        for (uint32_t turn = 0; turn < 3; turn++) {
            desc.samples = dealt[turn];
            assert_int_equal(direct_shade(c.direct, c.set->gbuffer, c.set->rays, c.sky, &desc, c.all, &same[turn]),
                             ERR_OK);
            for (size_t i = turn * 3 * PACKET; i < c.values; i += 9 * PACKET)
                assert_memory_equal(&c.all[i], &c.some[i], 3 * PACKET * sizeof(float));
        }
        assert_true(own.rays > same[0].rays && own.rays < same[1].rays);
        assert_true(own.lobes == 0 ? same[1].lobes == 0 : own.lobes > same[0].lobes && own.lobes < same[1].lobes);
    }
    mem_free(counts);
    court_finish(&c);
}

/* Cells draw as many samples as the packets ask for: no two runs have the same. The mean over the image is held to
 * one of 512 samples, within 4 of its standard errors, about 4 % in all, from 16 seeds. */
static void counts_of_their_own_leave_the_mean_where_it_is(void **state)
{
    struct direct_desc desc = { .method = METHOD_MIS, .cells = 4, .sun = true, .compensate = COMPENSATE_ON };
    struct court c = court_make();
    uint32_t *counts = deal(&c);
    double sum[2] = { 0.0 }, square = 0.0;
    struct direct_stats stats;
    (void)state;

    desc.samples = 512;
    assert_int_equal(direct_shade(c.direct, c.set->gbuffer, c.set->rays, c.sky, &desc, c.all, &stats), ERR_OK);
    for (size_t i = 0; i < c.values; i++)
        sum[1] += (double)c.all[i];
    desc.samples = 8;
    desc.counts = counts;
    for (desc.seed = 1; desc.seed <= 16; desc.seed++) {
        double one = 0.0;
        assert_int_equal(direct_shade(c.direct, c.set->gbuffer, c.set->rays, c.sky, &desc, c.some, &stats), ERR_OK);
        for (size_t i = 0; i < c.values; i++)
            one += (double)c.some[i];
        sum[0] += one / 16.0;
        square += one * one / 16.0;
    }
    const double deviation = sqrt((square - sum[0] * sum[0]) / 15.0);
    assert_true(deviation < 0.015 * sum[1]);
    assert_true(fabs(sum[0] - sum[1]) < 4.0 * deviation);
    mem_free(counts);
    court_finish(&c);
}

/* With every count the largest, the bits of a run without; with others, so many paths and a mean within 4 standard
 * errors, about 2 % in all, from 16 seeds. */
static void eye_paths_follow_counts_too(void **state)
{
    struct court c = court_make();
    struct eye_paths_desc desc = { .classes = PATH_INDIRECT, .paths = 8, .seed = 8 };
    uint32_t *counts = deal(&c);
    double sum[2] = { 0.0 }, square[2] = { 0.0 };
    uint64_t wanted = 0;
    (void)state;

    for (uint32_t i = 0; i < c.set->gbuffer->packet_count; i++)
        for (uint32_t l = 0; l < c.set->gbuffer->packets[i].count; l++)
            wanted += c.set->gbuffer->packets[i].behind[l] ? 0 : counts[i];
    for (desc.seed = 1; desc.seed <= 16; desc.seed++)
        for (int k = 0; k < 2; k++) {
            struct eye_paths_stats stats;
            double one = 0.0;
            memset(c.all, 0, c.values * sizeof(float));
            desc.counts = k ? counts : NULL;
            assert_int_equal(eye_paths_shade(c.set->scene, c.set->rays, c.set->gbuffer, c.sky, &desc, c.all, &stats),
                             ERR_OK);
            assert_true(k == 0 || stats.paths == wanted);
            for (size_t i = 0; i < c.values; i++)
                one += (double)c.all[i];
            sum[k] += one / 16.0;
            square[k] += one * one / 16.0;
        }
    double variance = 0.0;
    for (int k = 0; k < 2; k++)
        variance += (square[k] - sum[k] * sum[k]) / 15.0;
    assert_true(sqrt(variance) < 0.01 * sum[0]);
    assert_true(fabs(sum[0] - sum[1]) < 4.0 * sqrt(variance));
    mem_free(counts);
    court_finish(&c);
}

/* Both halves of passes 0 to 3 draw different numbers: those of passes 2 p and 2 p + 1, each half with a seed of its
 * own for eye paths. */
static void halves_are_passes_of_their_own(void **state)
{
    struct frame_plan whole = { .count = 0 }, half[2];
    (void)state;

    frame_plan_add(&whole, PASS_DIRECT, PATH_DIRECT)->direct = (struct direct_desc){ .seed = 7 };
    frame_plan_add(&whole, PASS_EYE, PATH_INDIRECT)->eye = (struct eye_paths_desc){ .seed = 7 };
    frame_plan_add(&whole, PASS_EYE, PATH_INDIRECT)->eye = (struct eye_paths_desc){ .seed = 8 };
    for (uint64_t pass = 0; pass < 4; pass++) {
        whole.pass[0].direct.pass = whole.pass[1].eye.pass = whole.pass[2].eye.pass = pass;
        for (int k = 0; k < 2; k++) {
            frame_plan_half(&whole, k, &half[k]);
            assert_true(half[k].pass[0].direct.scatter);
            assert_int_equal(half[k].pass[0].direct.pass, 2 * pass + (uint64_t)k);
            for (int i = 1; i <= 2; i++)
                assert_int_equal(half[k].pass[i].eye.pass, 2 * pass + (uint64_t)k);
        }
        const uint64_t one = half[0].pass[1].eye.seed;
        assert_true(one != half[1].pass[1].eye.seed && one != half[0].pass[2].eye.seed);
    }
}

/* A filtered plan samples both halves of what it lists, each kind after the other; the rest stays. */
static void a_filtered_plan_samples_two_halves(void **state)
{
    static const struct {
        enum pass_kind kind;
        int half;
        uint64_t seed;
    } want[] = { { PASS_DIRECT, 0, 0 }, { PASS_DIRECT, 1, 0 }, { PASS_EYE, 0, 7 },    { PASS_EYE, 0, 8 },
                 { PASS_EYE, 1, 7 },    { PASS_EYE, 1, 8 },    { PASS_FILTER, -1, 0 }, { PASS_RESOLVE, -1, 0 } };
    struct frame_plan p = { .count = 0 };
    (void)state;

    frame_plan_add(&p, PASS_RESOLVE, 0);
    frame_plan_add(&p, PASS_EYE, PATH_INDIRECT)->eye = (struct eye_paths_desc){ .seed = 7 };
    frame_plan_add(&p, PASS_FILTER, 0);
    frame_plan_add(&p, PASS_DIRECT, PATH_DIRECT);
    frame_plan_add(&p, PASS_EYE, PATH_INDIRECT)->eye = (struct eye_paths_desc){ .seed = 8 };
    assert_true(frame_plan_is_filtered(&p));
    frame_plan_split(&p);
    assert_int_equal(p.count, sizeof(want) / sizeof(want[0]));
    for (uint32_t k = 0; k < p.count; k++) {
        assert_int_equal(p.pass[k].kind, want[k].kind);
        assert_int_equal(p.pass[k].half, want[k].half);
        if (want[k].kind == PASS_EYE)
            assert_true(p.pass[k].eye.seed == rng_mix(want[k].seed, (uint64_t)want[k].half));
    }
}

/* What brings none of the classes goes; eye paths and particles keep theirs; without direct light the others add to
 * darkness. */
static void classes_are_kept_in_a_plan(void **state)
{
    struct frame_plan p = { .count = 0, .background = true };
    (void)state;

    frame_plan_add(&p, PASS_DIRECT, PATH_DIRECT)->direct = (struct direct_desc){ .samples = 4 };
    frame_plan_add(&p, PASS_EYE, PATH_INDIRECT | PATH_CAUSTICS)->eye =
        (struct eye_paths_desc){ .classes = PATH_INDIRECT, .behind_classes = PATH_CAUSTICS };
    frame_plan_add(&p, PASS_STORED, PATH_CAUSTICS);
    frame_plan_add(&p, PASS_PARTICLES, PATH_CAUSTICS)->light = (struct light_tracer_desc){ .classes = PATH_CAUSTICS };
    frame_plan_keep(&p, PATH_CAUSTICS);
    assert_int_equal(p.count, 4);
    assert_int_equal(p.pass[0].direct.samples, 0);
    assert_int_equal(p.pass[1].eye.classes, 0);
    assert_int_equal(p.pass[1].eye.behind_classes, PATH_CAUSTICS);
    assert_int_equal(p.pass[3].light.shown, PATH_CAUSTICS);
    assert_false(p.background);
    frame_plan_keep(&p, PATH_INDIRECT);
    assert_int_equal(p.count, 1);
    assert_int_equal(p.pass[0].kind, PASS_DIRECT);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(halves_are_passes_of_their_own),
    cmocka_unit_test(a_filtered_plan_samples_two_halves),
    cmocka_unit_test(classes_are_kept_in_a_plan),
    cmocka_unit_test(listed_packets_have_the_bits_of_the_whole),
    cmocka_unit_test(kept_tables_give_the_bits_of_new_ones),
    cmocka_unit_test(listed_packets_alone_get_eye_paths),
    cmocka_unit_test(packets_with_counts_of_their_own_have_the_bits_of_images_with_these),
    cmocka_unit_test(counts_of_their_own_leave_the_mean_where_it_is),
    cmocka_unit_test(eye_paths_follow_counts_too),
};
UNIT_MAIN(tests)
