/* What the pilot knows and how: its groups hold every pixel once, its models stand on readings. */
#include "light/frame/pilots.h"
#include "light/plan/pilot_measure.h"

#include <math.h>

static bool in_list(const struct packet_list *l, uint32_t packet)
{
    for (uint32_t k = 0; k < l->count; k++)
        if (l->index[k] == packet)
            return true;
    return false;
}

static void each_pixel_is_in_one_group_with_all_its_packets(void **state)
{
    struct prepared_scene *set = set_of(&(struct prepared_scene_desc){ .width = 160, .height = 90 });
    const struct gbuffer *g = set->gbuffer;
    static uint8_t seen[160 * 90];
    struct groups s;
    (void)state;

    assert_true(groups_init(&s, g));
    assert_in_range(s.count, 8, GROUPS_MAX);
    uint32_t least = UINT32_MAX, most = 0;
    for (uint32_t k = 0; k < s.count; k++) {
        const struct group *group = &s.group[k];
        assert_true(group->pixel_count > 0);
        for (uint32_t i = 0; i < group->pixel_count; i++) {
            const uint32_t pixel = group->pixels[i];
            assert_int_equal(seen[pixel]++, 0);
            for (uint32_t j = g->entry_first[pixel]; j < g->entry_first[pixel + 1]; j += 3)
                assert_true(in_list(&group->list, g->entries[j].point / PACKET));
        }
        least = group->pixel_count < least ? group->pixel_count : least;
        most = group->pixel_count > most ? group->pixel_count : most;
    }
    printf("%u groups of %u to %u pixels\n", s.count, least, most);
    assert_true(most < 2 * least);
    for (uint32_t pixel = 0; pixel < 160 * 90; pixel++)
        assert_int_equal(seen[pixel], g->entry_first[pixel + 1] > g->entry_first[pixel]);
    assert_int_equal(s.all.list.count, g->packet_count);
    groups_finish(&s);
    set_destroy(set);
}

/* Noise of known variance on both estimates: half of the squared difference is that variance over the yardstick. 160 x
 * 90 pixels make the mean of squares known to 1.2 %. */
static void pairs_tell_variance(void **state)
{
    enum { PIXELS = 160 * 90 };
    static float a[3 * PIXELS], b[3 * PIXELS], r[3 * PIXELS];
    static uint8_t mask[PIXELS];
    struct prepared_scene *set = set_of(&(struct prepared_scene_desc){ .width = 160, .height = 90 });
    struct rng rng = { 3 };
    struct groups s;
    struct yardstick y;
    (void)state;

    assert_true(groups_init(&s, set->gbuffer));
    for (size_t i = 0; i < 3 * (size_t)PIXELS; i++) {
        r[i] = 2.0f;
        a[i] = 0.5f + 0.3f * (float)(rng_next(&rng) - 0.5);
        b[i] = 0.5f + 0.3f * (float)(rng_next(&rng) - 0.5);
        mask[i / 3] = 1;
    }
    yardstick_init(&y, r, mask, 160, 90);
    const double error = pair_of_images(&s.all, a, b, &y), measure = 4.0 * 1.01;
    assert_float_equal(error, 0.09 / 12.0 / measure, 0.05 * 0.09 / 12.0 / measure);
    groups_finish(&s);
    set_destroy(set);
}

/* Particles that bring light 1 on the mean to an image of 0.3, each to a pixel with probability p and as 1 / p: their
 * variance is 1 / p - 1. Also where hardly a pixel has any around, none is divided by itself, which would hide it. */
static void few_particles_show_their_noise(void **state)
{
    enum { WIDE = 160, HIGH = 90, PIXELS = WIDE * HIGH };
    static float half[2][3 * PIXELS], spare[3 * PIXELS], spread[3 * PIXELS], r[3 * PIXELS];
    static const struct {
        float p;
        bool noisy;
        double least, most; /* of the measured over the true variance; beyond a few particles it is nothing but true */
    } cases[] = {
        { 0.5f, false, 0.9, 1.1 },
        { 0.5f, true, 0.9, 1.1 },
        { 1e-3f, false, 0.8, 20.0 },
        { 1e-3f, true, 0.8, 20.0 },
    };
    static uint8_t mask[PIXELS];
    struct prepared_scene *set = set_of(&(struct prepared_scene_desc){ .width = WIDE, .height = HIGH });
    struct groups s;
    (void)state;

    assert_true(groups_init(&s, set->gbuffer));
    memset(mask, 1, sizeof(mask));
    for (size_t k = 0; k < sizeof(cases) / sizeof(cases[0]); k++) {
        const float p = cases[k].p;
        struct rng rng = { 5 };
        struct yardstick y;
        for (size_t i = 0; i < 3 * (size_t)PIXELS; i++) {
            for (int h = 0; h < 2; h++)
                half[h][i] = i % 3 ? half[h][i - 1] : (rng_next(&rng) < (double)p ? 1.0f / p : 0.0f);
            r[i] = 0.3f + 0.5f * (half[0][i] + half[1][i]);
        }
        yardstick_init(&y, r, mask, WIDE, HIGH);
        y.noisy = cases[k].noisy;
        yardstick_spread(half[0], half[1], WIDE, HIGH, spare, spread);
        y.more = spread;
        const double truth = (1.0 / (double)p - 1.0) / (1.3 * 1.3 + y.soft);
        const double ratio = pair_of_images(&s.all, half[0], half[1], &y) / truth;
        printf("particles in one pixel of %.0f: %.2f of the variance\n", 1.0 / (double)p, ratio);
        assert_true(ratio > cases[k].least && ratio < cases[k].most);
    }
    groups_finish(&s);
    set_destroy(set);
}

/* Readings at several counts, each off by up to a half: their mean by what one unit leaves. */
static void a_model_finds_the_variance_behind_noisy_readings(void **state)
{
    struct model m = { 0 };
    struct rng r = { 9 };
    (void)state;

    model_read(&m, 8.0, 0.2);
    assert_float_equal(model_error(&m, 16.0), 0.1, 1e-12);
    m = (struct model){ 0 };
    for (int k = 0; k < 200; k++) {
        const double n = exp2(1.0 + 8.0 * rng_next(&r));
        model_read(&m, n, 3.0 / n * (0.5 + rng_next(&r)));
    }
    assert_float_equal(model_error(&m, 32.0), 3.0 / 32.0, 0.2 * 3.0 / 32.0);
    m.variance *= 0.5;
    assert_float_equal(model_error(&m, 32.0), 1.5 / 32.0, 0.2 * 1.5 / 32.0);
}

static void whole_images_tell_the_time(void **state)
{
    struct model m = { 0 };
    (void)state;

    model_ran(&m, 10.0, 0.2);
    assert_float_equal(model_seconds(&m, 20.0), 0.4, 1e-9);
    model_ran(&m, 20.0, 40.0); /* a hiccup */
    assert_true(model_seconds(&m, 20.0) < 0.8);
    for (int k = 0; k < 12; k++)
        model_ran(&m, 20.0, 0.2);
    assert_float_equal(model_seconds(&m, 20.0), 0.2, 0.01);
}

static void an_old_sky_is_forgotten_by_the_first_new_reading(void **state)
{
    struct model m = { 0 };
    (void)state;

    for (int k = 0; k < 40; k++)
        model_read(&m, 4.0, 1.0);
    model_age(&m);
    assert_float_equal(model_error(&m, 4.0), 1.0, 1e-9); /* until then it is all there is */
    model_read(&m, 4.0, 0.01);
    assert_float_equal(model_error(&m, 4.0), 0.01, 1e-9);
    assert_int_equal(m.fresh, 1);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(each_pixel_is_in_one_group_with_all_its_packets),
    cmocka_unit_test(pairs_tell_variance),
    cmocka_unit_test(few_particles_show_their_noise),
    cmocka_unit_test(a_model_finds_the_variance_behind_noisy_readings),
    cmocka_unit_test(whole_images_tell_the_time),
    cmocka_unit_test(an_old_sky_is_forgotten_by_the_first_new_reading),
};
UNIT_MAIN(tests)
