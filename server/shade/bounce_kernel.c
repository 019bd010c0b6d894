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
    float a[8], b[4];

    for (int l = 0; l < 8; l++)
        a[l] = x->v[l] + x->v[l + 8];
    for (int l = 0; l < 4; l++)
        b[l] = a[l] + a[l + 4];
    return (b[0] + b[2]) + (b[1] + b[3]);
}

/* A row of V times the sky, by colours. */
static inline void project(const struct bounce_piece *q, const uint16_t *v, const float *y, uint32_t basis, float z[3])
{
    struct lanes sum[3] = { { { 0.0f } } }, x;

    for (uint32_t c = 0; c < 3; c++, v += q->basis, y += basis)
        for (uint32_t k = 0; k < q->basis; k += PACKET) {
            const float *sky = y + k;
            widen_lanes(v + k, &x);
            LANES(l) sum[c].v[l] += x.v[l] * sky[l];
        }
    for (uint32_t c = 0; c < 3; c++)
        z[c] = q->scale * sum_lanes(&sum[c]);
}

static void expand(const struct bounce_piece *q, const float *y, uint32_t basis, uint32_t points,
                   float out[3][TRANSPORT_POINTS])
{
    const uint16_t *v = q->halves, *u = v + (size_t)q->rank * 3 * q->basis;

    memset(out, 0, 3 * TRANSPORT_POINTS * sizeof(float));
    for (uint32_t k = 0; q->halves && k < q->rank; k++, u += points, v += 3 * q->basis) {
        float z[3];
        project(q, v, y, basis, z);
        for (uint32_t p = 0; p < points; p += PACKET) {
            struct lanes x;
            widen_lanes(u + p, &x);
            for (int c = 0; c < 3; c++) {
                float *to = out[c] + p;
                LANES(l) to[l] += x.v[l] * z[c];
            }
        }
    }
}

static void paint(const struct shade_packet *p, uint32_t row, float x[3][TRANSPORT_POINTS], uint32_t first, float *lo)
{
    const bool below = row == 0 && p->kind == LOBE_GGX; /* a matte part below a glossy one, transport_parts.h */

    for (int c = 0; c < 3; c++, lo += PACKET) {
        const float *f0 = p->specular[c], *colour = row == 0 ? p->diffuse[c] : f0, *from = x[c] + first;
        LANES(l)
        {
            const float light = from[l] > 0.0f ? from[l] : 0.0f, through = 1.0f - f0[l];
            const float one = row == 2 ? 1.0f : colour[l];
            lo[l] += light * (below ? through * through * one : one);
        }
    }
}

extern const struct bounce_kernels JOIN(bounce_kernels_, KERNEL_LEVEL);
const struct bounce_kernels JOIN(bounce_kernels_, KERNEL_LEVEL) = { add, expand, paint };
