/* Compresses the gathered light of a group of blocks to as few bytes as the tolerance allows: first each block alone,
 * then all blocks' rows together, then each block within these. */
#include "light/cache_indirect/internal.h"

#include "base/mem.h"

#include <cblas.h>
#include <lapacke.h>

#include <math.h>
#include <string.h>

/* Shares of the squared error that a rank must remove to be kept: */
#define FIRST 0.1    /* ranks of the blocks alone */
#define SHARED 0.4   /* ranks of the group */
#define LAST 0.4     /* ranks of the blocks within the group's */
#define LOCAL 2.0    /* a rank of the group that removes less is kept if it removes so much in one block */
#define SEVERAL 10.0 /* at so many points, counted by the sum of squares squared over that of fourth powers */
#define TAIL 0.5     /* share that the coefficients left out of V may have in total */

#define ROWS_MOST (INDIRECT_GROUP * TRANSPORT_POINTS)

struct part { /* a block's row, compressed alone */
    uint32_t rank;
    float u[TRANSPORT_POINTS][TRANSPORT_POINTS]; /* [rank][point], orthonormal */
};

struct indirect_workspace { /* per thread */
    uint32_t k;             /* size of the basis; a row is 3 k wide */
    struct part *parts;     /* [TRANSPORT_ROWS][INDIRECT_GROUP] */
    float *rows;            /* [TRANSPORT_ROWS][ROWS_MOST][3 k]: of all blocks of a group */
    uint32_t count[TRANSPORT_ROWS];
    float scale[INDIRECT_GROUP][TRANSPORT_ROWS][TRANSPORT_POINTS];
    float *gram, *values, *work; /* for a ROWS_MOST x ROWS_MOST matrix */
    lapack_int *whole;
    float *v; /* [ROWS_MOST][3 k] */
    float small[TRANSPORT_POINTS * TRANSPORT_POINTS];
};

struct indirect_workspace *indirect_workspace_create(uint32_t k)
{
    struct indirect_workspace *w = mem_alloc(1, sizeof(*w));
    const size_t n = ROWS_MOST, row = 3 * (size_t)k;

    if (!w)
        return NULL;
    w->k = k;
    w->parts = mem_alloc((size_t)TRANSPORT_ROWS * INDIRECT_GROUP, sizeof(*w->parts));
    w->rows = mem_alloc_raw(TRANSPORT_ROWS * n * row, sizeof(float));
    w->v = mem_alloc_raw(n * row, sizeof(float));
    w->gram = mem_alloc_raw(n * n, sizeof(float));
    w->values = mem_alloc_raw(n, sizeof(float));
    w->work = mem_alloc_raw(1 + 6 * n + 2 * n * n, sizeof(float)); /* as ssyevd requires */
    w->whole = mem_alloc_raw(3 + 5 * n, sizeof(*w->whole));
    if (w->parts && w->rows && w->v && w->gram && w->values && w->work && w->whole)
        return w;
    indirect_workspace_destroy(w);
    return NULL;
}

void indirect_workspace_destroy(struct indirect_workspace *w)
{
    if (!w)
        return;
    mem_free(w->parts);
    mem_free(w->rows);
    mem_free(w->v);
    mem_free(w->gram);
    mem_free(w->values);
    mem_free(w->work);
    mem_free(w->whole);
    mem_free(w);
}

/* Replaces the symmetric n x n matrix by its eigenvectors, those of the largest values last. Returns the number of
 * values above `least`; if the library fails, n, with unit vectors. One bound for all blocks minimises the total
 * squared error for a given number of ranks [Eckart and Young 1936]. */
static uint32_t decompose(struct indirect_workspace *w, float *gram, uint32_t n, double least)
{
    const lapack_int m = (lapack_int)n;
    uint32_t rank = n;

    if (n == 0)
        return 0;
    if (LAPACKE_ssyevd_work(LAPACK_COL_MAJOR, 'V', 'L', m, gram, m, w->values, w->work, 1 + 6 * m + 2 * m * m, w->whole,
                            3 + 5 * m)) {
        memset(gram, 0, (size_t)n * n * sizeof(*gram));
        for (uint32_t i = 0; i < n; i++)
            gram[(size_t)i * n + i] = w->values[i] = 1.0f;
        return n;
    }
    while (rank > 0 && (double)w->values[n - rank] <= least)
        rank--;
    return rank;
}

void indirect_compress_begin(struct indirect_workspace *w)
{
    memset(w->count, 0, sizeof(w->count));
}

void indirect_compress_block(struct indirect_workspace *w, uint32_t slot, uint32_t row, uint32_t points, float *t,
                             const float *scale, double least)
{
    const int n = (int)points, wide = 3 * (int)w->k;
    struct part *part = &w->parts[row * INDIRECT_GROUP + slot];
    float *to = w->rows + ((size_t)row * ROWS_MOST + w->count[row]) * 3 * w->k;

    memcpy(w->scale[slot][row], scale, points * sizeof(*scale));
    for (uint32_t p = 0; p < points; p++)
        cblas_sscal(wide, scale[p], t + (size_t)p * 3 * w->k, 1);
    cblas_ssyrk(CblasRowMajor, CblasUpper, CblasNoTrans, n, wide, 1.0f, t, wide, 0.0f, w->small, n);
    part->rank = decompose(w, w->small, points, FIRST * least * points);
    if (part->rank == 0)
        return;
    const float *u = w->small + (size_t)(points - part->rank) * points;
    for (uint32_t i = 0; i < part->rank; i++)
        memcpy(part->u[i], u + (size_t)i * points, points * sizeof(*u));
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, (int)part->rank, wide, n, 1.0f, u, n, t, wide, 0.0f, to,
                wide);
    w->count[row] += part->rank;
}

/* The number of coefficients of V to keep; they are sorted by their importance for all points. */
static uint32_t short_basis(const float *v, uint32_t rows, uint32_t k, double allowed)
{
    double rest = 0.0;

    for (uint32_t first = k - PACKET; first > 0; first -= PACKET) {
        for (uint32_t r = 0; r < rows; r++)
            for (uint32_t i = 0; i < PACKET; i++) {
                const double x = (double)v[(size_t)r * k + first + i];
                rest += x * x;
            }
        if (rest > allowed)
            return first + PACKET;
    }
    return PACKET;
}

/* A block's part of the group's rows is the first `count` columns of E[rank][n], whose rows have the squared lengths
 * `values`. Writes its left singular vectors of the largest singular values to w->small; returns their number. */
static uint32_t reduce(struct indirect_workspace *w, const float *e, const float *values, uint32_t rank, uint32_t n,
                       uint32_t count, double least)
{
    for (uint32_t i = 0; i < count; i++)
        for (uint32_t j = 0; j < count; j++) {
            double sum = 0.0;
            for (uint32_t k = 0; k < rank; k++)
                sum += (double)values[k] * (double)e[(size_t)k * n + i] * (double)e[(size_t)k * n + j];
            w->small[i * count + j] = (float)sum;
        }
    return decompose(w, w->small, count, least);
}

/* Writes x as bytes; returns the factor that restores x. */
static float write_bytes(const float *x, uint32_t count, int8_t *to)
{
    float most = 0.0f;

    for (uint32_t i = 0; i < count; i++)
        most = fmaxf(most, fabsf(x[i]));
    for (uint32_t i = 0; i < count; i++)
        to[i] = (int8_t)(most > 0.0f ? lrintf(x[i] / most * 127.0f) : 0);
    return most / 127.0f;
}

/* The factors of a block: its singular vectors f[rank][part's rank], and the group's, e[columns][n]. */
struct factors {
    const struct part *part;
    const float *f, *e, *scale;
    const float *v_scale; /* [columns]: the factors of V's rows */
    uint32_t rank, group, n, points;
};

/* Writes gains, W[rank][columns] and U[rank][points]. */
static void write_block(const struct factors *x, int8_t *to)
{
    const uint32_t columns = indirect_columns(x->group);
    int8_t *w = to + x->rank * sizeof(float), *u = w + (size_t)x->rank * columns;
    float row[INDIRECT_GROUP * TRANSPORT_POINTS];

    for (uint32_t m = 0; m < x->rank; m++, w += columns, u += x->points) {
        const float *f = x->f + (size_t)m * x->part->rank;
        memset(row, 0, columns * sizeof(*row));
        for (uint32_t k = 0; k < x->group; k++) {
            double sum = 0.0;
            for (uint32_t i = 0; i < x->part->rank; i++)
                sum += (double)f[i] * (double)x->e[(size_t)k * x->n + i];
            row[k] = (float)sum * x->v_scale[k];
        }
        float gain = write_bytes(row, columns, w);
        for (uint32_t p = 0; p < x->points; p++) {
            double sum = 0.0;
            for (uint32_t i = 0; i < x->part->rank; i++)
                sum += (double)f[i] * (double)x->part->u[i][p];
            row[p] = (float)sum / x->scale[p];
        }
        gain *= write_bytes(row, x->points, u);
        memcpy(to + m * sizeof(gain), &gain, sizeof(gain));
    }
}

/* Writes V[rank][3][basis]; returns the end. */
static int8_t *write_shared(const float *v, uint32_t k, const struct indirect_piece *q, float *v_scale, int8_t *to)
{
    float row[3 * INDIRECT_BASIS_MAX];

    for (uint32_t r = 0; r < q->rank; r++, to += 3 * q->basis) {
        for (uint32_t c = 0; c < 3; c++)
            memcpy(row + c * q->basis, v + ((size_t)r * 3 + c) * k, q->basis * sizeof(*row));
        v_scale[r] = write_bytes(row, 3 * q->basis, to);
    }
    return to;
}

/* Writes the whole piece. e: the group's eigenvectors, [rank][n]. */
static enum err write_piece(struct indirect_workspace *w, struct indirect_group *g, struct indirect_block *blocks,
                            uint32_t row, const float *e, uint32_t n, double least)
{
    struct indirect_piece *q = &g->pieces[row];
    int8_t *bytes = mem_alloc_raw(indirect_piece_bytes(g, blocks, row), 1), *to = bytes;
    float values[ROWS_MOST], v_scale[ROWS_MOST];

    if (!bytes)
        return ERR_NOMEM;
    memcpy(values, w->values + n - q->rank, q->rank * sizeof(*values));
    to = write_shared(w->v, w->k, q, v_scale, to);
    for (uint32_t b = 0; b < g->count; b++) {
        const struct part *part = &w->parts[row * INDIRECT_GROUP + b];
        const uint32_t count = part->rank, points = blocks[b].packets * PACKET;
        const uint32_t rank = reduce(w, e, values, q->rank, n, count, least * points);
        const struct factors x = {
            part, w->small + (size_t)(count - rank) * count, e, w->scale[b][row], v_scale, rank, q->rank, n, points
        };
        blocks[b].rank[row] = (uint8_t)rank;
        write_block(&x, to);
        to += indirect_block_bytes(rank, indirect_columns(q->rank), points);
        e += count;
    }
    q->bytes = mem_alloc_raw((size_t)(to - bytes), 1);
    if (q->bytes)
        memcpy(q->bytes, bytes, (size_t)(to - bytes));
    mem_free(bytes);
    return q->bytes ? ERR_OK : ERR_NOMEM;
}

/* Whether a block's share of the group's eigenvector e[n], of which each block has as many numbers as its own rank, is
 * more than `least` a point, and of SEVERAL points or more: that of fewer is mostly noise. */
static bool matters_to_one(const struct indirect_workspace *w, const struct indirect_block *blocks, uint32_t count,
                           uint32_t row, const float *e, double value, double least)
{
    for (uint32_t b = 0; b < count; b++) {
        const struct part *part = &w->parts[row * INDIRECT_GROUP + b];
        const uint32_t points = blocks[b].packets * PACKET;
        float at[TRANSPORT_POINTS] = { 0.0f };
        double square = 0.0, fourth = 0.0;
        for (uint32_t i = 0; i < part->rank; i++)
            for (uint32_t p = 0; p < points; p++)
                at[p] += e[i] * part->u[i][p];
        for (uint32_t p = 0; p < points; p++) {
            const double x = (double)at[p] * (double)at[p];
            square += x;
            fourth += x * x;
        }
        if (value * square > least * points && square * square >= SEVERAL * fourth)
            return true;
        e += part->rank;
    }
    return false;
}

/* Of the group's n eigenvectors, smallest values first, the last `rank` are kept. Keeps also those that matter to one
 * block, such as the light of a surface of which the group has few points, and moves them next to the others. Returns
 * the number of all that are kept. */
static uint32_t keep_local(struct indirect_workspace *w, const struct indirect_block *blocks, uint32_t count,
                           uint32_t row, uint32_t n, uint32_t rank, double least)
{
    uint32_t to = n - rank;

    for (uint32_t k = n - rank; k > 0 && (double)w->values[k - 1] > least * PACKET; k--) {
        float *e = w->gram + (size_t)(k - 1) * n;
        if (!matters_to_one(w, blocks, count, row, e, (double)w->values[k - 1], least))
            continue;
        to--;
        w->values[to] = w->values[k - 1];
        memmove(w->gram + (size_t)to * n, e, n * sizeof(*e));
    }
    return n - to;
}

enum err indirect_compress_end(struct indirect_workspace *w, struct indirect_group *g, struct indirect_block *blocks,
                               uint32_t row, double least)
{
    struct indirect_piece *q = &g->pieces[row];
    const uint32_t n = w->count[row];
    const int wide = 3 * (int)w->k;
    const float *rows = w->rows + (size_t)row * ROWS_MOST * 3 * w->k;
    double whole = 0.0;
    uint32_t points = 0;

    *q = (struct indirect_piece){ .bytes = NULL };
    for (uint32_t b = 0; b < g->count; b++) {
        points += blocks[b].packets * PACKET;
        blocks[b].rank[row] = (uint8_t)w->parts[row * INDIRECT_GROUP + b].rank;
    }
    if (n > 0) {
        cblas_ssyrk(CblasRowMajor, CblasUpper, CblasNoTrans, (int)n, wide, 1.0f, rows, wide, 0.0f, w->gram, (int)n);
        q->rank = decompose(w, w->gram, n, SHARED * least * points);
        if (row == 0) /* lobes of one block always differ from those of another */
            q->rank = keep_local(w, blocks, g->count, row, n, q->rank, LOCAL * least);
    }
    if (q->rank == 0) {
        for (uint32_t b = 0; b < g->count; b++)
            blocks[b].rank[row] = 0;
        return ERR_OK;
    }
    const float *e = w->gram + (size_t)(n - q->rank) * n;
    for (uint32_t k = n - q->rank; k < n; k++)
        whole += fmax(0.0, (double)w->values[k]);
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, (int)q->rank, wide, (int)n, 1.0f, e, (int)n, rows, wide,
                0.0f, w->v, wide);
    q->basis = short_basis(w->v, 3 * q->rank, w->k, TAIL * fmin(least * points, whole));
    return write_piece(w, g, blocks, row, e, n, LAST * least);
}
