/* What the pilot knows and how: its groups hold every pixel once, its models find the law behind readings. */
#include "pilot_measure.h"
#include "pilot_model.h"
#include "pilots.h"

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
    struct set *set = set_of(NULL, 160, 90);
    const struct gbuffer *g = set->gbuffer;
    static uint8_t seen[160 * 90];
    struct groups s;
    (void)state;

    assert_true(groups_init(&s, g));
    assert_in_range(s.count, 8, GROUPS_MAX);
    double weight = 0.0;
    for (uint32_t k = 0; k < s.count; k++) {
        const struct group *group = &s.group[k];
        assert_true(group->pixel_count > 0);
        for (uint32_t i = 0; i < group->pixel_count; i++) {
            const uint32_t pixel = group->pixels[i];
            assert_int_equal(seen[pixel]++, 0);
            for (uint32_t j = g->entry_first[pixel]; j < g->entry_first[pixel + 1]; j += 3)
                assert_true(in_list(&group->both, g->entries[j].point / PACKET));
        }
        weight += group->weight[SURFACE_MATTE] + group->weight[SURFACE_GLOSSY];
        assert_int_equal(group->both.count, group->list[0].count + group->list[1].count);
    }
    for (uint32_t pixel = 0; pixel < 160 * 90; pixel++)
        assert_int_equal(seen[pixel], g->entry_first[pixel + 1] > g->entry_first[pixel]);
    assert_float_equal(weight, s.all.weight[SURFACE_MATTE] + s.all.weight[SURFACE_GLOSSY], 1e-6 * weight);
    assert_int_equal(s.all.both.count, g->packet_count);
    groups_finish(&s);
    set_destroy(set);
}

/* Noise of known variance on both estimates: half of the squared difference is that variance over the yardstick, the
 * product the square of what they share. 160 x 90 pixels make the mean of squares known to 1.2 %. */
static void pairs_tell_variance_and_energy(void **state)
{
    enum { PIXELS = 160 * 90 };
    static float a[3 * PIXELS], b[3 * PIXELS], r[3 * PIXELS];
    static uint8_t mask[PIXELS];
    struct set *set = set_of(NULL, 160, 90);
    struct rng rng = { 3 };
    struct groups s;
    struct yardstick y;
    struct pair pair;
    (void)state;

    assert_true(groups_init(&s, set->gbuffer));
    for (size_t i = 0; i < 3 * (size_t)PIXELS; i++) {
        r[i] = 2.0f;
        a[i] = 0.5f + 0.3f * (float)(rng_next(&rng) - 0.5);
        b[i] = 0.5f + 0.3f * (float)(rng_next(&rng) - 0.5);
        mask[i / 3] = 1;
    }
    yardstick_init(&y, r, mask, 160, 90);
    y.place = PAIR_APART;
    pair_of_pictures(&s.all, a, b, &y, &pair);
    assert_int_equal(pair.pixels, s.all.pixel_count);
    const double measure = 4.0 * 1.01;
    assert_float_equal(pair.error / (double)pair.pixels, 0.09 / 12.0 / measure, 0.05 * 0.09 / 12.0 / measure);
    assert_float_equal(pair.energy / (double)pair.pixels, 0.25 / measure, 0.02 * 0.25 / measure);
    groups_finish(&s);
    set_destroy(set);
}

static void a_model_finds_the_order_behind_noisy_readings(void **state)
{
    struct model m = { 0 };
    struct rng r = { 9 };
    (void)state;

    model_read(&m, &(struct reading){ 8.0, 0.2, 0.0, 1.0, false });
    assert_float_equal(m.order, 1.0, 1e-12); /* one reading says nothing about it */
    assert_float_equal(model_error(&m, 16.0), 0.1, 1e-12);
    m = (struct model){ 0 };
    for (int k = 0; k < 200; k++) {
        const double n = exp2(1.0 + 8.0 * rng_next(&r));
        model_read(&m, &(struct reading){ n, 3.0 * pow(n, -1.4) * (0.5 + rng_next(&r)), 0.25, 1.0, false });
    }
    assert_float_equal(m.order, 1.4, 0.1);
    assert_float_equal(model_error(&m, 32.0), 3.0 * pow(32.0, -1.4), 0.25 * 3.0 * pow(32.0, -1.4));
    assert_float_equal(m.energy, 0.25, 1e-12);
}

static void a_whole_picture_corrects_what_a_part_said_of_its_time(void **state)
{
    struct model m = { 0 };
    (void)state;

    model_time(&m, 0.001, 10.0, 0.01, 0.1); /* 0.01 s for 10 on a tenth: 0.01 each for all */
    assert_float_equal(model_seconds(&m, 20.0), 0.201, 1e-9);
    model_ran(&m, 20.0, 0.402);
    assert_float_equal(model_seconds(&m, 20.0), 0.402, 1e-9);
    model_ran(&m, 20.0, 40.0); /* a hiccup */
    assert_true(model_seconds(&m, 20.0) < 0.6);
    for (int k = 0; k < 12; k++)
        model_ran(&m, 20.0, 0.2);
    assert_float_equal(model_seconds(&m, 20.0), 0.2, 0.01);
}

static void an_old_sky_is_forgotten_by_the_first_new_reading(void **state)
{
    struct model m = { 0 };
    (void)state;

    for (int k = 0; k < 40; k++)
        model_read(&m, &(struct reading){ 4.0, 1.0, 0.0, 1.0, false });
    model_age(&m);
    assert_float_equal(model_error(&m, 4.0), 1.0, 1e-9); /* until then it is all there is */
    model_read(&m, &(struct reading){ 4.0, 0.01, 0.0, 1.0, false });
    assert_float_equal(model_error(&m, 4.0), 0.01, 1e-9);
    assert_int_equal(m.fresh, 1);
}

/* What is compared was read in places of which some are a hundred times as hard as others: the ratio of sums finds the
 * way's own error, 2, of 24 readings, each off by up to a half; a mean of ratios would hang on the easy places, where
 * one reading in ten says 20 and the others 0. */
static void readings_of_hard_and_easy_places_are_comparable(void **state)
{
    struct model m = { 0 };
    struct rng r = { 5 };
    (void)state;

    for (int k = 0; k < 24; k++) {
        const double hard = k % 3 ? 0.02 : 2.96, own = k % 3 == 0 ? 2.0 : rng_next(&r) < 0.1 ? 20.0 : 0.0;
        model_read(&m, &(struct reading){ 16.0, own * hard / 16.0 * (0.5 + rng_next(&r)), 0.0, hard, false });
    }
    assert_float_equal(model_error(&m, 16.0), 2.0 / 16.0, 0.25 * 2.0 / 16.0);
    assert_true(m.doubt > 0.05 && m.doubt < 0.5);
    const double before = m.doubt;
    for (int k = 0; k < 8; k++) /* which contradict the rest */
        model_read(&m, &(struct reading){ 16.0, 1.0, 0.0, 1.0, false });
    assert_true(m.doubt > 1.2 * before);
}

/* A first picture's readings count until there are two of a better one. */
static void rough_readings_give_way(void **state)
{
    struct model m = { 0 };
    (void)state;

    model_read(&m, &(struct reading){ 4.0, 9.0, 9.0, 1.0, true });
    model_read(&m, &(struct reading){ 4.0, 1.0, 0.5, 1.0, false });
    assert_true(model_is_rough(&m));
    assert_float_equal(model_error(&m, 4.0), 5.0, 1e-9);
    model_read(&m, &(struct reading){ 4.0, 1.0, 0.5, 1.0, false });
    assert_false(model_is_rough(&m));
    assert_float_equal(model_error(&m, 4.0), 1.0, 1e-9);
    assert_float_equal(model_error_told(&m, 4.0), 1.0, 1e-9);
    assert_float_equal(m.energy, 0.5, 1e-9);
}

/* Few samples take more time each than many: two counts tell what any takes, 40 ms of all points, from 10 ms a sample,
 * and single packets what a run takes on however few of them, 0.5 ms, of which a tenth of the points has not a tenth.
 */
static void counts_and_sizes_tell_what_a_time_is_made_of(void **state)
{
    const double n[2] = { 4.0, 16.0 }, none[2] = { 0.0005, 0.0005 }, share[2] = { 0.1, 0.1 };
    struct model m = { 0 };
    (void)state;

    model_slope(&m, 0.002, n, (const double[2]){ 0.0085, 0.0205 }, none, share);
    assert_float_equal(model_begin(&m), 0.0425, 1e-9);
    assert_float_equal(model_seconds(&m, 64.0), 0.6825, 1e-9);
    model_time(&m, 0.002, 16.0, 0.0205, 0.1); /* as expected: nothing changes */
    assert_float_equal(model_seconds(&m, 64.0), 0.6825, 1e-9);
    model_slope(&m, 0.002, n, (const double[2]){ 0.5, 0.0205 }, none, share); /* a hiccup */
    assert_true(m.unit_s > 0.0 && m.base_s >= 0.0);
    model_scale(&m, 2.0);
    assert_float_equal(m.tables_s, 0.004, 1e-12);
}

/* A picture that is dark in one corner: every group gets its share of it, to a tile. */
static void each_group_has_its_share_of_the_dark(void **state)
{
    enum { W = 160, H = 90 };
    static float rgb[3 * W * H];
    static uint8_t mask[W * H];
    struct set *set = set_of(NULL, W, H);
    struct yardstick y;
    struct groups s;
    double least = INFINITY, most = 0.0;
    uint64_t pixels = 0;
    (void)state;

    for (size_t i = 0; i < (size_t)W * H; i++) {
        for (size_t c = 0; c < 3; c++)
            rgb[3 * i + c] = i % W > W / 2 && i / W > H / 2 ? 0.05f : 2.0f;
        mask[i] = 1;
    }
    yardstick_init(&y, rgb, mask, W, H);
    assert_true(groups_init(&s, set->gbuffer));
    assert_true(groups_deal(&s, &y));
    for (uint32_t k = 0; k < s.count; k++) {
        uint32_t dark = 0;
        for (uint32_t j = 0; j < s.group[k].pixel_count; j++)
            dark += rgb[3 * (size_t)s.group[k].pixels[j]] < 1.0f;
        least = fmin(least, dark);
        most = fmax(most, dark);
        pixels += s.group[k].pixel_count;
    }
    assert_int_equal(pixels, s.all.pixel_count);
    assert_true(least > 0.0 && most - least <= 1.5 * s.side * s.side);
    groups_finish(&s);
    set_destroy(set);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(readings_of_hard_and_easy_places_are_comparable),
    cmocka_unit_test(rough_readings_give_way),
    cmocka_unit_test(counts_and_sizes_tell_what_a_time_is_made_of),
    cmocka_unit_test(each_group_has_its_share_of_the_dark),
    cmocka_unit_test(each_pixel_is_in_one_group_with_all_its_packets),
    cmocka_unit_test(pairs_tell_variance_and_energy),
    cmocka_unit_test(a_model_finds_the_order_behind_noisy_readings),
    cmocka_unit_test(a_whole_picture_corrects_what_a_part_said_of_its_time),
    cmocka_unit_test(an_old_sky_is_forgotten_by_the_first_new_reading),
};
UNIT_MAIN(tests)
