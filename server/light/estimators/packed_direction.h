/* Directions in 4 bytes: 3 bits of face, 14 of row and 14 of column of a cube map with 2^14 texels per edge. On any
 * cube map whose edge divides that, the texel is the one of cube_texel; on others possibly a neighbour. Private to this
 * room. Thread: any. */
#pragma once

#include "sky/tables/cube.h"

#include <stdint.h>

#define DIRECTION_BITS 14 /* two of them and the face fit 32 bits */

/* w: unit. */
static inline uint32_t direction_pack(const float w[3])
{
    float u, v;

    return cube_texel(1u << DIRECTION_BITS, w, &u, &v); /* face, row and column have separate bits */
}

/* Index of its texel in a cube map of n texels per edge. */
static inline uint32_t direction_texel(uint32_t packed, uint32_t n)
{
    const uint32_t mask = (1u << DIRECTION_BITS) - 1, row = packed >> DIRECTION_BITS & mask, column = packed & mask;

    return ((packed >> 2 * DIRECTION_BITS) * n + (row * n >> DIRECTION_BITS)) * n + (column * n >> DIRECTION_BITS);
}
