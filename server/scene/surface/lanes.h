/* Arithmetic on 16 lanes at once, in plain C that the compiler vectorises. Included only by the kernels. */
#pragma once

#include "scene/surface/packet.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

/* Never unrolled: otherwise gcc unrolls a nested loop before vectorising it and then fails to vectorise. */
#define LANES(l) _Pragma("GCC unroll 1") for (int l = 0; l < PACKET; l++)

struct lanes {
    _Alignas(64) float v[PACKET];
};

/* log2 for normal positive x, relative error below 3e-7: the atanh series about 1 after removing the exponent, so that
 * x near 1, where a sharp lobe lives, keeps its relative precision. */
static inline float lane_log2(float x)
{
    uint32_t bits;
    memcpy(&bits, &x, sizeof(bits));
    const uint32_t shifted = bits - 0x3f3504f3u; /* sqrt(1/2): the mantissa is reduced to [sqrt(1/2), sqrt(2)) */
    const int32_t exponent = (int32_t)shifted >> 23;
    const uint32_t mantissa_bits = bits - ((uint32_t)exponent << 23);
    float m;
    memcpy(&m, &mantissa_bits, sizeof(m));
    const float s = (m - 1.0f) / (m + 1.0f), s2 = s * s;
    const float series =
        s * (2.88539008f + s2 * (0.96179669f + s2 * (0.57707802f + s2 * (0.41219859f + s2 * 0.32059890f))));
    return (float)exponent + series;
}

/* 2^x for x <= 127, relative error below 3e-7; 0 below -126. */
static inline float lane_exp2(float x)
{
    const float clamped = x < -126.0f ? -126.0f : x;
    /* Adding and subtracting 1.5 * 2^23 rounds to the nearest integer without a function call. */
    const float whole = (clamped + 12582912.0f) - 12582912.0f, f = clamped - whole;
    const float p =
        1.0f +
        f * (0.69314718f +
             f * (0.24022651f + f * (0.055504109f + f * (0.0096181291f + f * (0.0013333558f + f * 0.00015403530f)))));
    const uint32_t bits = (uint32_t)((int32_t)whole + 127) << 23;
    float scale;
    memcpy(&scale, &bits, sizeof(scale));
    return x < -126.0f ? 0.0f : scale * p;
}

/* Sine and cosine of 2 pi u for u in [0, 1), absolute error below 2e-7: Taylor series about the nearest quarter turn.
 */
static inline void lane_sincos(float u, float *sine, float *cosine)
{
    const float turns = 4.0f * u, nearest = (turns + 12582912.0f) - 12582912.0f;
    const int32_t quarter = (int32_t)nearest;
    const float x = 1.57079633f * (turns - nearest), x2 = x * x;
    const float s =
        x * (1.0f + x2 * (-0.166666667f + x2 * (8.33333333e-3f + x2 * (-1.98412698e-4f + x2 * 2.75573192e-6f))));
    const float c =
        1.0f +
        x2 * (-0.5f + x2 * (4.16666667e-2f + x2 * (-1.38888889e-3f + x2 * (2.48015873e-5f - x2 * 2.75573192e-7f))));
    const float a = quarter & 1 ? c : s, b = quarter & 1 ? s : c;
    *sine = quarter & 2 ? -a : a;
    *cosine = (quarter + 1) & 2 ? -b : b;
}

/* max(0, x)^n for n >= 0; 0 where x is not positive. */
static inline float lane_power(float x, float n)
{
    const float held = x > 1e-30f ? x : 1e-30f;
    const float p = lane_exp2(n * lane_log2(held));
    return x > 0.0f ? p : 0.0f;
}
