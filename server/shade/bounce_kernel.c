/* The loops of the cache of interreflection (bounce_parts.h): compiled once per CPU level, see CMakeLists.txt. */
#include "bounce_parts.h"
#include "half.h"
#include "lanes.h"

#ifdef __F16C__
#include <immintrin.h>
#endif

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)

/* Sixteen half floats. */
static inline void widen_lanes(const uint16_t *in, struct lanes *out)
{
#if defined(__AVX512F__)
    _mm512_store_ps(out->v, _mm512_cvtph_ps(_mm256_loadu_si256((const __m256i *)(const void *)in)));
#elif defined(__F16C__)
    _mm256_store_ps(out->v, _mm256_cvtph_ps(_mm_loadu_si128((const __m128i *)(const void *)in)));
    _mm256_store_ps(out->v + 8, _mm256_cvtph_ps(_mm_loadu_si128((const __m128i *)(const void *)(in + 8))));
#else
    LANES(l) out->v[l] = half_widen(in[l]);
#endif
}

static void add(float *to, const float *from, const float weight[3], uint32_t basis)
{
    for (int c = 0; c < 3; c++, to += basis, from += basis)
        for (uint32_t k = 0; k < basis; k += PACKET)
            LANES(l) to[k + (uint32_t)l] += weight[c] * from[k + (uint32_t)l];
}

static float product(const uint16_t *v, const float *y, uint32_t basis)
{
    struct lanes sum = { { 0.0f } }, x;
    float a[8];

    for (uint32_t k = 0; k < basis; k += PACKET) {
        widen_lanes(v + k, &x);
        LANES(l) sum.v[l] += x.v[l] * y[k + (uint32_t)l];
    }
    for (int l = 0; l < 8; l++)
        a[l] = sum.v[l] + sum.v[l + 8];
    return ((a[0] + a[4]) + (a[2] + a[6])) + ((a[1] + a[5]) + (a[3] + a[7]));
}

static void expand(const struct bounce_piece *q, const float *y, uint32_t basis, uint32_t points,
                   float out[3][TRANSPORT_POINTS])
{
    const uint16_t *v = q->halves, *u = v + (size_t)q->rank * 3 * basis;

    memset(out, 0, 3 * TRANSPORT_POINTS * sizeof(float));
    for (uint32_t k = 0; q->halves && k < q->rank; k++, u += points) {
        float z[3];
        for (uint32_t c = 0; c < 3; c++, v += basis)
            z[c] = q->scale * product(v, y + c * basis, basis);
        for (uint32_t p = 0; p < points; p += PACKET) {
            struct lanes x;
            widen_lanes(u + p, &x);
            for (int c = 0; c < 3; c++)
                LANES(l) out[c][p + (uint32_t)l] += x.v[l] * z[c];
        }
    }
}

extern const struct bounce_kernels JOIN(bounce_kernels_, KERNEL_LEVEL);
const struct bounce_kernels JOIN(bounce_kernels_, KERNEL_LEVEL) = { add, expand };
