/* The steps of the cache of indirect light, each by itself, on numbers worked out by hand. */
#include "base/mem.h"
#include "base/rng.h"
#include "light/cache_indirect/internal.h"
#include "light/estimators/levels.h"

#include <math.h>
#include <string.h>

#include "support/unit.h"

static float some(struct rng *r)
{
    return (float)(2.0 * rng_next(r) - 1.0);
}

static void fill(struct rng *r, float *out, size_t count)
{
    for (size_t i = 0; i < count; i++)
        out[i] = some(r);
}

static void assert_near(double got, double want, double allowed)
{
    if (!(fabs(got - want) <= allowed))
        fail_msg("%.9g, want %.9g within %.2g", got, want, allowed);
}

/* ---- Kernels: each level against plain sums of doubles ---- */

static void a_weighted_row_is_added_by_colours(void **state)
{
    enum { WIDE = 48 };
    const float weight[3] = { 0.5f, -2.0f, 3.0f };
    (void)state;

    for (const struct kernels *const *k = kernels_all(); *k; k++) {
        float to[3 * WIDE + 1], from[3 * WIDE];
        for (int i = 0; i < 3 * WIDE; i++) {
            to[i] = 100.0f + (float)i;
            from[i] = (float)(i % 7);
        }
        to[3 * WIDE] = 7.0f;
        indirect_kernels_of(*k)->add(to, from, weight, WIDE);
        for (int i = 0; i < 3 * WIDE; i++)
            assert_true(to[i] == 100.0f + (float)i + weight[i / WIDE] * (float)(i % 7));
        assert_true(to[3 * WIDE] == 7.0f);
    }
}

static void coefficients_are_the_products_of_rows_and_sky(void **state)
{
    enum { COUNT = 7 }; /* four rows at a time, and three */
    static float rows[COUNT * SKY_CELLS], sky[3][SKY_CELLS];
    const struct indirect_basis q = { .count = COUNT, .rows = rows };
    struct rng r = { 3 };
    (void)state;

    fill(&r, rows, COUNT * SKY_CELLS);
    fill(&r, sky[0], 3 * SKY_CELLS);
    for (const struct kernels *const *k = kernels_all(); *k; k++) {
        float y[3 * COUNT];
        indirect_kernels_of(*k)->take(&q, sky, y);
        for (int c = 0; c < 3; c++)
            for (int i = 0; i < COUNT; i++) {
                double want = 0.0;
                for (int cell = 0; cell < SKY_CELLS; cell++)
                    want += (double)rows[i * SKY_CELLS + cell] * (double)sky[c][cell];
                assert_near((double)y[c * COUNT + i], want, 1e-4);
            }
    }
}

/* z = V y, where V has 18 rows of three colours, 32 of whose 48 coefficients are in use; out = U gain W z. */
static void bytes_are_multiplied_with_the_sky(void **state)
{
    enum { RANK = 18, USED = 32, BASIS = 48, COLUMNS = 32, OWN = 5, POINTS = 32 };
    static int8_t v[RANK][3][USED], block[OWN * (sizeof(float) + COLUMNS + POINTS)];
    int8_t(*w)[COLUMNS] = (int8_t(*)[COLUMNS])(block + OWN * sizeof(float));
    int8_t(*u)[POINTS] = (int8_t(*)[POINTS])(block + OWN * (sizeof(float) + COLUMNS));
    const struct indirect_piece piece = { .bytes = v[0][0], .rank = RANK, .basis = USED };
    float y[3 * BASIS], gain[OWN];
    struct rng r = { 4 };
    (void)state;

    assert_int_equal(indirect_columns(RANK), COLUMNS);
    fill(&r, y, 3 * BASIS);
    fill(&r, gain, OWN);
    memcpy(block, gain, sizeof(gain));
    for (int i = 0; i < RANK * 3 * USED; i++)
        v[i / USED / 3][i / USED % 3][i % USED] = (int8_t)(127.0f * some(&r));
    for (size_t i = sizeof(gain); i < sizeof(block); i++)
        block[i] = (int8_t)(127.0f * some(&r));
    for (const struct kernels *const *k = kernels_all(); *k; k++) {
        _Alignas(64) float z[3][COLUMNS], out[3][TRANSPORT_POINTS];
        memset(z, 0x7f, sizeof(z));
        indirect_kernels_of(*k)->project(&piece, y, BASIS, z[0]);
        indirect_kernels_of(*k)->expand(block, OWN, z[0], COLUMNS, POINTS, out);
        for (int c = 0; c < 3; c++) {
            for (int i = 0; i < COLUMNS; i++) {
                double want = 0.0;
                for (int n = 0; i < RANK && n < USED; n++)
                    want += v[i][c][n] * (double)y[c * BASIS + n];
                assert_near((double)z[c][i], want, 1e-2);
            }
            for (int p = 0; p < POINTS; p++) {
                double want = 0.0, size = 0.0;
                for (int m = 0; m < OWN; m++)
                    for (int i = 0; i < RANK; i++) {
                        const double part = u[m][p] * (double)gain[m] * w[m][i] * (double)z[c][i];
                        want += part;
                        size += fabs(part);
                    }
                assert_near((double)out[c][p], want, 1e-5 * size);
            }
        }
    }
}

/* ---- Smoothing ---- */

enum { BLOCKS = 4, ALL = BLOCKS * TRANSPORT_POINTS, WIDE = 3 };

/* Points on a plane, 64 a block, all alike facing up; none used yet. */
static struct indirect_smoother *plane(void)
{
    struct indirect_smoother *s = indirect_smoother_create();

    assert_non_null(s);
    for (uint32_t p = 0; p < ALL; p++) {
        s->at[0][p] = 100.0f; /* far from all others */
        s->normal[1][p] = s->near[p] = 1.0f;
    }
    return s;
}

static void put(struct indirect_smoother *s, uint32_t p, float x, float z)
{
    s->used[p] = true;
    s->at[0][p] = x;
    s->at[2][p] = z;
}

/* Three points in a row, 0.06 m apart, where what is around is 1 m away: the outer ones weigh 1 - 0.06 / 0.3 = 0.8 for
 * the middle one, which becomes (1 * 5 + 0.8 * 2 + 0.8 * 11) / 2.6; the plane through them adds nothing at their
 * centre. What is around nearer by one of two, 0.5 m away, makes its weight 1 - 0.12 / 0.3 = 0.6. */
static void a_point_is_averaged_by_its_neighbours_likeness(void **state)
{
    static float from[ALL][WIDE], to[ALL][WIDE];
    struct indirect_smoother *s = plane();
    (void)state;

    put(s, 10, 0.0f, 0.0f);
    put(s, 11, -0.06f, 0.0f);
    put(s, 70, 0.06f, 0.0f); /* of the next block */
    put(s, 200, 30.0f, 0.0f);
    for (int c = 0; c < WIDE; c++) {
        from[10][c] = (float)(c + 1) * 5.0f;
        from[11][c] = (float)(c + 1) * 2.0f;
        from[70][c] = (float)(c + 1) * 11.0f;
        from[12][c] = 1e9f; /* not used */
        from[200][c] = 8.0f;
    }
    indirect_smooth(s, BLOCKS, INDIRECT_GROUP, WIDE, from[0], to[0]);
    for (int c = 0; c < WIDE; c++) {
        assert_near((double)to[10][c], (c + 1) * (5.0 + 0.8 * 2.0 + 0.8 * 11.0) / 2.6, 1e-4);
        assert_near((double)to[200][c], 8.0, 1e-5); /* alone it stays what it is */
        assert_true(to[12][c] == 0.0f);
    }
    assert_near((double)indirect_alike(s, BLOCKS, INDIRECT_GROUP, 10), 1.0 + 4.0 * 0.8,
                1e-5); /* 10, and of a quarter of the others 70 */
    s->near[70] = 0.5f;
    assert_near((double)indirect_alike(s, BLOCKS, INDIRECT_GROUP, 10), 1.0 + 4.0 * 0.6, 1e-5);
    s->near[70] = 1.0f;
    s->normal[1][70] = 0.99f; /* 0.1 less for 1 - cos = 0.01 */
    s->normal[0][70] = 0.1410674f;
    assert_near((double)indirect_alike(s, BLOCKS, INDIRECT_GROUP, 10), 1.0 + 4.0 * (1.0 - 0.16 / 0.3), 1e-4);
    assert_near((double)indirect_alike(s, BLOCKS, 0, 10), 1.0, 1e-6); /* the next block is out of reach */
    indirect_smoother_destroy(s);
}

/* Light that is linear along the plane stays as it is, up to the thousandth of the spread that steadies the fit, also
 * at the ends, where all others are on one side; another block's too, within reach and without. */
static void a_gradient_stays_as_it_is(void **state)
{
    static float from[ALL][WIDE], to[ALL][WIDE];
    struct indirect_smoother *s = plane();
    double mean = 0.0;
    (void)state;

    for (uint32_t p = 0; p < ALL; p++) {
        const float x = 0.005f * (float)(p / 16), z = 0.01f * (float)(p % 16);
        put(s, p, x, z);
        for (int c = 0; c < WIDE; c++)
            from[p][c] = (float)(c + 1) + 10.0f * x - 20.0f * z;
        mean += (double)from[p][0] / ALL;
    }
    for (uint32_t reach = 0; reach < 3; reach++) {
        memset(to, 0x7f, sizeof(to));
        indirect_smooth(s, BLOCKS, reach, WIDE, from[0], to[0]);
        for (uint32_t p = 0; p < ALL; p++)
            for (int c = 0; c < WIDE; c++)
                assert_near((double)to[p][c], (double)from[p][c], 0.02);
    }
    assert_true(fabs((double)from[0][0] - mean) > 1.0); /* the mean would be far off */
    indirect_smoother_destroy(s);
}

/* ---- Compression ---- */

enum { K = 32, ROW = 3 * K, SLOTS = 3, PACKETS = 4 };

struct group {
    struct indirect_group group;
    struct indirect_block blocks[SLOTS];
    float t[SLOTS][TRANSPORT_POINTS][ROW], scale[TRANSPORT_POINTS];
};

/* Blocks of 64, 32 and 64 points, whose rows are combinations of `rank` common ones, of which the second block has one
 * alone; coefficients fall off behind the 16th, so that V needs no more where `narrow`. */
static void group_make(struct group *g, uint32_t rank, bool narrow)
{
    struct rng r = { 9 };
    float common[8 * ROW];

    memset(g, 0, sizeof(*g));
    g->group = (struct indirect_group){ .count = SLOTS, .rows = 1 };
    fill(&r, common, 8 * ROW);
    for (uint32_t i = 0; narrow && i < 8 * ROW; i++)
        if (i % K >= 16)
            common[i] = 0.0f;
    for (uint32_t p = 0; p < TRANSPORT_POINTS; p++)
        g->scale[p] = 0.5f + (float)(p % 3);
    for (uint32_t b = 0; b < SLOTS; b++) {
        g->blocks[b] = (struct indirect_block){ .first = b * PACKETS, .packets = b == 1 ? 2 : PACKETS, .rows = 1 };
        for (uint32_t p = 0; p < g->blocks[b].packets * PACKET; p++)
            for (uint32_t k = 0; k < (b == 1 ? 1 : rank); k++) {
                const float u = some(&r);
                for (uint32_t i = 0; i < ROW; i++)
                    g->t[b][p][i] += u * common[k * ROW + i];
            }
    }
}

static void group_compress(struct group *g, double least)
{
    static float t[TRANSPORT_POINTS][ROW];
    struct indirect_workspace *w = indirect_workspace_create(K);

    assert_non_null(w);
    indirect_compress_begin(w);
    for (uint32_t b = 0; b < SLOTS; b++) {
        memcpy(t, g->t[b], sizeof(t));
        indirect_compress_block(w, b, 0, g->blocks[b].packets * PACKET, t[0], g->scale, least);
    }
    assert_int_equal(indirect_compress_end(w, &g->group, g->blocks, 0, least), ERR_OK);
    indirect_workspace_destroy(w);
}

/* The rank and the coefficients in use are those of the matrix; the product with a sky is that of the matrix, up to
 * what bytes of V, W and U lose. */
static void rows_in_common_are_stored_once(void **state)
{
    static struct group g;
    static float y[3 * K];
    struct rng r = { 21 };
    (void)state;

    fill(&r, y, 3 * K);
    for (int narrow = 0; narrow < 2; narrow++) {
        const struct indirect_kernels *kernels = indirect_kernels_of(kernels_all()[0]);
        _Alignas(64) float z[3][16], out[3][TRANSPORT_POINTS];
        group_make(&g, 5, narrow);
        group_compress(&g, 1e-2); /* of some 100 that a point has */
        const struct indirect_piece *q = &g.group.pieces[0];
        assert_int_equal(q->rank, 5);
        assert_int_equal(q->basis, narrow ? 16 : 32);
        kernels->project(q, y, K, z[0]);
        const int8_t *at = q->bytes + q->rank * 3 * q->basis;
        for (uint32_t b = 0; b < SLOTS; b++) {
            const uint32_t points = g.blocks[b].packets * PACKET;
            assert_int_equal(g.blocks[b].rank[0], b == 1 ? 1 : 5);
            kernels->expand(at, g.blocks[b].rank[0], z[0], 16, points, out);
            at += indirect_block_bytes(g.blocks[b].rank[0], 16, points);
            for (uint32_t c = 0; c < 3; c++) {
                double wrong = 0.0, whole = 0.0;
                for (uint32_t p = 0; p < points; p++) {
                    double want = 0.0;
                    for (uint32_t i = 0; i < K; i++) {
                        const double x = (double)g.t[b][p][c * K + i];
                        want += x * (double)y[c * K + i];
                        whole += x * x / 3.0; /* what is to be expected of random y */
                    }
                    wrong += pow((double)out[c][p] - want, 2.0);
                }
                assert_near(sqrt(wrong / whole), 0.0, 0.02);
            }
        }
        mem_free(g.group.pieces[0].bytes);
    }
}

/* A rank is left out where it brings less than is asked of it, and with the last of them everything. */
static void what_brings_too_little_is_left_out(void **state)
{
    static struct group g;
    double whole = 0.0;
    (void)state;

    group_make(&g, 1, false);
    for (uint32_t b = 0; b < SLOTS; b++)
        for (uint32_t p = 0; p < g.blocks[b].packets * PACKET; p++)
            for (uint32_t i = 0; i < ROW; i++)
                whole += pow((double)(g.t[b][p][i] * g.scale[p]), 2.0);
    const double points = 10 * PACKET;
    for (int k = 0; k < 2; k++) { /* the group keeps what brings 0.4 of `least` a point */
        group_compress(&g, (k ? 1.03 : 0.97) * whole / points / 0.4);
        assert_int_equal(g.group.pieces[0].rank, k ? 0 : 1);
        assert_true((g.group.pieces[0].bytes == NULL) == k);
        mem_free(g.group.pieces[0].bytes);
    }
}

/* Of sixteen blocks, points of the last see other light than all the rest. Their row brings less than the group asks of
 * a rank, 0.4 a point of all, but it is kept if it brings 2 a point of their block: for sixteen points, not for two. */
static void what_one_block_would_miss_is_kept(void **state)
{
    static float t[TRANSPORT_POINTS][ROW], scale[TRANSPORT_POINTS];
    const double least = 1e-2;
    const struct {
        uint32_t points, rank;
        double each;
    } cases[] = { { 16, 2, 8.1 }, { 16, 1, 7.9 }, { 2, 1, 80.0 } };
    (void)state;

    for (uint32_t p = 0; p < TRANSPORT_POINTS; p++)
        scale[p] = 1.0f;
    for (size_t k = 0; k < sizeof(cases) / sizeof(cases[0]); k++) {
        struct indirect_block blocks[INDIRECT_GROUP] = { { .first = 0 } };
        struct indirect_group g = { .count = INDIRECT_GROUP, .rows = 1 };
        struct indirect_workspace *w = indirect_workspace_create(K);
        assert_non_null(w);
        assert_true(cases[k].points * cases[k].each < 0.4 * INDIRECT_GROUP * TRANSPORT_POINTS);
        indirect_compress_begin(w);
        for (uint32_t b = 0; b < INDIRECT_GROUP; b++) {
            blocks[b] = (struct indirect_block){ .first = b * PACKETS, .packets = PACKETS, .rows = 1 };
            memset(t, 0, sizeof(t));
            for (uint32_t p = 0; p < TRANSPORT_POINTS; p++) {
                const bool other = b == INDIRECT_GROUP - 1 && p < cases[k].points;
                t[p][other] = (float)sqrt(other ? cases[k].each * least : 1.0);
            }
            indirect_compress_block(w, b, 0, TRANSPORT_POINTS, t[0], scale, least);
        }
        assert_int_equal(indirect_compress_end(w, &g, blocks, 0, least), ERR_OK);
        assert_int_equal(g.pieces[0].rank, cases[k].rank);
        for (uint32_t b = 0; b < INDIRECT_GROUP; b++)
            assert_int_equal(blocks[b].rank[0], b == INDIRECT_GROUP - 1 ? cases[k].rank : 1);
        mem_free(g.pieces[0].bytes);
        indirect_workspace_destroy(w);
    }
}

/* ---- The basis ---- */

/* Two orthogonal rows of squared length 9 and 1, each twice: eigenvalues 18 and 2, in this order, and nothing else. */
static void the_basis_is_that_of_the_rows(void **state)
{
    static float m[4][SKY_CELLS];
    struct indirect_basis b;
    (void)state;

    for (int i = 0; i < 4; i++)
        m[i][i % 2 ? 700 : 5] = i % 2 ? -1.0f : 3.0f;
    assert_int_equal(indirect_basis_init(&b, m[0], 4, 32), ERR_OK);
    assert_int_equal(b.count, 16); /* the first 16 leave out nothing */
    assert_near(b.rest, 0.0, 2e-3);
    assert_near(fabs((double)b.rows[5]), 1.0, 1e-5);
    assert_near(fabs((double)b.rows[SKY_CELLS + 700]), 1.0, 1e-5);
    for (uint32_t i = 0; i < 16; i++)
        for (uint32_t j = 0; j <= i; j++) {
            double product = 0.0;
            for (uint32_t c = 0; c < SKY_CELLS; c++)
                product += (double)b.rows[i * SKY_CELLS + c] * (double)b.rows[j * SKY_CELLS + c];
            assert_near(product, i == j, 1e-4);
        }
    indirect_basis_finish(&b);
    assert_null(b.rows);
}

/* 40 rows of equal length and orthogonal: any 32 of the basis leave out 8 of 40. */
static void the_basis_says_what_it_leaves_out(void **state)
{
    static float m[40][SKY_CELLS];
    struct indirect_basis b;
    (void)state;

    for (int i = 0; i < 40; i++)
        m[i][i * 20] = 2.0f;
    assert_int_equal(indirect_basis_init(&b, m[0], 40, 32), ERR_OK);
    assert_int_equal(b.count, 32);
    assert_near(b.rest, sqrt(8.0 / 40.0), 1e-4);
    indirect_basis_finish(&b);
}

/* ---- The light of records ---- */

/* Of a cell's 4 x 4 directions the four lanes that look through it take one of each quarter, in every turn, and over
 * the turns all equally often: a sixteenth of 4 a turn. */
static void a_cells_directions_are_taken_equally_often(void **state)
{
    enum { TURNS = 4000, FIRST = 40 };
    static uint32_t taken[4][PACKET];
    (void)state;

    for (uint32_t i = 0; i < TURNS; i++) {
        uint32_t quarters[4] = { 0 };
        for (uint32_t l = 0; l < PACKET; l++) {
            uint32_t which;
            const uint32_t at = indirect_direction(FIRST, rng_mix(i, 5), l, &which) - FIRST * PACKET;
            assert_true(which / 2 == l / INDIRECT_SPOTS && at / PACKET == which);
            taken[which][at % PACKET]++;
            quarters[which] |= 1u << (at % PACKET / 8 * 2 + at % INDIRECT_SIDE / 2);
        }
        for (int k = 0; k < 4; k++)
            assert_int_equal(quarters[k], 15);
    }
    for (int k = 0; k < 4; k++)
        for (int i = 0; i < PACKET; i++)
            assert_near(taken[k][i], TURNS / 4.0, 6.0 * sqrt(TURNS * 3.0 / 16.0));
}

/* ---- Statistics ---- */

/* Blocks of 64 and 32 points, of ranks 2 and 1 within a group's 3, by a basis of 16: 3 x 3 x 16 bytes of V, and for
 * each of a block's ranks a gain, 16 bytes of W and one of U for each point. Behind the last group stands one that is
 * none. */
static void what_is_stored_is_counted(void **state)
{
    const struct gbuffer g = { .packet_count = 8 };
    struct indirect_cache *b = mem_alloc(1, sizeof(*b));
    (void)state;

    *b = (struct indirect_cache){ .gbuffer = &g, .kernels = kernels_all()[0], .block_count = 2, .group_count = 1 };
    b->basis.count = 16;
    b->blocks = mem_alloc(2, sizeof(*b->blocks));
    b->blocks[0] = (struct indirect_block){ .first = 0, .packets = 4, .rows = 1, .rank = { 2 } };
    b->blocks[1] = (struct indirect_block){ .first = 4, .packets = 2, .rows = 1, .rank = { 1 } };
    b->groups = mem_alloc(2, sizeof(*b->groups));
    for (int k = 0; k < 2; k++)
        b->groups[k] = (struct indirect_group){ .count = 2, .rows = 1, .pieces = { { NULL, 3, 16 } } };
    const size_t piece = 3 * 3 * 16 + 2 * (4 + 16 + 64) + 1 * (4 + 16 + 32);
    assert_int_equal(indirect_piece_bytes(&b->groups[0], b->blocks, 0), piece);
    b->groups[0].pieces[0].bytes = mem_alloc(piece, 1);
    assert_int_equal(indirect_close(b), ERR_OK);
    assert_int_equal(b->stats.basis, 16);
    assert_int_equal(b->stats.pieces, 2);
    assert_near(b->stats.rank, 1.5, 0.0);
    assert_near(b->stats.shared, 3.0, 0.0);
    assert_int_equal(b->stats.bytes, 16 * SKY_CELLS * 4 + piece + 3 * 16 * 4 + 8 * sizeof(struct indirect_place) +
                                         2 * TRANSPORT_ROWS * sizeof(struct indirect_row));
    indirect_destroy(b);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_weighted_row_is_added_by_colours),
    cmocka_unit_test(coefficients_are_the_products_of_rows_and_sky),
    cmocka_unit_test(bytes_are_multiplied_with_the_sky),
    cmocka_unit_test(a_point_is_averaged_by_its_neighbours_likeness),
    cmocka_unit_test(a_gradient_stays_as_it_is),
    cmocka_unit_test(rows_in_common_are_stored_once),
    cmocka_unit_test(what_brings_too_little_is_left_out),
    cmocka_unit_test(what_one_block_would_miss_is_kept),
    cmocka_unit_test(the_basis_is_that_of_the_rows),
    cmocka_unit_test(the_basis_says_what_it_leaves_out),
    cmocka_unit_test(a_cells_directions_are_taken_equally_often),
    cmocka_unit_test(what_is_stored_is_counted),
};
UNIT_MAIN(tests)
