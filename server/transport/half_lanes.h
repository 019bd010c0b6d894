/* Half floats and bytes as kernels read them, a packet at a time. Included by the kernels only. */
#ifndef TRANSPORT_HALF_LANES_H
#define TRANSPORT_HALF_LANES_H

#include "base/half.h"
#include "brdf/lanes.h"

#if defined(__F16C__) || defined(__AVX2__)
#include <immintrin.h>
#endif

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

/* Sixteen bytes. */
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

#endif
