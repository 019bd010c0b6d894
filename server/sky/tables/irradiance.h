/* The irradiance of surfaces that nothing occludes: a plane that faces upward, in closed form, and of any normal, as
 * the part of direct light that is known without a ray. */
#pragma once

#include "sky/tables/environment.h"
#include "sky/tables/sky_split.h"
#include "sky/tables/sky_table.h"

/* The irradiance of an unoccluded horizontal plane that faces +Y, by the sampled function: six faces of piecewise
 * constant radiance (cube.h), sun included,
 *     E = sum over texels  L  integral over the texel of max(0, w.y) dw,
 * where the integrals are closed forms. On a face with coordinates (u, v) at distance 1, dw = (1 + u^2 + v^2)^-3/2 du
 * dv and the cosine is 1 or v over (1 + u^2 + v^2)^1/2: differences of the corner integrals face +Y:  (v/b atan(u/b) +
 * u/a atan(v/a)) / 2,  a = sqrt(1 + u^2), b = sqrt(1 + v^2) a side:   -atan(u/b) / (2 b),  v along +Y. Thread: any. */

/* The integrals for cube maps of n x n texels, sr: out[2][n][n], of face +Y and of a side, there with rows along +Y.
 * n even or 1, so that no texel crosses the horizon; a side's lower half is 0. */
void irradiance_weights(uint32_t n, double *out);

/* E of a frame, which must be ready, by the weights of its n. */
void irradiance_upward(const struct environment *e, const double *weights, double rgb[3]);

/* ---- Of any normal ---- */

/* How matte surfaces take light from w: in proportion to c = n.w, or, below a microfacet lobe, to c (1 - (1 - c)^5)
 * (scene/surface/lobes.h). */
enum irradiance_kind { IRRADIANCE_COSINE, IRRADIANCE_ENTERING, IRRADIANCE_KINDS };

#define IRRADIANCE_EDGE 24 /* of a face, intervals between normals */

/* E(n) = integral of k(n.w) L(w) dw over the whole sphere but for the sun's texels, if the table has a sun, at a grid
 * of normals on the faces of a cube, from SKY_CELLS cells; between normals bilinear. Right to 0.02 % under even skies,
 * 0.1 % under others and where a cell is a texel. Thread: one at a time may build, on all OpenMP threads, whose number
 * does not change the result; then any may read. */
struct irradiance {
    float rgb[IRRADIANCE_KINDS][CUBE_FACES][IRRADIANCE_EDGE + 1][IRRADIANCE_EDGE + 1][3];
    struct irradiance_cells {                           /* the sky's light by cells, of which the above is made */
        float x[SKY_CELLS], y[SKY_CELLS], z[SKY_CELLS]; /* mean direction, a little shorter than 1 */
        float spread[SKY_CELLS];                        /* about it */
        float rgb[3][SKY_CELLS];                        /* flux */
        double weight[SKY_CELLS];
    } cells;
};

/* t: NULL, or a table of e, whose sun is left out. */
void irradiance_build(struct irradiance *out, const struct environment *e, const struct sky_table *t);

/* E of a unit normal. */
void irradiance_at(const struct irradiance *r, enum irradiance_kind kind, const float normal[3], float rgb[3]);
