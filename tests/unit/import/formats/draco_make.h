/* Compresses a grid of squares with Draco's encoder, which is C++. */
#pragma once

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* (side + 1)^2 vertices (x, y, 0) and (u, v) = (x, y), 2 side^2 triangles towards +z. Attribute 0 are positions, 1
 * texture coordinates as normalized 16-bit numbers of x / side, y / side. Returns the size; the caller frees *out. 0:
 * it failed. */
size_t draco_make_grid(uint32_t side, uint8_t **out);

#ifdef __cplusplus
}
#endif
