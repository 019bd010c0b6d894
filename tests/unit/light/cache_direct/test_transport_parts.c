/* The steps of the cache of direct light, each by itself, on numbers worked out by hand. */
#include "base/mem.h"
#include "light/cache/cache_share.h"
#include "light/cache_direct/live.h"
#include "light/cache_direct/internal.h"
#include "light/cache_direct/transports.h"
#include "light/estimators/points.h"
#include "support/skies.h"

#include <math.h>

#include "support/unit.h"

static void assert_near(double got, double want, double allowed)
{
    if (!(fabs(got - want) <= allowed))
        fail_msg("%.9g, want %.9g within %.2g", got, want, allowed);
}

/* ---- Weights of errors ---- */

/* 32 points of a matte row of colour 0.6, whose light under an even sky, a quarter of it from the first cell and the
 * rest from the last, sums to 1, and of a glossy one of colour 0.2 and 2: their light is 0.6 + 0.4 = 1. Point 30 has
 * 0.0006, point 31 none, which is less than 0.03 of the mean, 30.0006 / 32; there an error of the matte row weighs the
 * most, by 0.6 / (0.03 * mean), and everywhere else 0.03 * mean of that. */
static void an_error_weighs_by_the_light_of_its_point(void **state)
{
    const struct transport_block block = { .first = 1, .packets = 2, .rows = 2 };
    struct transport_matrix *m = mem_alloc(2, sizeof(*m));
    struct shade_packet *packets = mem_alloc(3, sizeof(*packets));
    const struct gbuffer g = { .packets = packets, .packet_count = 3 };
    static float scale[TRANSPORT_ROWS][TRANSPORT_POINTS];
    const double least = 0.03 * 30.0006 / 32.0;
    (void)state;

    for (uint32_t p = 0; p < 2 * PACKET; p++) {
        struct shade_packet *at = &packets[1 + p / PACKET];
        for (int c = 0; c < 3; c++) {
            at->diffuse[c][p % PACKET] = 0.3f * (float)(c + 1);
            at->specular[c][p % PACKET] = p == 3 ? 1e-6f : 0.1f * (float)(c + 1);
        }
        m[0].at[0][p] = p < 15 ? 0.25f : 0.0f;
        m[0].at[SKY_CELLS - 1][p] = p < 15 ? 0.75f : p < 30 ? 1.0f : p == 30 ? 0.001f : 0.0f;
        m[1].at[7][p] = p < 30 && p != 3 ? 2.0f : 0.0f;
    }
    m[1].at[7][3] = 4e5f;         /* times 1e-6 */
    for (int k = 0; k < 2; k++) { /* a hundred times as bright it is the same */
        transport_scales(&g, &block, m, scale);
        for (uint32_t p = 0; p < 2 * PACKET; p++) {
            assert_near((double)scale[0][p], p < 30 ? least : 1.0, 1e-6);
            assert_near((double)scale[1][p], p == 3 ? 1e-3 : (p < 30 ? least : 1.0) / 3.0, 1e-6);
        }
        for (uint32_t c = 0; c < SKY_CELLS; c++)
            for (uint32_t p = 0; p < 2 * PACKET; p++) {
                m[0].at[c][p] *= 100.0f;
                m[1].at[c][p] *= 100.0f;
            }
    }
    memset(m, 0, 2 * sizeof(*m));
    transport_scales(&g, &block, m, scale);
    for (uint32_t p = 0; p < 2 * PACKET; p++)
        assert_true(scale[0][p] == 1.0f && scale[1][p] == 1.0f);
    mem_free(packets);
    mem_free(m);
}

/* ---- Directions ---- */

/* Each of a cell's 4 x 4 directions lies in its own sixteenth of the cell, is of unit length and weighs, relative to
 * the others, what a piece of the cube's side does there, (1 + u^2 + v^2)^-1.5; together they weigh the cell's solid
 * angle. The same for 2 x 2 directions of 2 x 2 cells. */
static void directions_fill_their_cells(void **state)
{
    (void)state;

    for (uint32_t edge = 1; edge <= 2; edge++) {
        const uint32_t side = edge == 1 ? 4 : 2, each = side * side, along = SKY_EDGE / edge;
        struct transport_directions d;
        double all = 0.0;
        assert_int_equal(transport_directions_init(&d, side, edge, 11), ERR_OK);
        for (uint32_t at = 0; at < CUBE_FACES * along * along; at++) {
            const uint32_t face = at / (along * along), i = at / along % along, j = at % along;
            const uint32_t cell = sky_cell(face, i * edge, j * edge), first = cell / (edge * edge) * each;
            double sum = 0.0, want = 0.0, same[2] = { INFINITY, 0.0 };
            for (uint32_t k = 0; k < each; k++) {
                const float w[3] = { d.x[first + k], d.y[first + k], d.z[first + k] };
                float u, v;
                assert_near((double)(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]), 1.0, 1e-5);
                assert_int_equal(cube_locate(w, &u, &v), face);
                const double column = ((double)u + 1.0) * along * side / 2.0 - j * side,
                             row = ((double)v + 1.0) * along * side / 2.0 - i * side;
                assert_true(column > k % side - 1e-4 && column < k % side + 1 + 1e-4);
                assert_true(row > k / side - 1e-4 && row < k / side + 1 + 1e-4);
                const double flat = (double)d.weight[first + k] * pow(1.0 + (double)(u * u + v * v), 1.5);
                sum += (double)d.weight[first + k];
                same[0] = fmin(same[0], flat);
                same[1] = fmax(same[1], flat);
            }
            assert_near(same[1] / same[0], 1.0, 1e-4);
            for (uint32_t k = 0; k < edge * edge; k++)
                want += sky_cell_solid_angle(cell + k);
            assert_near(sum / want, 1.0, 1e-5);
            all += sum;
        }
        assert_near(all / (4.0 * PI), 1.0, 1e-5);
        transport_directions_finish(&d);
    }
}

/* ---- Bytes ---- */

/* Five rows over three chunks of 16 cells, and 32 points: as bytes with 16 gains of 4 bytes, then 5 * 48 of V and two
 * bytes for each of 5 * 32 of U; as halves without gains; raw without U. */
static void a_piece_has_the_bytes_of_its_form(void **state)
{
    struct transport_piece q = { .shape = { .rank = 5, .chunk_count = 3, .form = TRANSPORT_BYTES } };
    (void)state;

    assert_int_equal(transport_head(&q.shape), 64 + 240);
    assert_int_equal(transport_piece_bytes(&q, 32), 64 + 240 + 320);
    q.shape.form = TRANSPORT_HALVES;
    assert_int_equal(transport_head(&q.shape), 480);
    assert_int_equal(transport_piece_bytes(&q, 32), 480 + 320);
    q.shape.form = TRANSPORT_RAW;
    assert_int_equal(transport_piece_bytes(&q, 32), 480);
}

/* Every number of a piece is looked at, and none behind it. */
static void a_piece_with_a_number_that_is_none_is_not_sound(void **state)
{
    static _Alignas(64) uint8_t bytes[2000];
    struct transport_piece q = { .shape = { .rank = 5, .chunk_count = 3 }, .bytes = bytes };
    const uint16_t none = 0x7c00; /* infinity */
    const float gains[3] = { -1.0f, 1e6f, NAN };
    (void)state;

    for (int form = TRANSPORT_HALVES; form <= TRANSPORT_BYTES; form++) {
        q.shape.form = (uint8_t)form;
        const size_t size = (size_t)transport_piece_bytes(&q, 32), gained = form == TRANSPORT_BYTES ? 64 : 0;
        const size_t any = form == TRANSPORT_BYTES ? 240 : 0; /* of V, with any value */
        for (size_t at = gained; at <= size; at += 2) {
            memset(bytes, 0, sizeof(bytes));
            memcpy(bytes + at, &none, sizeof(none));
            assert_int_equal(transport_is_sound(&q, size), at < gained + any || at == size);
        }
        for (size_t at = 0; at < gained; at += 4)
            for (int k = 0; k < 3; k++) {
                memset(bytes, 0, sizeof(bytes));
                memcpy(bytes + at, &gains[k], sizeof(gains[k]));
                assert_false(transport_is_sound(&q, size));
            }
    }
}

static struct transport *of_packets(struct gbuffer *g, uint32_t count)
{
    static struct shade_packet packets[80];
    const struct transport_desc desc = { .no_visibility = true };

    for (uint32_t k = 0; k < count; k++)
        packets[k] = (struct shade_packet){ .count = PACKET };
    *g = (struct gbuffer){ .packets = packets, .packet_count = count };
    struct transport *t = transport_begin(g, NULL, best_kernels(), &desc);
    assert_non_null(t);
    assert_int_equal(t->block_count, count / TRANSPORT_PACKETS);
    return t;
}

static void a_block_is_counted_with_its_pieces(void **state)
{
    struct gbuffer g;
    struct transport *t = of_packets(&g, 8);
    struct transport_block *b = &t->blocks[0];
    (void)state;

    const struct transport_stats before = t->stats;
    b->pieces[0].shape = (struct transport_shape){ .rank = 5, .chunk_count = 3, .form = TRANSPORT_BYTES };
    b->rows = 1;
    transport_count_block(t, b);
    assert_int_equal(t->stats.bytes - before.bytes, 64 + 240 + 5 * 64 * 2);
    assert_int_equal(t->stats.dense - before.dense, 64 * SKY_CELLS * 2);
    assert_int_equal(t->stats.rank - before.rank, 5);
    assert_int_equal(t->stats.pieces - before.pieces, 1);
    transport_destroy(t);
}

/* ---- A frame ---- */

/* Under a sky of 1 with one texel of 1e5, of solid angle 2 pi / 64 (cos 8 pi / 32 - cos 9 pi / 32), the sun's share of
 * all light is 714 of 714 + 4 pi, whatever the unit. An even sky has none. */
static void the_suns_share_is_that_of_all_light(void **state)
{
    const double sun = 1e5 * 2.0 * PI / 64.0 * (cos(8.0 * PI / 32.0) - cos(9.0 * PI / 32.0));
    struct gbuffer g = points_make(4, LOBE_LAMBERT, 0.6f, 0.0f, 0.0f);
    struct transport *t = transport_of(&g, NULL, &(struct transport_desc){ .no_visibility = true, .per_cell = 1 });
    float *lo = mem_alloc((size_t)g.packet_count * 3 * PACKET, sizeof(*lo));
    (void)state;

    for (int k = 0; k < 3; k++) {
        const float unit = k == 1 ? 1e-3f : 1.0f;
        struct frame f = sky_constant(64, 32, unit);
        if (k < 2)
            sky_paint(&f, 10, 8, 1e5f * unit, 1e5f * unit, 1e5f * unit);
        struct environment *e = sky_environment(f, 32, 0.0);
        const struct transport_frame frame = { .end = 0 };
        struct transport_frame_stats stats;
        assert_int_equal(transport_shade(t, e, &frame, lo, &stats), ERR_OK);
        printf("share %.4f\n", stats.share);
        assert_near(stats.share, k < 2 ? sun / (sun + 4.0 * PI) : 0.0, 0.01);
        assert_true((stats.sun > 0) == (k < 2));
        environment_destroy(e);
    }
    mem_free(lo);
    transport_destroy(t);
    points_free(&g);
}

static void a_builder_waits_for_what_will_be_freed(void **state)
{
    (void)state;

    assert_false(transport_live_waits(100, 100, 90)); /* there is room */
    assert_true(transport_live_waits(100, 101, 90));
    assert_true(transport_live_waits(100, 101, 100));
    assert_false(transport_live_waits(100, 102, 101));   /* no waiting will help */
    assert_false(transport_will_exceed(100, 30, 3, 10)); /* just enough */
    assert_true(transport_will_exceed(99, 30, 3, 10));
    assert_true(transport_will_exceed(100, 31, 3, 10));
}

/* ---- Processes ---- */

/* Of 16 blocks of four packets, of which the second has narrow lobes: who computes packets 8 to 15 needs the blocks
 * that begin there. The first process keeps the narrow one too while there are few: four times as many packets in each
 * of the parts, 4 * 4 * 4 of 64, but not in five parts. */
static void a_process_keeps_what_its_packets_need(void **state)
{
    struct gbuffer g;
    struct transport *t = of_packets(&g, 64);
    (void)state;

    t->blocks[1].narrow = true;
    t->narrow.count = 4;
    for (uint32_t count = 4; count <= 5; count++)
        for (uint32_t index = 0; index < 2; index++) {
            const struct cache_share s = { .index = index, .count = count, .first = 8, .end = 16 };
            assert_int_equal(transport_narrow_is_few(t, count), count == 4);
            for (uint32_t packet = 0; packet < 64; packet += 4)
                assert_int_equal(transport_keeps(t, &s, packet),
                                 packet == 8 || packet == 12 || (packet == 4 && index == 0 && count == 4));
        }
    assert_true(transport_keeps(t, NULL, 60));
    assert_true(transport_keeps(t, &(struct cache_share){ .count = 4 }, 60)); /* which computes all */
    t->narrow.count = 0;
    transport_destroy(t);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(an_error_weighs_by_the_light_of_its_point),
    cmocka_unit_test(directions_fill_their_cells),
    cmocka_unit_test(a_piece_has_the_bytes_of_its_form),
    cmocka_unit_test(a_piece_with_a_number_that_is_none_is_not_sound),
    cmocka_unit_test(a_block_is_counted_with_its_pieces),
    cmocka_unit_test(the_suns_share_is_that_of_all_light),
    cmocka_unit_test(a_builder_waits_for_what_will_be_freed),
    cmocka_unit_test(a_process_keeps_what_its_packets_need),
};
UNIT_MAIN(tests)
