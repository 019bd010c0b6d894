/* The loops of the cache of indirect light (light/cache_indirect/internal.h): compiled once per CPU level, see
 * CMakeLists.txt. */
#include "light/cache_direct/half_lanes.h"
#include "light/cache_indirect/internal.h"

static void add(float *to, const float *from, const float weight[3], uint32_t basis)
{
    for (int c = 0; c < 3; c++, to += basis, from += basis)
        for (uint32_t k = 0; k < basis; k += PACKET) {
            float *at = to + k;
            const float *more = from + k;
            LANES(l) at[l] += weight[c] * more[l];
        }
}

/* Rows processed together, so that their sums are independent. */
#define ROWS 4u

static void take(const struct indirect_basis *q, float (*sky)[SKY_CELLS], float *y)
{
    for (uint32_t first = 0; first < q->count; first += ROWS) {
        const uint32_t rows = q->count - first < ROWS ? q->count - first : ROWS;
        struct lanes sum[ROWS][3] = { { { { 0.0f } } } };
        for (uint32_t i = 0; i < SKY_CELLS; i += PACKET)
            for (uint32_t r = 0; r < rows; r++) {
                const float *row = q->rows + (size_t)(first + r) * SKY_CELLS + i;
                for (uint32_t c = 0; c < 3; c++)
                    LANES(l) sum[r][c].v[l] += row[l] * sky[c][i + (uint32_t)l];
            }
        for (uint32_t r = 0; r < rows; r++) {
            float all[3];
            sum_lanes(sum[r], all);
            for (uint32_t c = 0; c < 3; c++)
                y[c * q->count + first + r] = all[c];
        }
    }
}

static void project(const struct indirect_piece *q, const float *y, uint32_t basis, float *z)
{
    const uint32_t columns = indirect_columns(q->rank);
    const int8_t *v = q->bytes;

    memset(z, 0, 3 * columns * sizeof(*z));
    for (uint32_t r = 0; r < q->rank; r++) {
        struct lanes sum[3] = { { { 0.0f } } }, x;
        float all[3];
        for (uint32_t c = 0; c < 3; c++, v += q->basis)
            for (uint32_t k = 0; k < q->basis; k += PACKET) {
                const float *sky = y + c * basis + k;
                widen_bytes(v + k, &x);
                LANES(l) sum[c].v[l] += x.v[l] * sky[l];
            }
        sum_lanes(sum, all);
        for (uint32_t c = 0; c < 3; c++)
            z[c * columns + r] = all[c];
    }
}

/* out[c] = gain * (row of W) z[c]. */
static inline void weigh(const int8_t *w, const float *z, uint32_t columns, float gain, float out[3])
{
    struct lanes sum[3] = { { { 0.0f } } }, x;

    for (uint32_t i = 0; i < columns; i += PACKET) {
        widen_bytes(w + i, &x);
        for (uint32_t c = 0; c < 3; c++) {
            const float *from = z + c * columns + i;
            LANES(l) sum[c].v[l] += x.v[l] * from[l];
        }
    }
    sum_lanes(sum, out);
    for (int c = 0; c < 3; c++)
        out[c] *= gain;
}

static void expand(const int8_t *bytes, uint32_t rank, const float *z, uint32_t columns, uint32_t points,
                   float out[3][TRANSPORT_POINTS])
{
    const int8_t *w = bytes + rank * sizeof(float), *u = w + (size_t)rank * columns;
    float y[INDIRECT_RANK_MAX][3];

    for (uint32_t k = 0; k < rank; k++, w += columns) {
        float gain;
        memcpy(&gain, bytes + k * sizeof(gain), sizeof(gain));
        weigh(w, z, columns, gain, y[k]);
    }
    for (uint32_t p = 0; p < points; p += PACKET) {
        struct lanes sum[3] = { { { 0.0f } } }, x;
        for (uint32_t k = 0; k < rank; k++) {
            widen_bytes(u + (size_t)k * points + p, &x);
            for (int c = 0; c < 3; c++)
                LANES(l) sum[c].v[l] += x.v[l] * y[k][c];
        }
        for (int c = 0; c < 3; c++)
            memcpy(out[c] + p, &sum[c], sizeof(sum[c]));
    }
}

extern const struct indirect_kernels KERNEL(indirect_kernels);
const struct indirect_kernels KERNEL(indirect_kernels) = { take, add, project, expand };
