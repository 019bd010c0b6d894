/* server/base/half.h */
/* Half floats (IEEE 754 binary16), as EXR files and the caches of light store them. Integer arithmetic gives the bits
 * of the processor's own instructions without denormals, which shading flushes to zero. Thread: any. */
#ifndef BASE_HALF_H
#define BASE_HALF_H

#include <stdint.h>
#include <string.h>

/* Exact. Without branches, so that loops around it are vectorised: rebiases the exponent from 15 to 127; infinity and
 * NaN have the largest exponent in both, and below 2^-14 halves are multiples of 2^-24. */
static inline float half_widen(uint16_t half)
{
    const uint32_t magnitude = half & 0x7fffu;
    const float small = (float)(int32_t)magnitude * 0x1p-24f;
    uint32_t bits = (magnitude << 13) + 0x38000000u, small_bits;
    float value;

    bits += magnitude >= 0x7c00u ? 0x38000000u : 0u;
    memcpy(&small_bits, &small, sizeof(small_bits));
    bits = magnitude < 0x400u ? small_bits : bits;
    bits |= (uint32_t)(half & 0x8000u) << 16;
    memcpy(&value, &bits, sizeof(value));
    return value;
}

/* Rounds to the nearest, ties to even; from 65520 on to infinity. */
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

#endif
