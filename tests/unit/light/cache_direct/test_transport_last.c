/* Frames under a sky of which only some has changed: they compute that alone, and have the bits of whole frames. */
#include "light/cache_direct/internal.h"
#include "light/cache_direct/transports.h"
#include "light/frame/relight.h"
#include "support/sets.h"

enum { SKY = 64 };

struct frames {
    struct prepared_scene *set;
    struct transport *transport;
    struct frame painted; /* SKY x SKY / 2 */
    float *lo, *whole;
    struct transport_frame_stats stats;
};

static struct frames frames_make(void)
{
    struct frames f = { .set = set_of(&(struct prepared_scene_desc){ .width = 40, .height = 22 }) };
    const size_t floats = (size_t)f.set->gbuffer->packet_count * 3 * PACKET;

    f.transport =
        transport_of(f.set->gbuffer, f.set->rays, &(struct transport_desc){ .per_cell = 1, .lobe_samples = 8 });
    f.painted = sky_with_sun(SKY, SKY / 2, 4e3f);
    f.lo = mem_alloc(floats, sizeof(float));
    f.whole = mem_alloc(floats, sizeof(float));
    return f;
}

static void frames_finish(struct frames *f)
{
    transport_destroy(f->transport);
    set_destroy(f->set);
    frame_finish(&f->painted);
    mem_free(f->lo);
    mem_free(f->whole);
}

/* A frame, and the same one computed whole. */
static void shade_both(struct frames *f, const atomic_bool *cancel)
{
    const size_t bytes = (size_t)f->set->gbuffer->packet_count * 3 * PACKET * sizeof(float);
    struct transport_frame frame = { .cancel = cancel };
    struct transport_frame_stats stats;
    struct frame copy = sky_constant(SKY, SKY / 2, 0.0f);

    memcpy(copy.rgb, f->painted.rgb, (size_t)3 * SKY * (SKY / 2) * sizeof(float));
    struct environment *e = sky_environment(copy, 64, 0.0);
    assert_int_equal(transport_shade(f->transport, e, &frame, f->lo, &f->stats), ERR_OK);
    if (!cancel) {
        frame.end = f->set->gbuffer->packet_count;
        assert_int_equal(transport_shade(f->transport, e, &frame, f->whole, &stats), ERR_OK);
        assert_memory_equal(f->lo, f->whole, bytes);
        assert_true(stats.lit == f->set->gbuffer->packet_count && f->stats.lit <= stats.lit);
    }
    environment_destroy(e);
}

/* Dims a patch of size x size texels above the horizon, from column x0 on. */
static void dim(struct frames *f, uint32_t x0, uint32_t size, float by)
{
    for (uint32_t y = SKY / 4 - size; y < SKY / 4; y++)
        for (uint32_t x = x0; x < x0 + size; x++)
            for (uint32_t c = 0; c < 3; c++)
                f->painted.rgb[3 * (y * SKY + x % SKY) + c] *= by;
}

/* Any change after any other, at last a frame that is cancelled and lit again. */
static void any_changes(struct frames *f)
{
    const atomic_bool cancel = true;
    struct rng r = { 11 };
    uint32_t spared = 0;

    for (int k = 0; k < 14; k++) {
        const double what = rng_next(&r);
        if (what < 0.7)
            dim(f, (uint32_t)(rng_next(&r) * SKY), 6, 0.8f + 0.4f * (float)rng_next(&r));
        else
            sky_paint(&f->painted, SKY / 3, SKY / 8, 1e3f + 4e3f * (float)rng_next(&r), 3e3f, 2e3f);
        shade_both(f, NULL);
        spared += f->stats.shone == 0;
    }
    assert_true(spared >= 4);
    dim(f, 50, 6, 0.9f);
    shade_both(f, &cancel);
    shade_both(f, NULL);
}

/* One channel of one patch after another, each of them held before: a block that sees it is computed again. */
static void a_change_of_any_channel_is_seen(void **state)
{
    struct frames f = frames_make();
    (void)state;

    for (uint32_t c = 0; c < 3; c++) {
        for (int k = 0; k < 3; k++)
            shade_both(&f, NULL);
        const uint32_t still = f.stats.lit;
        f.painted.rgb[3 * ((SKY / 4 - 2) * SKY + 50) + c] *= 3.0f;
        shade_both(&f, NULL);
        assert_true(f.stats.lit > still);
    }
    frames_finish(&f);
}

/* A cloud far from the sun: no ray is traced, and light from cells is computed where the cloud is seen. The same sky
 * again: nothing is computed but what looks at single texels. Another sun: its light only. */
static void only_what_has_changed_is_computed(void **state)
{
    struct frames f = frames_make();
    const uint32_t packets = f.set->gbuffer->packet_count;
    (void)state;

    shade_both(&f, NULL);
    assert_true(f.stats.shone == packets && f.stats.sun > 0);
    const uint64_t rays = f.stats.rays;
    shade_both(&f, NULL); /* from now on light is kept */
    shade_both(&f, NULL);
    const uint32_t narrow = f.stats.lit;
    assert_true(rays > 0 && f.stats.rays == 0 && f.stats.shone == 0 && narrow > 0 && narrow < packets / 4);
    dim(&f, 50, 2, 0.9f);
    shade_both(&f, NULL);
    assert_true(f.stats.rays == 0 && f.stats.shone == 0 && f.stats.lit > narrow && f.stats.lit < packets);
    for (uint32_t k = 0, marked = 0; k <= packets; k++) {
        if (k == packets)
            assert_true(marked > 0);
        else
            marked += transport_work(f.transport)[k] & TRANSPORT_WORK_CELLS;
    }
    sky_paint(&f.painted, SKY / 3, SKY / 8, 5e3f, 4e3f, 3e3f);
    shade_both(&f, NULL);
    assert_true(f.stats.shone == packets);
    any_changes(&f);
    frames_finish(&f);
}

/* A patch that changes in two frames running is not kept: the same sky again computes it once more, and then not. */
static void light_that_changes_in_every_frame_is_not_kept(void **state)
{
    struct frames f = frames_make();
    uint32_t lit[5];
    (void)state;

    for (int k = 0; k < 3; k++)
        shade_both(&f, NULL);
    const uint32_t narrow = f.stats.lit;
    for (int k = 0; k < 5; k++) {
        if (k < 2)
            dim(&f, 50, 2, 0.9f);
        shade_both(&f, NULL);
        lit[k] = f.stats.lit;
    }
    assert_true(lit[0] > narrow && lit[1] == lit[0] && lit[2] == lit[0] && lit[3] == narrow && lit[4] == narrow);
    frames_finish(&f);
}

static unsigned work_of_next_frame(struct transport *t)
{
    assert_true(transport_last_begin(t, NULL));
    const unsigned work = transport_last_work(t, 0);
    transport_last_end(t, true);
    return work & TRANSPORT_WORK_SUN;
}

/* The first and the last part of the sun: what is kept of it, and how many parts there are. */
static void a_change_of_any_part_of_the_sun_is_seen(void **state)
{
    struct frames f = frames_make();
    (void)state;

    shade_both(&f, NULL);
    shade_both(&f, NULL);
    struct sun_parts *b = &f.transport->sun.parts;
    assert_true(b->count > 0);
    assert_int_equal(work_of_next_frame(f.transport), 0);
    for (uint32_t k = 0; k < 2; k++) {
        struct sun_part *p = &b->at[k ? b->count - 1 : 0];
        float *const values[] = { &p->weight[0], &p->weight[SUN_TILE - 1], &p->density[3], &p->colour[2], &p->flux[1] };
        for (size_t v = 0; v < sizeof(values) / sizeof(values[0]); v++) {
            *values[v] += 1.0f;
            if (!work_of_next_frame(f.transport))
                fail_msg("change %zu is not seen", v);
            assert_int_equal(work_of_next_frame(f.transport), 0);
        }
        p->key ^= 1;
        assert_true(work_of_next_frame(f.transport));
    }
    b->count--;
    assert_true(work_of_next_frame(f.transport));
    frames_finish(&f);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_change_of_any_part_of_the_sun_is_seen),
    cmocka_unit_test(light_that_changes_in_every_frame_is_not_kept),
    cmocka_unit_test(a_change_of_any_channel_is_seen),
    cmocka_unit_test(only_what_has_changed_is_computed),
};
UNIT_MAIN(tests)
