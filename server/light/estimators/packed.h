/* What stored paths and gazes carry, packed into 4 bytes each: directions and colours.
 *
 * Directions: 3 bits of face, 14 of row and 14 of column of a cube map with 2^14 texels per edge. On any
 * cube map whose edge divides that, the texel is the one of cube_texel; on others possibly a neighbour. Thread: any. */
#pragma once

#include "sky/tables/cube.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#define DIRECTION_BITS 14 /* two of them and the face fit 32 bits */

/* w: unit. */
static inline uint32_t direction_pack(const float w[3])
{
    float u, v;

    return cube_texel(1u << DIRECTION_BITS, w, &u, &v); /* face, row and column have separate bits */
}

/* Its face, and the middle of its texel there. */
static inline uint32_t direction_face(uint32_t packed)
{
    return packed >> 2 * DIRECTION_BITS;
}

static inline float direction_u(uint32_t packed)
{
    const uint32_t edge = 1u << DIRECTION_BITS;

    return ((float)(int32_t)(packed & (edge - 1)) + 0.5f) * (2.0f / (float)edge) - 1.0f;
}

static inline float direction_v(uint32_t packed)
{
    return direction_u(packed >> DIRECTION_BITS);
}

/* Index of its texel in a cube map of n texels per edge. */
static inline uint32_t direction_texel(uint32_t packed, uint32_t n)
{
    const uint32_t mask = (1u << DIRECTION_BITS) - 1, row = packed >> DIRECTION_BITS & mask, column = packed & mask;

    return (direction_face(packed) * n + (row * n >> DIRECTION_BITS)) * n + (column * n >> DIRECTION_BITS);
}

/* Whether it came from direction_pack: those read from a file may not. */
static inline bool direction_is_packed(uint32_t packed)
{
    return direction_face(packed) < CUBE_FACES;
}

/* ---- Colours ---- */

/* Three numbers as bytes with a shared power of two [Ward 1991]: what a stored splat carries. */

#define POWER_MAX 200 /* 2^73, larger than any real value */

/* Rounds stochastically by u in [0, 1), so that the mean is exact; the same u for all three, so that grey stays grey.
 * The first number is in the lowest byte, the power in the highest. 0 if they are too small. */
static inline uint32_t power_pack(const float rgb[3], double u)
{
    const float most = fmaxf(rgb[0], fmaxf(rgb[1], rgb[2]));
    uint32_t out = 0;
    int power;

    frexpf(most, &power); /* most is in 2^(power - 1) .. 2^power, that is, 128 to 256 times 2^(power - 8) */
    power -= 8;
    if (ldexp((double)most, -power) > 255.0) /* would round up to 256 */
        power++;
    if (!(most > 0.0f) || power < -126)
        return 0;
    if (power > POWER_MAX - 127)
        power = POWER_MAX - 127;
    for (int c = 0; c < 3; c++)
        out |= (uint32_t)fmin(255.0, floor(ldexp((double)rgb[c], -power) + u)) << 8 * c;
    return out | (uint32_t)(power + 127) << 24;
}

/* The value of one unit of a byte. */
static inline float power_unit(uint32_t packed)
{
    const uint32_t bits = packed >> 24 << 23;
    float unit;

    memcpy(&unit, &bits, sizeof(unit));
    return unit;
}
