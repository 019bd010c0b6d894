/* Converts and sums half floats and bytes, a packet at a time. Included by kernels only. */
#pragma once

#include "base/half.h"
#include "scene/surface/lanes.h"

#if defined(__F16C__) || defined(__AVX2__)
#include <immintrin.h>
#endif

/* Converts sixteen half floats. */
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

/* Converts sixteen bytes. */
static inline void widen_bytes(const int8_t *in, struct lanes *out)
{
#if defined(__AVX512F__)
    const __m128i x = _mm_loadu_si128((const __m128i *)(const void *)in);
    _mm512_store_ps(out->v, _mm512_cvtepi32_ps(_mm512_cvtepi8_epi32(x)));
#elif defined(__AVX2__)
    const __m128i x = _mm_loadu_si128((const __m128i *)(const void *)in);
    _mm256_store_ps(out->v, _mm256_cvtepi32_ps(_mm256_cvtepi8_epi32(x)));
    _mm256_store_ps(out->v + 8, _mm256_cvtepi32_ps(_mm256_cvtepi8_epi32(_mm_srli_si128(x, 8))));
#else
    LANES(l) out->v[l] = (float)in[l];
#endif
}

/* Sums the sixteen lanes of each of three vectors, in the same order at all CPU levels: (((0 + 8) + (4 + 12)) + ((2 +
 * 10) + (6 + 14))) + the same for odd lanes. The three sums run in parallel. */
static inline void sum_lanes(const struct lanes x[3], float out[3])
{
    struct {
        float v __attribute__((vector_size(16)));
    } a[3][4], sum[3], by_lane[4];

    for (int c = 0; c < 3; c++) {
        memcpy(a[c], x[c].v, sizeof(a[c]));
        sum[c].v = (a[c][0].v + a[c][2].v) + (a[c][1].v + a[c][3].v);
    }
    for (int l = 0; l < 4; l++)
        by_lane[l].v = (__typeof__(by_lane[l].v)){ sum[0].v[l], sum[1].v[l], sum[2].v[l], 0.0f };
    by_lane[0].v = (by_lane[0].v + by_lane[2].v) + (by_lane[1].v + by_lane[3].v);
    memcpy(out, &by_lane[0].v, 3 * sizeof(*out));
}
