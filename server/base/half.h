/* Half floats (IEEE 754 binary16), as EXR files and the caches of light store them. Integer arithmetic gives the bits
 * of the processor's own instructions without denormals, which shading flushes to zero. Thread: any. */
#pragma once

#include <stdint.h>
#include <string.h>

#define HALF_MAX 65504.0f /* the largest finite one */

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

/* Rounds to the nearest, ties to even; from 65520 on to infinity. Also without branches. */
static inline uint16_t half_round(float f)
{
    uint32_t bits, small;

    memcpy(&bits, &f, sizeof(bits));
    const uint32_t sign = bits >> 16 & 0x8000u;
    bits &= 0x7fffffffu;
    memcpy(&f, &bits, sizeof(f));
    f += 0.5f; /* of which a unit in the last place is 2^-24, as of halves below 2^-14 */
    memcpy(&small, &f, sizeof(small));
    small -= 0x3f000000u;
    /* From 2^-14 on a half has its own exponent; a carry runs into it, up to infinity at 2^16. */
    const uint32_t normal = (bits + 0xfffu + (bits >> 13 & 1u) - (112u << 23)) >> 13;
    const uint32_t large = 0x7c00u | (0x7f800000u - bits) >> 31 << 9;
    /* Masks, since compilers make branches of conditions, and then no vectors: the sign of a difference of 31 bits. */
    const uint32_t is_small = (uint32_t)((int32_t)(bits - 0x38800000u) >> 31);
    const uint32_t is_finite = (uint32_t)((int32_t)(bits - 0x47800000u) >> 31);
    const uint32_t half = (((small & is_small) | (normal & ~is_small)) & is_finite) | (large & ~is_finite);
    return (uint16_t)(sign | half);
}
