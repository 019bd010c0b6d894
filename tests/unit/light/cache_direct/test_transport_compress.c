/* The compression of one row of a block, and its product with a sky, on matrices whose rank is known. */
#include "base/mem.h"
#include "base/rng.h"
#include "light/cache_direct/internal.h"
#include "light/estimators/kernels.h"
#include "light/estimators/levels.h"

#include <math.h>

#include "support/unit.h"

struct bench {
    struct transport_matrix *m, *copy;
    struct transport_workspace *w;
    struct sky_split *sky;
    struct transport_piece piece;
    float scale[TRANSPORT_POINTS];
    double norm; /* transport_weigh of the matrix */
};

/* The sum of `rank` products of random columns and rows; lit in chunks first .. first + 9 only. */
static struct bench bench_make(uint32_t rank, uint32_t first)
{
    struct bench b = { .m = mem_alloc(1, sizeof(*b.m)),
                       .copy = mem_alloc(1, sizeof(*b.copy)),
                       .w = transport_workspace_create(),
                       .sky = mem_alloc(1, sizeof(*b.sky)) };
    struct rng r = { 17 };

    for (uint32_t k = 0; k < rank; k++) {
        float u[TRANSPORT_POINTS];
        const float strength = rank > 12 ? 1.0f : (float)pow(0.7, k); /* else too faint for floats */
        for (uint32_t p = 0; p < TRANSPORT_POINTS; p++)
            u[p] = strength * (float)rng_next(&r);
        for (uint32_t c = first * SKY_CHUNK; c < (first + 10) * SKY_CHUNK; c++) {
            const float v = (float)rng_next(&r) * 1e-3f;
            for (uint32_t p = 0; p < TRANSPORT_POINTS; p++)
                b.m->at[c][p] += u[p] * v;
        }
    }
    for (uint32_t p = 0; p < TRANSPORT_POINTS; p++)
        b.scale[p] = 0.25f + 0.75f * (float)rng_next(&r);
    b.norm = transport_weigh(b.m, TRANSPORT_POINTS, b.scale);
    *b.copy = *b.m;
    transport_compress_begin();
    return b;
}

static void bench_finish(struct bench *b)
{
    mem_free(b->piece.bytes);
    mem_free(b->m);
    mem_free(b->copy);
    mem_free(b->sky);
    transport_workspace_destroy(b->w);
}

static const struct kernels *some_kernels(void)
{
    return kernels_all()[0];
}

/* What the piece is off in transport_weigh's terms, by a sky of one lit cell after another. */
static double error_of(struct bench *b)
{
    double sum = 0.0, chunk[TRANSPORT_POINTS] = { 0.0 };

    for (uint32_t c = 0; c < SKY_CELLS; c++) {
        _Alignas(64) float out[3][TRANSPORT_POINTS];
        b->sky->cells[c / SKY_CHUNK][1][c % SKY_CHUNK] = 1.0f;
        transport_kernels_of(some_kernels())->expand(&b->piece, b->sky, TRANSPORT_POINTS, out);
        b->sky->cells[c / SKY_CHUNK][1][c % SKY_CHUNK] = 0.0f;
        for (uint32_t p = 0; p < TRANSPORT_POINTS; p++) {
            const double off = (double)b->scale[p] * ((double)out[1][p] - (double)b->copy->at[c][p]);
            sum += off * off;
            chunk[p] += off;
            assert_true(out[0][p] == 0.0f && out[2][p] == 0.0f);
            if (c % SKY_CHUNK == SKY_CHUNK - 1) {
                sum += chunk[p] * chunk[p];
                chunk[p] = 0.0;
            }
        }
    }
    return sum;
}

/* Halves leave 2^-12 of each entry at most in U and as much in V: a norm of some 4e-4. Bytes leave a step of 252 in V,
 * a square of some 1e-5. Eigenvalues that are 0 come out below 1e-7 of the largest, 61 of them below 1e-5. */
static void a_matrix_of_three_products_has_rank_three(void **state)
{
    static const double allowed[] = { 1e-4, 1e-6 };
    static const uint64_t bytes[] = { 64 + 3 * (160 + 2 * 64), 2 * 3 * (160 + 64) };
    (void)state;

    for (int k = 0; k < 2; k++) {
        struct bench b = bench_make(3, 40);
        assert_int_equal(transport_compress(b.w, b.m, TRANSPORT_POINTS, b.scale, allowed[k] * b.norm, &b.piece),
                         ERR_OK);
        assert_int_equal(b.piece.shape.rank, 3);
        assert_int_equal(b.piece.shape.form, k ? TRANSPORT_HALVES : TRANSPORT_BYTES);
        assert_int_equal(b.piece.shape.chunk_count, 10);
        for (uint32_t i = 0; i < 10; i++)
            assert_int_equal(b.piece.shape.chunks[i], 40 + i);
        assert_int_equal(transport_piece_bytes(&b.piece, TRANSPORT_POINTS), bytes[k]);
        const double error = error_of(&b);
        printf("%g of the square\n", error / b.norm);
        assert_true(error < allowed[k] * b.norm);
        bench_finish(&b);
    }
}

/* An even sky is off by less than a step of each row, where rounding each cell by itself leaves a faint one out. */
static void sums_over_cells_survive_rounding_to_bytes(void **state)
{
    struct bench b = bench_make(1, 0);
    double sum = 0.0, want = 0.0;
    (void)state;

    for (uint32_t c = 1; c < SKY_CELLS; c++) /* one bright cell, all others below half a step of it */
        for (uint32_t p = 0; p < TRANSPORT_POINTS; p++)
            b.m->at[c][p] = 0.003f * b.m->at[0][p];
    *b.copy = *b.m;
    b.norm = transport_weigh(b.m, TRANSPORT_POINTS, b.scale);
    assert_int_equal(transport_compress(b.w, b.m, TRANSPORT_POINTS, b.scale, 0.1 * b.norm, &b.piece), ERR_OK);
    assert_int_equal(b.piece.shape.form, TRANSPORT_BYTES);
    for (uint32_t c = 0; c < SKY_CELLS; c++)
        b.sky->cells[c / SKY_CHUNK][1][c % SKY_CHUNK] = 1.0f;
    _Alignas(64) float out[3][TRANSPORT_POINTS];
    transport_kernels_of(some_kernels())->expand(&b.piece, b.sky, TRANSPORT_POINTS, out);
    for (uint32_t p = 0; p < TRANSPORT_POINTS; p++) {
        sum += (double)out[1][p];
        for (uint32_t c = 0; c < SKY_CELLS; c++)
            want += (double)b.copy->at[c][p];
    }
    printf("%g off\n", sum / want - 1.0);
    assert_true(fabs(sum / want - 1.0) < 2e-3);
    bench_finish(&b);
}

static void no_more_is_left_out_than_is_allowed_and_not_much_less(void **state)
{
    static const double shares[] = { 1e-1, 1e-2, 1e-3, 1e-4 };
    uint32_t last = 0;
    (void)state;

    for (size_t k = 0; k < sizeof(shares) / sizeof(shares[0]); k++) {
        struct bench b = bench_make(12, 3);
        assert_int_equal(transport_compress(b.w, b.m, TRANSPORT_POINTS, b.scale, shares[k] * b.norm, &b.piece), ERR_OK);
        assert_int_not_equal(b.piece.shape.form, TRANSPORT_RAW);
        const double error = error_of(&b);
        assert_true(error < shares[k] * b.norm + 1e-6 * b.norm);
        assert_true(b.piece.shape.rank >= last && b.piece.shape.rank < 12);
        last = b.piece.shape.rank;
        bench_finish(&b);
    }
    assert_true(last > 1);
}

static void what_does_not_get_smaller_is_kept_as_it_is(void **state)
{
    struct bench b = bench_make(64, 20), asked = bench_make(2, 20);
    (void)state;

    assert_int_equal(transport_compress(b.w, b.m, TRANSPORT_POINTS, b.scale, 0.0, &b.piece), ERR_OK);
    assert_int_equal(b.piece.shape.form, TRANSPORT_RAW);
    assert_int_equal(b.piece.shape.rank, TRANSPORT_POINTS);
    assert_true(error_of(&b) < 1e-6 * b.norm);
    assert_int_equal(transport_compress(asked.w, asked.m, TRANSPORT_POINTS, asked.scale, -1.0, &asked.piece), ERR_OK);
    assert_true(asked.piece.shape.form == TRANSPORT_RAW && error_of(&asked) < 1e-6 * asked.norm);
    bench_finish(&b);
    bench_finish(&asked);
}

static void a_dark_row_takes_nothing_nor_does_one_that_may_be_left_out(void **state)
{
    struct bench dark = bench_make(0, 0), faint = bench_make(3, 0);
    (void)state;

    assert_int_equal(transport_compress(dark.w, dark.m, TRANSPORT_POINTS, dark.scale, 0.0, &dark.piece), ERR_OK);
    assert_null(dark.piece.bytes);
    assert_true(error_of(&dark) == 0.0);
    assert_int_equal(transport_compress(faint.w, faint.m, TRANSPORT_POINTS, faint.scale, INFINITY, &faint.piece),
                     ERR_OK);
    assert_null(faint.piece.bytes);
    assert_int_equal(transport_piece_bytes(&faint.piece, TRANSPORT_POINTS), 0);
    assert_true(fabs(error_of(&faint) / faint.norm - 1.0) < 1e-6);
    bench_finish(&dark);
    bench_finish(&faint);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_matrix_of_three_products_has_rank_three),
    cmocka_unit_test(sums_over_cells_survive_rounding_to_bytes),
    cmocka_unit_test(no_more_is_left_out_than_is_allowed_and_not_much_less),
    cmocka_unit_test(what_does_not_get_smaller_is_kept_as_it_is),
    cmocka_unit_test(a_dark_row_takes_nothing_nor_does_one_that_may_be_left_out),
};
UNIT_MAIN(tests)
