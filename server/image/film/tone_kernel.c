/* The loop of tone_kernel.h: compiled once per CPU level, see CMakeLists.txt. */
#include "image/film/tone_kernel.h"

#include <string.h>

#ifdef __AVX512F__
#include <immintrin.h>
#endif

#define INDEX_BIT 22      /* lowest bit of a float's half-octave index */
#define PLACE 0x003fff00  /* bits of the place within a half octave */
#define MIDDLE 0x3f800080 /* the exponent of 1, and half of the bits that are dropped */

static void codes_in_turn(const struct tone_table *restrict t, const float *restrict in, size_t count, float gain,
                          uint8_t *restrict out)
{
    for (size_t i = 0; i < count; i++) {
        /* The comparisons are written so that NaN fails the first one and yields the lowest value. */
        const float exposed = in[i] * gain;
        const float floored = exposed > TONE_LOWEST ? exposed : TONE_LOWEST;
        const float x = floored < TONE_HIGHEST ? floored : TONE_HIGHEST;
        uint32_t bits, place;
        float u;
        memcpy(&bits, &x, sizeof(bits));
        place = (bits & PLACE) | MIDDLE;
        memcpy(&u, &place, sizeof(u));
        u -= 1.25f;
        const uint32_t s = bits >> INDEX_BIT & (TONE_SEGMENTS - 1);
        const float y = ((t->c[3][s] * u + t->c[2][s]) * u + t->c[1][s]) * u + t->c[0][s];
        out[i] = (uint8_t)(int32_t)(y < 255.5f ? y : 255.5f);
    }
}

#ifdef __AVX512F__

/* Looks up 16 values of a table of 32 floats, which fits two registers, by 5-bit indices. */
static inline __m512 look_up(const float *c, __m512i index)
{
    return _mm512_permutex2var_ps(_mm512_load_ps(c), index, _mm512_load_ps(c + 16));
}

static void codes(const struct tone_table *t, const float *in, size_t count, float gain, uint8_t *out)
{
    const __m512 factor = _mm512_set1_ps(gain), most = _mm512_set1_ps(255.5f);
    const __m512 lowest = _mm512_set1_ps(TONE_LOWEST), highest = _mm512_set1_ps(TONE_HIGHEST);
    size_t i = 0;

    for (; i + 16 <= count; i += 16) {
        /* If one operand is NaN, max returns the second: the lowest value. */
        const __m512 exposed = _mm512_max_ps(_mm512_mul_ps(_mm512_loadu_ps(in + i), factor), lowest);
        const __m512i bits = _mm512_castps_si512(_mm512_min_ps(exposed, highest));
        const __m512i index = _mm512_srli_epi32(bits, INDEX_BIT);
        const __m512i within =
            _mm512_or_si512(_mm512_and_si512(bits, _mm512_set1_epi32(PLACE)), _mm512_set1_epi32(MIDDLE));
        const __m512 u = _mm512_sub_ps(_mm512_castsi512_ps(within), _mm512_set1_ps(1.25f));
        __m512 y = _mm512_add_ps(_mm512_mul_ps(look_up(t->c[3], index), u), look_up(t->c[2], index));
        y = _mm512_add_ps(_mm512_mul_ps(y, u), look_up(t->c[1], index));
        y = _mm512_add_ps(_mm512_mul_ps(y, u), look_up(t->c[0], index));
        const __m512i code = _mm512_cvttps_epi32(_mm512_min_ps(y, most));
        _mm_storeu_si128((__m128i *)(out + i), _mm512_cvtepi32_epi8(code));
    }
    codes_in_turn(t, in + i, count - i, gain, out + i);
}

#else

/* The compiler vectorises it, at v3 with gathers of four floats. */
static void codes(const struct tone_table *t, const float *in, size_t count, float gain, uint8_t *out)
{
    codes_in_turn(t, in, count, gain, out);
}

#endif

extern const struct tone_kernel KERNEL(tone_kernel);
const struct tone_kernel KERNEL(tone_kernel) = { KERNEL_CPU, codes };
