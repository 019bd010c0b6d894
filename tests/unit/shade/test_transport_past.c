/* Frames of which only what has changed is computed: the same bits as from scratch, and no more computed than is said.
 */
#include "points.h"
#include "relight.h"
#include "transport.h"
#include "transport_parts.h"

#include <math.h>

enum { SKY_WIDTH = 64, SKY_HEIGHT = 32 };

/* Two caches alike, of which one keeps what it can. */
struct stage {
    struct set *set;
    struct gbuffer points;
    const struct gbuffer *gbuffer;
    struct transport *keeps, *fresh;
    float *lo, *want;
    struct environment *sky;
    struct environment_desc sky_desc;
    struct frame picture;
    struct transport_frame frame;
    struct transport_frame_stats stats, all;
};

static void set_up_on(struct stage *s, const struct gbuffer *g, const struct rays *rays)
{
    const struct transport_desc desc = { .seed = 8, .no_visibility = !rays };
    const size_t floats = (size_t)g->packet_count * 3 * PACKET;
    struct reason why = { "" };

    s->gbuffer = g;
    s->sky_desc = (struct environment_desc){ .n = 64, .layout = LAYOUT_LATLONG };
    s->sky = environment_create(&s->sky_desc);
    s->picture = sky_overcast(SKY_WIDTH, SKY_HEIGHT);
    s->frame = (struct transport_frame){ .samples = 64, .seed = 3 };
    s->lo = mem_alloc(floats, sizeof(float));
    s->want = mem_alloc(floats, sizeof(float));
    assert_int_equal(transport_create(g, rays, best_kernels(), &desc, &s->keeps, &why), ERR_OK);
    assert_int_equal(transport_create(g, rays, best_kernels(), &desc, &s->fresh, &why), ERR_OK);
}

static void set_up_court(struct stage *s, bool with_rays)
{
    const struct set_desc desc = { .width = 48, .height = 27 };
    struct reason why = { "" };

    *s = (struct stage){ .set = NULL };
    assert_int_equal(set_create(&desc, &s->set, &why), ERR_OK);
    set_up_on(s, s->set->gbuffer, with_rays ? s->set->rays : NULL);
}

static void tear_down(struct stage *s)
{
    transport_destroy(s->keeps);
    transport_destroy(s->fresh);
    environment_destroy(s->sky);
    frame_finish(&s->picture);
    points_free(&s->points);
    set_destroy(s->set);
    mem_free(s->lo);
    mem_free(s->want);
}

/* A frame of the environment as it is by both, which must be the same to the bit. */
static void shade_both(struct stage *s)
{
    struct transport_frame frame = s->frame;

    assert_int_equal(transport_shade(s->fresh, s->sky, &frame, s->want, &s->all), ERR_OK);
    frame.keep = true;
    assert_int_equal(transport_shade(s->keeps, s->sky, &frame, s->lo, &s->stats), ERR_OK);
    assert_int_equal(s->all.what, TRANSPORT_ALL);
    assert_int_equal(s->all.kept, 0);
    assert_memory_equal(s->lo, s->want, (size_t)s->gbuffer->packet_count * 3 * PACKET * sizeof(float));
}

static void update(struct stage *s)
{
    struct reason why;

    environment_set(s->sky, &s->sky_desc);
    assert_int_equal(environment_update(s->sky, &s->picture, &why), ERR_OK);
}

static void make_frame(struct stage *s)
{
    update(s);
    shade_both(s);
}

static void replace(struct stage *s, struct frame picture)
{
    frame_finish(&s->picture);
    s->picture = picture;
}

/* At the second time but for narrow lobes, at the third all; without a bright part seed, pass and samples have no part
 * in it, with one each of them makes it another frame. */
static void a_sky_that_stands_still_is_not_computed_again(void **state)
{
    struct stage s;
    (void)state;

    set_up_court(&s, true);
    const uint32_t blocks = transport_stats(s.keeps)->blocks;
    for (int sun = 0; sun < 2; sun++) {
        if (sun)
            replace(&s, sky_with_sun(SKY_WIDTH, SKY_HEIGHT, 2e3f));
        for (int k = 0; k < 4; k++) {
            make_frame(&s);
            assert_int_equal(s.stats.what, k ? TRANSPORT_EQUAL : TRANSPORT_ALL);
            assert_true(k > 0 ? s.stats.kept > 0 : s.stats.kept == 0);
            assert_true(k < 2 || (s.stats.kept == blocks && s.stats.rays == 0));
        }
        for (int k = 0; k < 3; k++) {
            s.frame.seed += k == 0;
            s.frame.pass += k == 1;
            s.frame.samples = k == 2 ? 128 : 64;
            make_frame(&s);
            assert_int_equal(s.stats.what, sun ? TRANSPORT_ALL : TRANSPORT_EQUAL);
            assert_int_equal(s.stats.kept, sun ? 0 : blocks);
            assert_true((s.stats.rays > 0) == (sun == 1));
        }
    }
    tear_down(&s);
}

static void take_nothing(void *self)
{
    (void)self;
}

/* Each row gets what the guest has of the frame. */
static void even_rows(const void *self, uint32_t first, struct transport_rows *out)
{
    const struct transport_guest *guest = self;
    (void)first;

    out->count = 1;
    for (uint32_t c = 0; c < 3; c++)
        for (uint32_t p = 0; p < TRANSPORT_POINTS; p++)
            out->at[0][c][p] = guest->values[c];
}

/* What comes from elsewhere may change while the cells do not, or come and go; under a gain it must go with them. */
static void light_from_elsewhere_is_not_kept_when_it_changes(void **state)
{
    float values[3] = { 0.5f, 0.25f, 0.75f };
    struct transport_guest guest = {
        .self = &guest, .taken = take_nothing, .rows = even_rows, .values = values, .count = 3
    };
    static const enum transport_what want[] = { TRANSPORT_ALL, TRANSPORT_EQUAL, TRANSPORT_ALL,  TRANSPORT_EQUAL,
                                                TRANSPORT_ALL, TRANSPORT_ALL,   TRANSPORT_GAIN, TRANSPORT_ALL };
    struct stage s;
    (void)state;

    set_up_court(&s, false);
    for (int k = 0; k < 8; k++) {
        values[1] += k == 2 ? 0.125f : 0.0f;
        s.frame.guest = k == 4 ? NULL : &guest;
        s.sky_desc.scale_stops = k < 6 ? 0.0 : k == 6 ? 1.0 : 2.0;
        for (int c = 0; c < 3; c++) /* with the sky at first, and then not */
            values[c] *= k == 6 ? 2.0f : 1.0f;
        make_frame(&s);
        assert_int_equal(s.stats.what, want[k]);
    }
    tear_down(&s);
}

/* One texel of the picture at a time, anywhere: some blocks see it, and the others are kept. A change of all is one. */
static void few_cells_change_few_blocks(void **state)
{
    struct rng r = { 17 };
    uint64_t kept = 0, frames = 40;
    struct stage s;
    (void)state;

    set_up_court(&s, true);
    const uint32_t blocks = transport_stats(s.keeps)->blocks;
    make_frame(&s);
    for (uint64_t k = 0; k < frames; k++) {
        sky_paint(&s.picture, (uint32_t)(SKY_WIDTH * rng_next(&r)), (uint32_t)(SKY_HEIGHT * rng_next(&r)),
                  (float)rng_next(&r), 0.5f, 0.2f);
        make_frame(&s);
        assert_int_equal(s.stats.what, TRANSPORT_SOME);
        kept += s.stats.kept;
    }
    printf("%.1f of %u blocks were kept\n", (double)kept / (double)frames, blocks);
    assert_true(kept > frames * blocks / 20 && kept < frames * blocks);
    replace(&s, sky_constant(SKY_WIDTH, SKY_HEIGHT, 0.7f));
    make_frame(&s);
    assert_int_equal(s.stats.what, TRANSPORT_ALL);
    tear_down(&s);
}

/* Whole stops are exact, with the sun as well; others round, and are computed. */
static void a_gain_of_whole_stops_is_a_product(void **state)
{
    static const double stops[] = { 1.0, 0.0, -3.0, 4.0, 4.0, 4.5, 3.5, 2.5 };
    struct stage s;
    (void)state;

    set_up_court(&s, true);
    for (int sun = 0; sun < 2; sun++) {
        s.sky_desc.scale_stops = 0.0;
        if (sun)
            replace(&s, sky_with_sun(SKY_WIDTH, SKY_HEIGHT, 2e3f));
        make_frame(&s);
        for (int k = 0; k < 8; k++) {
            s.sky_desc.scale_stops = stops[k];
            make_frame(&s);
            assert_int_equal(s.stats.what, k == 5 ? TRANSPORT_ALL : k == 4 ? TRANSPORT_EQUAL : TRANSPORT_GAIN);
            assert_true(k == 5 ? s.stats.kept == 0 : s.stats.kept > 0);
            assert_true(k == 0 || k > 4 || s.stats.rays == 0);
        }
    }
    tear_down(&s);
}

/* Light so faint or so strong that products leave the range of floats is never multiplied. */
static void gains_near_the_ends_of_floats_are_computed(void **state)
{
    struct stage s;
    (void)state;

    set_up_court(&s, false);
    for (int k = 0; k < 2; k++) {
        replace(&s, sky_constant(SKY_WIDTH, SKY_HEIGHT, k ? 0x1p60f : 0x1p-60f));
        s.sky_desc.scale_stops = 0.0;
        make_frame(&s);
        s.sky_desc.scale_stops = k ? 20.0 : -60.0;
        make_frame(&s);
        assert_int_equal(s.stats.what, TRANSPORT_ALL);
    }
    tear_down(&s);
}

/* Texels across a cell's diagonal, of the same solid angle, change places: the cell's mean stays, and what narrow lobes
 * see there does not. */
static void narrow_lobes_see_texels(void **state)
{
    struct stage s = { .set = NULL };
    (void)state;

    s.points = points_make(64, LOBE_PHONG, 0.3f, 0.5f, 300.0f);
    points_scatter(&s.points, 20);
    set_up_on(&s, &s.points, NULL);
    const size_t bytes = (size_t)s.points.packet_count * 3 * PACKET * sizeof(float);
    const uint32_t n = s.sky_desc.n, blocks = transport_stats(s.keeps)->blocks;
    float *before = mem_alloc(bytes, 1);
    update(&s);
    for (uint32_t face = 0; face < CUBE_FACES; face++) { /* values that sums do not round */
        s.sky->texels[(face * n + 1) * n + 2] = (struct texel){ 0.25f, 0.25f, 0.25f, 0.25f };
        s.sky->texels[(face * n + 2) * n + 1] = (struct texel){ 1.0f, 1.0f, 1.0f, 1.0f };
    }
    for (int k = 0; k < 3; k++)
        shade_both(&s);
    assert_int_equal(s.stats.kept, blocks);
    for (int k = 0; k < 3; k++) {
        memcpy(before, s.lo, bytes);
        for (uint32_t face = 0; k == 0 && face < CUBE_FACES; face++) {
            struct texel *a = &s.sky->texels[(face * n + 1) * n + 2], *b = &s.sky->texels[(face * n + 2) * n + 1];
            const struct texel was = *a;
            *a = *b;
            *b = was;
        }
        shade_both(&s);
        assert_int_equal(s.stats.what, TRANSPORT_EQUAL); /* as far as cells go */
        assert_int_equal(s.stats.kept, k ? blocks : 0);
        assert_int_equal(memcmp(before, s.lo, bytes) == 0, k > 0);
    }
    mem_free(before);
    tear_down(&s);
}

/* Whatever follows upon what: skies that stand, change here and there or as a whole, brighten by gains, suns that rise,
 * move and set, other samples, frames that were broken off, and another picture in between. */
static void any_order_of_changes_gives_the_same_bits(void **state)
{
    const atomic_bool cancel = true;
    uint32_t seen[4] = { 0 };
    struct rng r = { 29 };
    struct stage s;
    (void)state;

    set_up_court(&s, true);
    float *other = mem_alloc((size_t)s.gbuffer->packet_count * 3 * PACKET, sizeof(float));
    for (int k = 0; k < 120; k++) {
        const uint32_t choice = (uint32_t)(12.0 * rng_next(&r));
        struct transport_frame frame = s.frame;
        frame.keep = true;
        if (choice == 0)
            replace(&s, sky_overcast(SKY_WIDTH, SKY_HEIGHT));
        if (choice == 1 || choice == 2)
            sky_paint(&s.picture, (uint32_t)(SKY_WIDTH * rng_next(&r)), 9, choice == 1 ? 3e3f : 0.4f, 0.3f, 0.2f);
        if (choice == 3 || choice == 4)
            s.sky_desc.scale_stops = floor(6.0 * rng_next(&r)) - 3.0;
        if (choice == 5)
            s.sky_desc.rotation_degrees = 360.0 * rng_next(&r);
        if (choice == 6)
            s.frame.samples = rng_next(&r) < 0.5 ? 32 : 96;
        if (choice == 7)
            s.frame.pass++;
        update(&s);
        if (choice == 8) { /* the new sky, into another picture */
            sky_paint(&s.picture, 3, 5, 0.9f, 0.1f, 0.01f * (float)k);
            update(&s);
            assert_int_equal(transport_shade(s.keeps, s.sky, &frame, other, &s.stats), ERR_OK);
        }
        if (choice == 9) {
            sky_paint(&s.picture, 40, 7, 0.2f, 0.3f, 0.01f * (float)k);
            update(&s);
            frame.cancel = &cancel;
            assert_int_equal(transport_shade(s.keeps, s.sky, &frame, s.lo, &s.stats), ERR_OK);
        }
        shade_both(&s);
        seen[s.stats.what]++;
    }
    for (int k = 0; k < 4; k++) {
        printf("%u times %s\n", seen[k], transport_what_name((enum transport_what)k));
        assert_true(seen[k] >= 5);
    }
    mem_free(other);
    tear_down(&s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_sky_that_stands_still_is_not_computed_again),
    cmocka_unit_test(light_from_elsewhere_is_not_kept_when_it_changes),
    cmocka_unit_test(few_cells_change_few_blocks),
    cmocka_unit_test(a_gain_of_whole_stops_is_a_product),
    cmocka_unit_test(gains_near_the_ends_of_floats_are_computed),
    cmocka_unit_test(narrow_lobes_see_texels),
    cmocka_unit_test(any_order_of_changes_gives_the_same_bits),
};
UNIT_MAIN(tests)
