/* The irradiance of an unoccluded horizontal plane that faces +Y, by the sampled function: six faces of piecewise
 * constant radiance (cube.h), sun included,
 *     E = sum over texels  L  integral over the texel of max(0, w.y) dw,
 * where the integrals are closed forms. On a face with coordinates (u, v) at distance 1, dw = (1 + u^2 + v^2)^-3/2 du
 * dv and the cosine is 1 or v over (1 + u^2 + v^2)^1/2: differences of the corner integrals face +Y:  (v/b atan(u/b) +
 * u/a atan(v/a)) / 2,  a = sqrt(1 + u^2), b = sqrt(1 + v^2) a side:   -atan(u/b) / (2 b),  v along +Y. Thread: any. */
#pragma once

#include "sky/tables/environment.h"

/* The integrals for cube maps of n x n texels, sr: out[2][n][n], of face +Y and of a side, there with rows along +Y.
 * n even or 1, so that no texel crosses the horizon; a side's lower half is 0. */
void irradiance_weights(uint32_t n, double *out);

/* E of a frame, which must be ready, by the weights of its n. */
void irradiance_upward(const struct environment *e, const double *weights, double rgb[3]);
