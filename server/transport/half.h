/* Half floats (IEEE 754 binary16): what the cache of light transport keeps. Widening is exact and rounding goes to the
 * nearest, ties to even, in whole numbers: the same bits as the processor's own instructions, and no need for
 * denormals, which are flushed where this runs. */
#ifndef TRANSPORT_HALF_H
#define TRANSPORT_HALF_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

static inline float half_widen(uint16_t h)
{
    const uint32_t sign = (uint32_t)(h & 0x8000u) << 16, rest = h & 0x7fffu;
    /* exponents of 15 are biased by 15, of a float by 127; infinity and NaN have the largest in both */
    uint32_t bits = (rest << 13) + (rest >= 0x7c00u ? 224u << 23 : 112u << 23);
    const float small = (float)(int32_t)rest * 0x1p-24f; /* below 2^-14, halves are multiples of 2^-24 */
    float out;

    if (rest < 0x400u)
        memcpy(&bits, &small, sizeof(bits));
    bits |= sign;
    memcpy(&out, &bits, sizeof(out));
    return out;
}

static inline uint16_t half_round(float f)
{
    uint32_t bits;

    memcpy(&bits, &f, sizeof(bits));
    const uint16_t sign = (uint16_t)(bits >> 16 & 0x8000u);
    bits &= 0x7fffffffu;
    if (bits >= 0x47800000u) /* 2^16 and above */
        return (uint16_t)(sign | (bits > 0x7f800000u ? 0x7e00u : 0x7c00u));
    if (bits >= 0x38800000u) /* from 2^-14 on a half has its own exponent; a carry runs into it, up to infinity */
        return (uint16_t)(sign | (bits + 0xfffu + (bits >> 13 & 1u) - (112u << 23)) >> 13);
    if (bits < 0x33000000u) /* below half of the least half */
        return sign;
    const uint32_t mantissa = (bits & 0x7fffffu) | 0x800000u, shift = 126u - (bits >> 23);
    const uint32_t whole = mantissa >> shift, rest = mantissa & ((1u << shift) - 1u), tie = 1u << (shift - 1u);
    return (uint16_t)(sign | (whole + (rest > tie || (rest == tie && (whole & 1u)))));
}

/* A power of two that brings the largest entry between 2^13 and 2^14, where halves reach furthest down. */
static inline float half_scale(const float *x, size_t count)
{
    float most = 0.0f;
    int exponent;

    for (size_t i = 0; i < count; i++)
        most = fmaxf(most, fabsf(x[i]));
    frexpf(most, &exponent);
    return most > 0.0f ? ldexpf(1.0f, exponent - 14) : 1.0f;
}

#endif
