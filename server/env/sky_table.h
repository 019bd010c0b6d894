/* server/env/sky_table.h */
/* The cube map's densities shaped for balanced multiple importance sampling at shade points, and cut into strata: cells
 * of the faces, and the sun by itself. The light tracer and eye paths do not use it: their one table is that of
 * environment.h (samples_whole), which holds everything.
 *
 * Let g(t) be the importance (luminance, mean or maximum) x solid angle of texel t.
 * - Plain: a cell's samples are drawn in proportion to g over the cell's texels.
 * - Sun out: where there is a sun (below), the cells keep of its texels the part up to the level c and the stratum
 * `sun` takes the part above it, in proportion. A direction on such a texel has two densities, and both belong into the
 *   denominator of the balance heuristic; the radiance is always the whole texel's.
 * - Compensated [Karlik et al. 2019]: cells keep max(0, g - half of the clamped mean x solid angle), for MIS with the
 *   lobes only, which cover what becomes 0. Some texel is always brighter than half of the mean, so that not everything
 *   becomes 0; where the clamped mean is 0 the table stays plain.
 *
 * The clamped mean m is the sky's mean with every texel cut at c = 16 m (sky_table.c has the reasons), which leaves the
 * sun out. A sun: the texels brighter than c within 2.5 degrees of the brightest; there is one when their part above c
 * is at least a tenth of the sky's energy.
 *
 * sky_table_build is for one thread at a time; then any number may read. Memory is reused from frame to frame. */
#ifndef ENV_SKY_TABLE_H
#define ENV_SKY_TABLE_H

#include "environment.h"
#include "err.h"

#include <stdbool.h>
#include <stdint.h>

#define CELLS_MAX 8                                           /* along a face's edge */
#define STRATA_CELLS_MAX (CUBE_FACES * CELLS_MAX * CELLS_MAX) /* 384 */

struct sky_table_desc {
    uint32_t cells;  /* along a face's edge: 1, 2, 4 or 8, a divisor of n */
    bool sun;        /* take the sun out, if there is one */
    bool compensate; /* reshape for MIS */
};

struct sky_table {
    const struct environment *environment; /* of the last build */
    struct sky_table_desc desc;
    uint32_t n, cells, strata; /* strata: 6 cells^2; stratum (face cells + i) cells + j, rows i, columns j */
    double *energy;            /* [strata]: sum of the shaped g, W m^-2 up to the scale */
    float (*corner)[4][3];     /* [strata]: unit vectors of the cell's corners, for F of [LPG13, Eq. 3] */
    float *density;            /* [6][n][n]: shaped importance x solid angle x n^2 / 4, as texel.density */
    double *row_cdf;           /* [6][n][n]: running sums along each row of the shaped g, begun anew in each cell */
    double *cell_cdf;          /* [6][cells][n]: face, column of cells, row: running sums, begun anew in each cell */

    float mean;           /* m, in units of importance; 0 unless sun or compensation was asked for */
    float level;          /* c */
    bool has_sun;         /* asked for, and there is one */
    double sun_energy;    /* sum of the g above the level; 0 where there is no sun */
    float sun_axis[3];    /* unit */
    float sun_spread;     /* radians: no part of a texel of the sun is further from the axis */
    uint32_t sun_count;   /* texels */
    uint32_t *sun_texels; /* [sun_count]: index into environment.texels, ascending */
    double *sun_cdf;      /* [sun_count] */
    bool compensated;     /* asked for, and there was a mean to take away */

    enum importance importance; /* of the build */
    float *row_max;             /* [6][n]: the brightest importance of each row of texels */
    uint32_t sun_capacity;
};

/* The level c of a sky, 16 times its clamped mean; 0 where less than 1/16 of the sphere is lit, and there is none.
 * row_max: float[6][n], out: the brightest importance of each row of texels. The same bits at any number of threads. */
float sky_level(const struct environment *e, float *row_max);

/* e must be ready, and stay as it is while the table is used. ERR_NOMEM; ERR_USAGE when cells is not 1, 2, 4 or 8 or
 * does not divide n. On an error the table must not be read. The same bits at any number of OpenMP threads. */
MUST_CHECK enum err sky_table_build(struct sky_table *t, const struct environment *e,
                                    const struct sky_table_desc *desc);
void sky_table_finish(struct sky_table *t); /* zeroed memory is allowed */

/* A direction (unit) of a stratum with energy > 0, from x in [0, 1)^2; stratum `strata` is the sun. It is always in the
 * very texel that x falls in, so that sky_table_evaluate finds it in that stratum with a density > 0. */
void sky_table_invert(const struct sky_table *t, uint32_t stratum, const double x[2], float w[3]);

/* The stratum that w falls in, radiance of its texel, density within that stratum, and the sun's density there (0 off
 * the sun); sr^-1. */
uint32_t sky_table_evaluate(const struct sky_table *t, const float w[3], float rgb[3], float *pdf, float *sun_pdf);

/* The sun's density at a place of a texel that is brighter than t->level, where has_sun: 0 off the sun. */
float sky_table_sun(const struct sky_table *t, uint32_t texel, float jacobian);

#endif
