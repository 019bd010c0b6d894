/* The relighter's cache for --method cached: made once, told apart, refused where it is too large, and what it leaves
 * is sampled. */
#include "relight.h"
#include "shade/points.h"

enum { WIDTH = 64, HEIGHT = 36 };

struct stage {
    struct set *set;
    struct relighter *relighter;
    struct environment *sky;
    float *rgb;
    struct reason why;
};

static struct stage stage_make(void)
{
    const struct set_desc desc = { .width = WIDTH, .height = HEIGHT };
    struct stage s = { .sky = sky_environment(sky_with_sun(64, 32, 2e3f), 64, 0.0),
                       .rgb = mem_alloc((size_t)WIDTH * HEIGHT, 3 * sizeof(float)) };

    assert_int_equal(set_create(&desc, &s.set, &s.why), ERR_OK);
    s.relighter = relighter_create(s.set, best_kernels());
    assert_non_null(s.relighter);
    return s;
}

static void stage_finish(struct stage *s)
{
    relighter_destroy(s->relighter);
    set_destroy(s->set);
    environment_destroy(s->sky);
    mem_free(s->rgb);
}

static enum err run(struct stage *s, const struct relight_desc *light, struct relight_stats *stats)
{
    struct relight_desc desc = *light;

    desc.direct.why = &s->why;
    return relighter_run(s->relighter, s->sky, &desc, s->rgb, stats);
}

static void it_is_computed_once_and_told_apart(void **state)
{
    const struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 16 } };
    struct relight_stats first, second;
    struct stage s = stage_make();
    double ms;
    (void)state;

    assert_int_equal(run(&s, &light, &first), ERR_OK);
    assert_int_equal(run(&s, &light, &second), ERR_OK);
    assert_true(first.cache_ms > 0.0 && second.cache_ms == 0.0);
    assert_true(first.cache.bytes > 0 && first.cache.bytes == second.cache.bytes);
    assert_true(first.cache.packets + first.cache.left == s.set->gbuffer->packet_count);
    assert_true(first.cache_frame.bright > 0 && first.direct.rays >= first.cache_frame.rays);
    assert_non_null(first.bias);
    assert_int_equal(relighter_prepare(s.relighter, &light, false, &ms), ERR_OK);
    assert_true(ms == 0.0);
    stage_finish(&s);
}

static void what_it_leaves_is_sampled_as_auto_does(void **state)
{
    struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 16, .seed = 5 } };
    const size_t floats = 3 * PACKET;
    struct relight_stats stats;
    struct stage s = stage_make();
    struct transport *t;
    (void)state;

    assert_int_equal(transport_create(s.set->gbuffer, s.set->rays, best_kernels(),
                                      &(struct transport_desc){ .seed = 1 }, &t, &s.why),
                     ERR_OK);
    const struct packet_list *left = transport_left(t);
    assert_true(left->count > 0);
    float *own = mem_alloc(left->count, floats * sizeof(float));
    assert_int_equal(run(&s, &light, &stats), ERR_OK);
    assert_int_equal(stats.cache.left, left->count);
    for (uint32_t k = 0; k < left->count; k++)
        memcpy(own + k * floats, relighter_points(s.relighter) + left->index[k] * floats, floats * sizeof(float));
    light.direct.method = METHOD_AUTO;
    assert_int_equal(run(&s, &light, &stats), ERR_OK);
    for (uint32_t k = 0; k < left->count; k++)
        assert_memory_equal(own + k * floats, relighter_points(s.relighter) + left->index[k] * floats,
                            floats * sizeof(float));
    mem_free(own);
    transport_destroy(t);
    stage_finish(&s);
}

/* Refused again without being computed again; another limit is another question. */
static void one_that_is_too_large_is_refused(void **state)
{
    struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 16 }, .cache_bytes = 1000 };
    struct relight_stats stats;
    struct stage s = stage_make();
    struct reason before;
    (void)state;

    assert_int_equal(run(&s, &light, &stats), ERR_RANGE);
    assert_non_null(strstr(s.why.text, "--cache-memory"));
    before = s.why;
    s.why.text[0] = '\0';
    assert_int_equal(run(&s, &light, &stats), ERR_RANGE);
    assert_string_equal(s.why.text, before.text);
    assert_true(stats.cache_ms == 0.0);
    light.cache_bytes = 0;
    assert_int_equal(run(&s, &light, &stats), ERR_OK);
    light.cache_bytes = 1000;
    light.direct.method = METHOD_MIS; /* which needs none */
    assert_int_equal(run(&s, &light, &stats), ERR_OK);
    assert_true(stats.cache.bytes == 0);
    stage_finish(&s);
}

/* V = 1 everywhere: more light than with shadows, by a tenth at least in this court. */
static void without_visibility_it_is_another(void **state)
{
    struct relight_desc light = { .direct = { .method = METHOD_CACHED, .samples = 16 } };
    struct relight_stats stats;
    struct stage s = stage_make();
    double sum[2] = { 0.0 };
    (void)state;

    for (int k = 0; k < 2; k++) {
        light.direct.no_visibility = k;
        assert_int_equal(run(&s, &light, &stats), ERR_OK);
        assert_true(stats.cache_ms > 0.0);
        for (size_t i = 0; i < (size_t)s.set->gbuffer->packet_count * 3 * PACKET; i++)
            sum[k] += (double)relighter_points(s.relighter)[i];
    }
    assert_true(sum[1] > 1.1 * sum[0]);
    stage_finish(&s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(it_is_computed_once_and_told_apart),
    cmocka_unit_test(what_it_leaves_is_sampled_as_auto_does),
    cmocka_unit_test(one_that_is_too_large_is_refused),
    cmocka_unit_test(without_visibility_it_is_another),
};
UNIT_MAIN(tests)
