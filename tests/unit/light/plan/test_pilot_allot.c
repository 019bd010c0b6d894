/* Who gets how many samples: planted hardness, so that the best is known. */
#include "light/frame/pilots.h"
#include "light/plan/pilot_measure.h"

#include <math.h>
#include <string.h>

enum { WIDTH = 160, HEIGHT = 90 };

struct deal {
    struct prepared_scene *set;
    uint32_t *index;
    struct packet_list list;
    struct allotment allot;
    float (*error)[PACKET];
};

static struct deal deal_make(void)
{
    struct deal d = { .set = set_of(&(struct prepared_scene_desc){ .width = WIDTH, .height = HEIGHT }) };
    const uint32_t packets = d.set->gbuffer->packet_count;

    d.index = mem_alloc(packets, sizeof(*d.index));
    d.error = mem_alloc(packets, sizeof(*d.error));
    for (uint32_t i = 0; i < packets; i++)
        d.index[i] = i;
    d.list = (struct packet_list){ d.index, packets };
    assert_true(allot_init(&d.allot, d.set->gbuffer, &d.list));
    return d;
}

static void deal_finish(struct deal *d)
{
    allot_finish(&d->allot);
    mem_free(d->index);
    mem_free(d->error);
    set_destroy(d->set);
}

/* Sixteen kinds of packets, from 1 to 2^7.5 times as hard. */
static double hardness(uint32_t packet)
{
    return pow(2.0, 0.5 * (packet * 7 % 16));
}

/* As a pair with these counts would have it, over its points. */
static void plant(struct deal *d, const struct allot_count *count)
{
    const double factor = allot_factor(&d->allot, count);

    for (uint32_t i = 0; i < d->list.count; i++)
        for (int l = 0; l < PACKET; l++)
            d->error[i][l] = (float)(hardness(i) / allot_real(&d->allot, count, factor, i) / PACKET);
}

static double error_of(const struct deal *d, const struct allot_count *count)
{
    const double factor = allot_factor(&d->allot, count);
    double sum = 0.0;

    for (uint32_t i = 0; i < d->list.count; i++)
        sum += hardness(i) / allot_real(&d->allot, count, factor, i);
    return sum;
}

static void counts_have_the_mean_that_was_asked_for(void **state)
{
    struct deal d = deal_make();
    (void)state;

    for (uint32_t step = 1; step <= 2; step++)
        for (double n = step; n < 300.0; n *= 1.37) {
            const struct allot_count count = { n, step };
            const uint32_t most = allot_counts(&d.allot, &count, &d.list);
            double sum = 0.0;
            uint32_t largest = 0;
            for (uint32_t i = 0; i < d.list.count; i++) {
                const uint32_t own = d.allot.counts[i];
                assert_true(own >= step && own % step == 0);
                largest = own > largest ? own : largest;
                sum += own;
            }
            assert_int_equal(largest, most);
            assert_float_equal(sum / d.list.count, n, 0.05 * step);
            assert_float_equal(allot_mean(&d.allot, &count, &d.list), n, 1e-6 * n);
        }
    deal_finish(&d);
}

/* Before anything is read: points of pixels with many have less each. */
static void edges_have_less_from_the_start(void **state)
{
    struct deal d = deal_make();
    const struct gbuffer *g = d.set->gbuffer;
    double share[2] = { 0.0 }, points[2] = { 0.0 };
    (void)state;

    for (size_t i = 0; i < (size_t)WIDTH * HEIGHT; i++) {
        const uint32_t entries = g->entry_first[i + 1] - g->entry_first[i];
        for (uint32_t k = g->entry_first[i]; k < g->entry_first[i + 1]; k++) {
            share[entries > 1] += (double)d.allot.share[g->entries[k].point / PACKET];
            points[entries > 1] += 1.0;
        }
    }
    printf("shares: edges %.2f, plain pixels %.2f\n", share[1] / points[1], share[0] / points[0]);
    assert_true(1.5 * share[1] / points[1] < share[0] / points[0]);
    deal_finish(&d);
}

/* With the square root of what is hard the error is (mean sqrt h)^2 / mean h of that with even counts; the tenth that
 * all get alike may cost a tenth of the gain. */
static void readings_lead_to_the_least_error(void **state)
{
    struct deal d = deal_make();
    const struct allot_count count = { 64.0, 1 };
    double root = 0.0, mean = 0.0;
    (void)state;

    for (uint32_t i = 0; i < d.list.count; i++) {
        root += sqrt(hardness(i)) / d.list.count;
        mean += hardness(i) / d.list.count;
    }
    const double before = error_of(&d, &count), even = mean * d.list.count / count.n, best = even * root * root / mean;
    plant(&d, &count);
    allot_read(&d.allot, &d.list, (const float(*)[PACKET])d.error, &count);
    const double ratio = allot_deal(&d.allot), after = error_of(&d, &count);
    printf("even %.4g, best %.4g; before %.4g, after %.4g, said %.4g\n", even, best, before, after, ratio * before);
    assert_true(after < best + 0.1 * (even - best) && after > 0.999 * best);
    assert_float_equal(ratio * before / after, 1.0, 0.02);
    assert_float_equal(allot_deal(&d.allot), 1.0, 1e-3); /* the shares stay while nothing else is read */
    deal_finish(&d);
}

/* A part at a time, each of which stands for the whole, they come to the same shares. */
static void parts_add_up_to_the_whole(void **state)
{
    enum { PARTS = 5 };
    struct deal d = deal_make(), whole = deal_make();
    const struct allot_count count = { 64.0, 1 };
    uint32_t *some = mem_alloc(d.list.count, sizeof(*some));
    (void)state;

    plant(&whole, &count);
    allot_read(&whole.allot, &whole.list, (const float(*)[PACKET])whole.error, &count);
    (void)allot_deal(&whole.allot);
    plant(&d, &count);
    for (uint32_t part = 0; part < PARTS; part++) {
        struct packet_list list = { some, 0 };
        for (uint32_t i = part; i < d.list.count; i += PARTS)
            some[list.count++] = i;
        allot_read(&d.allot, &list, (const float(*)[PACKET])d.error, &count);
    }
    (void)allot_deal(&d.allot);
    for (uint32_t i = 0; i < d.list.count; i++)
        assert_true(fabsf(d.allot.share[i] / whole.allot.share[i] - 1.0f) < 0.1f);
    mem_free(some);
    deal_finish(&d);
    deal_finish(&whole);
}

/* As much as it may change by chance: one more or less of few. */
static void counts_stand_still_while_the_mean_does(void **state)
{
    struct deal d = deal_make();
    uint32_t *before = mem_alloc(d.list.count, sizeof(*before)), changed = 0;
    (void)state;

    (void)allot_counts(&d.allot, &(struct allot_count){ 6.0, 2 }, &d.list);
    memcpy(before, d.allot.counts, d.list.count * sizeof(*before));
    (void)allot_counts(&d.allot, &(struct allot_count){ 6.0, 2 }, &d.list);
    assert_memory_equal(before, d.allot.counts, d.list.count * sizeof(*before));
    (void)allot_counts(&d.allot, &(struct allot_count){ 6.1, 2 }, &d.list);
    for (uint32_t i = 0; i < d.list.count; i++) {
        assert_true(d.allot.counts[i] >= before[i] && d.allot.counts[i] <= before[i] + 2);
        changed += d.allot.counts[i] != before[i];
    }
    assert_true(changed > 0 && changed < d.list.count / 10);
    mem_free(before);
    deal_finish(&d);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(counts_have_the_mean_that_was_asked_for), cmocka_unit_test(edges_have_less_from_the_start),
    cmocka_unit_test(readings_lead_to_the_least_error),        cmocka_unit_test(parts_add_up_to_the_whole),
    cmocka_unit_test(counts_stand_still_while_the_mean_does),
};
UNIT_MAIN(tests)
