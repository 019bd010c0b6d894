#include "film/tone_kernel.h"

#include <immintrin.h>

/* A table of 32 floats fits two registers; one instruction looks up 16 of them by 5-bit indices. */
struct table {
    __m512 low, high;
};

static inline struct table load_table(const float *c)
{
    return (struct table){ _mm512_load_ps(c), _mm512_load_ps(c + 16) };
}

static inline __m512 look_up(struct table t, __m512i index)
{
    return _mm512_permutex2var_ps(t.low, index, t.high);
}

void tone_v4(const struct tone_table *t, const float *in, size_t count, float gain, uint8_t *out)
{
    const struct table c0 = load_table(t->c[0]), c1 = load_table(t->c[1]), c2 = load_table(t->c[2]),
                       c3 = load_table(t->c[3]);
    const __m512 factor = _mm512_set1_ps(gain), most = _mm512_set1_ps(255.5f);
    const __m512 lowest = _mm512_set1_ps(TONE_LOWEST), highest = _mm512_set1_ps(TONE_HIGHEST);
    const __m512i place = _mm512_set1_epi32(0x003fff00), one = _mm512_set1_epi32(0x3f800080);
    size_t i = 0;

    for (; i + 16 <= count; i += 16) {
        /* If one operand is NaN, max returns the second: the lowest value. */
        const __m512 exposed = _mm512_max_ps(_mm512_mul_ps(_mm512_loadu_ps(in + i), factor), lowest);
        const __m512i bits = _mm512_castps_si512(_mm512_min_ps(exposed, highest));
        const __m512i index = _mm512_srli_epi32(bits, 22);
        const __m512i within = _mm512_or_si512(_mm512_and_si512(bits, place), one);
        const __m512 u = _mm512_sub_ps(_mm512_castsi512_ps(within), _mm512_set1_ps(1.25f));
        __m512 y = _mm512_add_ps(_mm512_mul_ps(look_up(c3, index), u), look_up(c2, index));
        y = _mm512_add_ps(_mm512_mul_ps(y, u), look_up(c1, index));
        y = _mm512_add_ps(_mm512_mul_ps(y, u), look_up(c0, index));
        const __m512i code = _mm512_cvttps_epi32(_mm512_min_ps(y, most));
        _mm_storeu_si128((__m128i *)(out + i), _mm512_cvtepi32_epi8(code));
    }
    tone_ref(t, in + i, count - i, gain, out + i);
}
