/* Sampling tables for multiple importance sampling at shading points: the cube map's densities, compensated for MIS and
 * stratified into cells of the faces and the sun. The light tracer and eye paths do not use them: they sample the whole
 * sky as one table (environment_sample).
 *
 * Let g(t) be luminance x solid angle of texel t.
 * - Plain: samples of a cell are drawn in proportion to g over its texels.
 * - Sun: if there is a sun (below), cells keep the part of its texels up to level c, and the stratum `sun` takes the
 *   part above it. A direction in such a texel has two densities, both of which belong in the denominator of the
 * balance heuristic; the radiance is always the whole texel's.
 * - Compensated [Karlik et al. 2019]: cells keep max(0, g - half the clamped mean x solid angle), for MIS with BRDF
 *   samples only, which cover the rest. Some texel is always brighter than half the mean, so that not everything
 * becomes 0; if the clamped mean is 0 the table stays plain.
 *
 * The clamped mean m is the sky's mean with every texel clamped at c = 16 m (see sky_table.c), which excludes the sun.
 * The sun is the texels brighter than c within 2.5 degrees of the brightest one; it exists if their part above c is at
 * least a tenth of the sky's energy.
 *
 * Thread: one at a time may build; then any number may read. Memory is reused from frame to frame. */
#pragma once

#include "base/err.h"
#include "sky/tables/environment.h"

#include <stdbool.h>
#include <stdint.h>

#define CELLS_MAX 8                                           /* per edge of a face */
#define STRATA_CELLS_MAX (CUBE_FACES * CELLS_MAX * CELLS_MAX) /* 384 */

struct sky_table_desc {
    uint32_t cells;  /* per edge of a face: 1, 2, 4 or 8, a divisor of n */
    bool sun;        /* separate the sun, if there is one */
    bool compensate; /* compensate for MIS */
};

struct sky_table {
    const struct environment *environment; /* of the last build; borrowed */
    struct sky_table_desc desc;
    uint32_t n, cells, strata; /* strata: 6 cells^2; stratum (face cells + i) cells + j for row i, column j */
    double *energy;            /* [strata]: sum of the shaped g, W m^-2 up to the scale */
    float (*corner)[4][3];     /* [strata]: unit vectors to the cell's corners, for F of [LPG13, Eq. 3] */
    float *density;            /* [6][n][n]: shaped luminance x solid angle x n^2 / 4, as texel.density */
    double *row_cdf;           /* [6][n][n]: CDF of the shaped g along each row within each cell */
    double *cell_cdf;          /* [6][cells][n]: CDF over rows within each cell, by face, column of cells, row */

    float mean;           /* m, in units of luminance; 0 unless sun or compensation was requested */
    float level;          /* c */
    bool has_sun;         /* requested, and there is one */
    double sun_energy;    /* sum of g above the level; 0 without a sun */
    float sun_axis[3];    /* unit */
    float sun_spread;     /* radians: no texel of the sun extends further from the axis */
    uint32_t sun_count;   /* texels */
    uint32_t *sun_texels; /* [sun_count]: indices into environment.texels, ascending */
    double *sun_cdf;      /* [sun_count] */
    bool compensated;     /* requested, and the mean is > 0 */

    float *row_max; /* [6][n]: maximum luminance of each row of texels */
    uint32_t sun_capacity;
};

/* The level c of a sky, 16 times its clamped mean; 0 if less than 1/16 of the sphere is lit. row_max: float[6][n], out:
 * maximum luminance of each row of texels. The result does not depend on the number of threads. */
float sky_level(const struct environment *e, float *row_max);

struct sun_place { /* degrees; azimuth from north (+Z) over east (-X), 0 to 360 */
    double elevation, azimuth;
};

/* The middle of the environment's sun. False: there is none, or no memory. */
bool sky_find_sun(const struct environment *e, struct sun_place *out);

/* Builds the table. e must be ready and unchanged while the table is used. ERR_USAGE: cells is not 1, 2, 4 or 8 or does
 * not divide n. ERR_NOMEM. On error the table must not be used. The result does not depend on the number of OpenMP
 * threads. */
MUST_CHECK enum err sky_table_build(struct sky_table *t, const struct environment *e,
                                    const struct sky_table_desc *desc);
void sky_table_finish(struct sky_table *t); /* frees the table; zeroed memory is allowed */

/* Samples a unit direction of a stratum with energy > 0, from x in [0, 1)^2; stratum number `strata` is the sun. The
 * direction always lies in the texel that x selects, so that sky_table_evaluate gives a density > 0 for that stratum.
 */
void sky_table_invert(const struct sky_table *t, uint32_t stratum, const double x[2], float w[3]);

/* Returns the stratum that contains w; sets the radiance of its texel, the density within the stratum, and the sun's
 * density (0 off the sun), sr^-1. */
uint32_t sky_table_evaluate(const struct sky_table *t, const float w[3], float rgb[3], float *pdf, float *sun_pdf);

/* The sun's density, sr^-1, in a texel brighter than t->level, if has_sun; 0 off the sun. */
float sky_table_sun(const struct sky_table *t, uint32_t texel, float jacobian);
