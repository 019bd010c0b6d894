/* Compresses one row of a block to as few bytes as the tolerance allows. */
#include "base/half.h"
#include "base/mem.h"
#include "light/cache_direct/internal.h"

#include <cblas.h>
#include <lapacke.h>

#include <float.h>
#include <math.h>

#define MORE 3u /* maximum number of additional ranks that make up for rounding to bytes */

struct transport_workspace { /* per thread */
    float gram[TRANSPORT_POINTS * TRANSPORT_POINTS];
    float values[TRANSPORT_POINTS];                                                 /* eigenvalues, ascending */
    float work[1 + 6 * TRANSPORT_POINTS + 2 * TRANSPORT_POINTS * TRANSPORT_POINTS]; /* as ssyevd requires */
    lapack_int whole[3 + 5 * TRANSPORT_POINTS];
    float sums[SKY_CHUNKS][TRANSPORT_POINTS];
    float scaled[TRANSPORT_POINTS * TRANSPORT_POINTS];
    float projected[TRANSPORT_POINTS * SKY_CELLS];
    int8_t rounded[TRANSPORT_POINTS * SKY_CELLS];
    float gains[TRANSPORT_POINTS];
};

struct transport_workspace *transport_workspace_create(void)
{
    return mem_alloc(1, sizeof(struct transport_workspace));
}

void transport_workspace_destroy(struct transport_workspace *w)
{
    mem_free(w);
}

void transport_compress_begin(void)
{
    openblas_set_num_threads(1);
}

uint64_t transport_piece_bytes(const struct transport_piece *q, uint32_t points)
{
    const struct transport_shape *s = &q->shape;

    return transport_head(s) + (s->form == TRANSPORT_RAW ? 0 : sizeof(uint16_t) * (uint64_t)s->rank * points);
}

/* The power of two that scales the largest entry to 2^13 .. 2^14, where half floats have the largest range below. */
static float half_scale(const float *x, size_t count)
{
    float most = 0.0f;
    int exponent;

    for (size_t i = 0; i < count; i++)
        most = fmaxf(most, fabsf(x[i]));
    frexpf(most, &exponent);
    return most > 0.0f ? ldexpf(1.0f, exponent - 14) : 1.0f;
}

/* Whether a chunk of cells is 0 for all points; further columns belong to an earlier block. */
static bool is_zero(float (*cells)[TRANSPORT_POINTS], uint32_t points)
{
    for (uint32_t c = 0; c < SKY_CHUNK; c++)
        for (uint32_t p = 0; p < points; p++)
            if (cells[c][p] > 0.0f)
                return false;
    return true;
}

/* Moves the chunks that are not 0 to the front and lists them. */
static void pack_chunks(struct transport_matrix *m, uint32_t points, struct transport_shape *out)
{
    out->chunk_count = 0;
    for (uint32_t chunk = 0; chunk < SKY_CHUNKS; chunk++) {
        float(*from)[TRANSPORT_POINTS] = &m->at[chunk * SKY_CHUNK];
        if (is_zero(from, points))
            continue;
        if (out->chunk_count < chunk)
            memcpy(m->at[(size_t)out->chunk_count * SKY_CHUNK], from, SKY_CHUNK * sizeof(*from));
        out->chunks[out->chunk_count++] = (uint8_t)chunk;
    }
}

static void sum_chunks(struct transport_workspace *w, const struct transport_matrix *m, uint32_t chunks)
{
    memset(w->sums, 0, chunks * sizeof(w->sums[0]));
    for (uint32_t c = 0; c < chunks * SKY_CHUNK; c++)
        for (uint32_t p = 0; p < TRANSPORT_POINTS; p++)
            w->sums[c / SKY_CHUNK][p] += m->at[c][p];
}

double transport_weigh(const struct transport_matrix *m, uint32_t points, const float *scale)
{
    double sum = 0.0;

    for (uint32_t chunk = 0; chunk < SKY_CHUNKS; chunk++) {
        double squares[TRANSPORT_POINTS] = { 0.0 }, whole[TRANSPORT_POINTS] = { 0.0 };
        for (uint32_t c = chunk * SKY_CHUNK; c < (chunk + 1) * SKY_CHUNK; c++)
            for (uint32_t p = 0; p < TRANSPORT_POINTS; p++) {
                squares[p] += (double)m->at[c][p] * (double)m->at[c][p];
                whole[p] += (double)m->at[c][p];
            }
        for (uint32_t p = 0; p < points; p++)
            sum += (double)scale[p] * (double)scale[p] * (squares[p] + whole[p] * whole[p]);
    }
    return sum;
}

/* G = D T (1 + S S^t) T^t D, where S sums the cells of each chunk. */
static void fill_gram(struct transport_workspace *w, const struct transport_matrix *m, uint32_t chunks, uint32_t points,
                      const float *scale)
{
    const int n = (int)points;

    sum_chunks(w, m, chunks);
    cblas_ssyrk(CblasColMajor, CblasLower, CblasNoTrans, n, (int)(chunks * SKY_CHUNK), 1.0f, m->at[0], TRANSPORT_POINTS,
                0.0f, w->gram, n);
    cblas_ssyrk(CblasColMajor, CblasLower, CblasNoTrans, n, (int)chunks, 1.0f, w->sums[0], TRANSPORT_POINTS, 1.0f,
                w->gram, n);
    for (uint32_t j = 0; j < points; j++)
        for (uint32_t i = j; i < points; i++)
            w->gram[j * points + i] *= scale[i] * scale[j];
}

/* The smallest rank whose error, the sum of the remaining eigenvalues of G, is allowed [Eckart and Young 1936]; the
 * number of points if the library fails. The eigenvectors replace the Gram matrix, those of the largest values last.
 * *rest: the error. */
static uint32_t choose_rank(struct transport_workspace *w, uint32_t points, double allowed, double *rest)
{
    const int n = (int)points;
    uint32_t rank = points;

    *rest = 0.0;
    if (LAPACKE_ssyevd_work(LAPACK_COL_MAJOR, 'V', 'L', n, w->gram, n, w->values, w->work,
                            sizeof(w->work) / sizeof(w->work[0]), w->whole, sizeof(w->whole) / sizeof(w->whole[0])))
        return points;
    for (uint32_t k = 0; k < points; k++, rank--) {
        const double more = fmax(0.0, (double)w->values[k]);
        if (*rest + more > allowed)
            break;
        *rest += more;
    }
    return rank;
}

/* Writes V[rank][cells] as half floats in the order of transport_piece: up to TRANSPORT_TOGETHER rows side by side,
 * chunk by chunk. */
static void round_rows(const float *v, uint32_t rank, uint32_t cells, float scale, uint8_t *out)
{
    const float up = 1.0f / scale;
    uint16_t *to = (uint16_t *)(void *)out;

    for (uint32_t first = 0; first < rank; first += TRANSPORT_TOGETHER) {
        const uint32_t rows = rank - first < TRANSPORT_TOGETHER ? rank - first : TRANSPORT_TOGETHER;
        for (uint32_t chunk = 0; chunk < cells; chunk += SKY_CHUNK)
            for (uint32_t r = first; r < first + rows; r++)
                for (uint32_t c = chunk; c < chunk + SKY_CHUNK; c++)
                    *to++ = half_round(v[(size_t)r * cells + c] * up);
    }
}

/* Rounds a row of V[cells] to bytes and carries the rounding error from cell to cell, so that sums over neighbours are
 * exact to one step. Returns the squared error in units of transport_weigh; D U has columns of length 1. */
static double round_row(const float *v, uint32_t cells, float *gain, int8_t *out)
{
    float largest = 0.0f, carry = 0.0f;
    double squares = 0.0;

    for (uint32_t c = 0; c < cells; c++)
        largest = fmaxf(largest, fabsf(v[c]));
    *gain = fmaxf(largest, FLT_MIN) / 126.0f; /* leaves half a step for the carry */
    for (uint32_t chunk = 0; chunk < cells; chunk += SKY_CHUNK) {
        double whole = 0.0;
        for (uint32_t c = chunk; c < chunk + SKY_CHUNK; c++) {
            const float x = v[c] / *gain, y = rintf(x + carry);
            carry += x - y;
            out[c] = (int8_t)y;
            squares += (double)(x - y) * (double)(x - y);
            whole += (double)(x - y);
        }
        squares += whole * whole;
    }
    return squares * (double)*gain * (double)*gain;
}

/* Rounds V's last rows to bytes. Returns the smallest rank, from `least` to `rows`, whose error including rounding is
 * allowed; 0: there is none. rest: the error of the least rank. */
static uint32_t round_to_bytes(struct transport_workspace *w, uint32_t least, uint32_t rows, uint32_t points,
                               uint32_t cells, double rest, double allowed)
{
    double off = 0.0;

    for (uint32_t rank = 1; rank <= rows; rank++) {
        const size_t at = (size_t)(rows - rank) * cells;
        off += round_row(w->projected + at, cells, &w->gains[rows - rank], w->rounded + at);
        rest -= rank > least ? fmax(0.0, (double)w->values[points - rank]) : 0.0;
        if (rank >= least && rest + off <= allowed)
            return rank;
    }
    return 0;
}

/* Writes gains and bytes in the order of transport_piece. */
static void copy_bytes(const float *gains, uint32_t room, const int8_t *v, uint32_t rank, uint32_t cells, uint8_t *out)
{
    memset(out, 0, room * sizeof(*gains));
    memcpy(out, gains, rank * sizeof(*gains));
    out += room * sizeof(*gains);
    for (uint32_t first = 0; first < rank; first += TRANSPORT_TOGETHER)
        for (uint32_t chunk = 0; chunk < cells; chunk += SKY_CHUNK)
            for (uint32_t r = first; r < rank && r < first + TRANSPORT_TOGETHER; r++, out += SKY_CHUNK)
                memcpy(out, v + (size_t)r * cells + chunk, SKY_CHUNK);
}

/* Writes U = D^-1 times the eigenvectors, packet by packet. */
static void round_columns(const float *u, uint32_t rank, uint32_t points, const float *scale, uint8_t *out)
{
    uint16_t *to = (uint16_t *)(void *)out;

    for (uint32_t first = 0; first < points; first += PACKET)
        for (uint32_t r = 0; r < rank; r++)
            for (uint32_t p = first; p < first + PACKET; p++)
                *to++ = half_round(u[(size_t)r * points + p] / scale[p]);
}

static enum err keep_raw(struct transport_workspace *w, const struct transport_matrix *m, uint32_t cells,
                         uint32_t points, struct transport_piece *out)
{
    for (uint32_t p = 0; p < points; p++)
        for (uint32_t c = 0; c < cells; c++)
            w->projected[(size_t)p * cells + c] = m->at[c][p];
    out->shape.rank = points;
    out->shape.form = TRANSPORT_RAW;
    out->bytes = mem_alloc_raw((size_t)points * cells, sizeof(uint16_t));
    if (!out->bytes)
        return ERR_NOMEM;
    out->shape.scale = half_scale(w->projected, (size_t)points * cells);
    round_rows(w->projected, points, cells, out->shape.scale, out->bytes);
    return ERR_OK;
}

/* V = D times the eigenvectors of the largest values, times T. */
static void project_rows(struct transport_workspace *w, const struct transport_matrix *m, uint32_t rows,
                         uint32_t points, uint32_t cells, const float *scale)
{
    const float *u = w->gram + (size_t)(points - rows) * points;

    for (uint32_t k = 0; k < rows; k++)
        for (uint32_t p = 0; p < points; p++)
            w->scaled[k * points + p] = u[k * points + p] * scale[p];
    cblas_sgemm(CblasColMajor, CblasTrans, CblasNoTrans, (int)cells, (int)rows, (int)points, 1.0f, m->at[0],
                TRANSPORT_POINTS, w->scaled, (int)points, 0.0f, w->projected, (int)cells);
}

/* Stores U and V of at least that rank: V in bytes if the error is then allowed, with a few additional ranks if needed,
 * since bytes take half the memory of half floats. */
static enum err keep_product(struct transport_workspace *w, const struct transport_matrix *m, uint32_t least,
                             uint32_t points, const float *scale, double rest, double allowed,
                             struct transport_piece *out)
{
    struct transport_shape *s = &out->shape;
    const uint32_t cells = s->chunk_count * SKY_CHUNK;
    const uint32_t rows = least + MORE < points ? least + MORE : points;

    project_rows(w, m, rows, points, cells, scale);
    const uint32_t rank = round_to_bytes(w, least, rows, points, cells, rest, allowed);
    s->form = rank > 0 ? TRANSPORT_BYTES : TRANSPORT_HALVES;
    s->rank = rank > 0 ? rank : least;
    const size_t first = rows - s->rank;
    out->bytes = mem_alloc_raw((size_t)transport_piece_bytes(out, points), 1);
    if (!out->bytes)
        return ERR_NOMEM;
    if (s->form == TRANSPORT_BYTES) {
        copy_bytes(w->gains + first, transport_gains(s), w->rounded + first * cells, s->rank, cells, out->bytes);
    } else {
        s->scale = half_scale(w->projected + first * cells, (size_t)s->rank * cells);
        round_rows(w->projected + first * cells, s->rank, cells, s->scale, out->bytes);
    }
    round_columns(w->gram + (size_t)(points - s->rank) * points, s->rank, points, scale,
                  out->bytes + transport_head(s));
    return ERR_OK;
}

enum err transport_compress(struct transport_workspace *w, struct transport_matrix *m, uint32_t points,
                            const float *scale, double allowed, struct transport_piece *out)
{
    double rest = 0.0;

    *out = (struct transport_piece){ .shape.scale = 1.0f };
    pack_chunks(m, points, &out->shape);
    const uint32_t cells = out->shape.chunk_count * SKY_CHUNK;
    if (cells == 0)
        return ERR_OK;
    if (allowed >= 0.0)
        fill_gram(w, m, out->shape.chunk_count, points, scale);
    const uint32_t rank = allowed < 0.0 ? points : choose_rank(w, points, allowed, &rest);
    if (rank == 0)
        return ERR_OK;
    if (rank * (points + cells) >= points * cells)
        return keep_raw(w, m, cells, points, out);
    return keep_product(w, m, rank, points, scale, rest, allowed, out);
}
