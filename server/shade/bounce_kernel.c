/* The loops of the cache of interreflection (bounce_parts.h): compiled once per CPU level, see CMakeLists.txt. */
#include "bounce_parts.h"
#include "half_lanes.h"

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)

static void add(float *to, const float *from, const float weight[3], uint32_t basis)
{
    for (int c = 0; c < 3; c++, to += basis, from += basis)
        for (uint32_t k = 0; k < basis; k += PACKET) {
            float *at = to + k;
            const float *more = from + k;
            LANES(l) at[l] += weight[c] * more[l];
        }
}

/* Sixteen partial sums, in one order at all levels. */
static inline float sum_lanes(const struct lanes *x)
{
    struct {
        float v __attribute__((vector_size(16)));
    } a[4];

    memcpy(a, x->v, sizeof(a));
    a[0].v = (a[0].v + a[2].v) + (a[1].v + a[3].v);
    return (a[0].v[0] + a[0].v[2]) + (a[0].v[1] + a[0].v[3]);
}

static void project(const struct bounce_piece *q, const float *y, uint32_t basis, float *z)
{
    const uint32_t columns = bounce_columns(q->rank);
    const int8_t *v = q->bytes;

    memset(z, 0, 3 * columns * sizeof(*z));
    for (uint32_t r = 0; r < q->rank; r++)
        for (uint32_t c = 0; c < 3; c++, v += q->basis) {
            struct lanes sum = { { 0.0f } }, x;
            for (uint32_t k = 0; k < q->basis; k += PACKET) {
                const float *sky = y + c * basis + k;
                widen_bytes(v + k, &x);
                LANES(l) sum.v[l] += x.v[l] * sky[l];
            }
            z[c * columns + r] = sum_lanes(&sum);
        }
}

/* A row of W times z, by colours, and times the gain. */
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
    for (int c = 0; c < 3; c++)
        out[c] = gain * sum_lanes(&sum[c]);
}

static void expand(const int8_t *bytes, uint32_t rank, const float *z, uint32_t columns, uint32_t points,
                   float out[3][TRANSPORT_POINTS])
{
    const int8_t *w = bytes + rank * sizeof(float), *u = w + (size_t)rank * columns;
    float y[BOUNCE_RANK_MAX][3];

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

extern const struct bounce_kernels JOIN(bounce_kernels_, KERNEL_LEVEL);
const struct bounce_kernels JOIN(bounce_kernels_, KERNEL_LEVEL) = { add, project, expand };
