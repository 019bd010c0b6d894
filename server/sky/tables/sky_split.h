/* The sun/sky split: divides an environment map at a brightness level into a lower part, held as the means of 1,536
 * cells, and a sun, held as single texels. The caches of direct and indirect light, the light tracer and the
 * caustic store use it.
 *
 * The lower part keeps the share (level / g)^2 of a texel with luminance g above the level. This is continuous at the
 * level and leaves almost none of a sun in the lower part. The energies of both parts add up to the map's. The level is
 * sky_level's (sky/tables/sky_table.h), rounded to half an octave: so it mostly stays when a part of the sky
 * changes, and with it every bit of a sun. A map with less than 1/16 of the sphere lit has no level and is entirely
 * bright. A sun with less than a thousandth of the energy stays in the cells.
 *
 * Thread: one per struct sky_split; then any number may read. The results do not depend on the number of threads. */
#pragma once

#include "base/err.h"
#include "sky/tables/environment.h"

#include <stdbool.h>
#include <stdint.h>

#define SKY_EDGE 16                                  /* cells along a face's edge */
#define SKY_CELLS (CUBE_FACES * SKY_EDGE * SKY_EDGE) /* 1536 */
#define SKY_CHUNK 16                                 /* cells, 4 x 4 of a face */
#define SKY_CHUNKS (SKY_CELLS / SKY_CHUNK)

/* Index of cell (row i, column j) of a face: Morton order within the face, so that 16 consecutive cells are 4 x 4. */
static inline uint32_t sky_cell(uint32_t face, uint32_t i, uint32_t j)
{
    uint32_t place = 0;

    for (uint32_t b = 0; b < 4; b++)
        place |= (j >> b & 1u) << 2 * b | (i >> b & 1u) << (2 * b + 1);
    return face * SKY_EDGE * SKY_EDGE + place;
}

/* The lower part's share of a texel of luminance g, 0..1. */
static inline float sky_lower(float level, float g)
{
    return g > level ? level / g * (level / g) : 1.0f;
}

struct sky_split {
    bool unsplit;                                       /* in: put everything in the cells */
    _Alignas(64) float cells[SKY_CHUNKS][3][SKY_CHUNK]; /* mean radiance of the lower part */
    float level;                                        /* 0: none; infinite: everything is in the cells */
    uint32_t n;                                         /* of the environment */
    uint32_t sun_count, sun_capacity;
    uint32_t *sun;      /* [sun_count]: index into environment.texels, ascending */
    double *sun_cdf;    /* CDF of luminance above the level x solid angle */
    double sun_energy;  /* its total */
    float *row_max;        /* [6][n] */
    uint32_t row_capacity; /* of row_max */
};

/* Splits an environment, which must be ready. Memory is reused from frame to frame. ERR_NOMEM. */
MUST_CHECK enum err sky_split_take(struct sky_split *s, const struct environment *e);

#define SKY_SPLIT_PARTS (CUBE_FACES * SKY_EDGE)

/* As sky_split_take in two steps: everything but the cells, then each of SKY_SPLIT_PARTS parts of the cells.
 * ERR_NOMEM. */
MUST_CHECK enum err sky_split_begin(struct sky_split *s, const struct environment *e);
void sky_split_part(struct sky_split *s, const struct environment *e, uint32_t part); /* thread: any */

void sky_split_finish(struct sky_split *s); /* frees the memory; zeroed memory is allowed */

/* Solid angle of a cell, sr. place: of sky_cell. */
double sky_cell_solid_angle(uint32_t place);

/* Samples a unit direction of the sun in proportion to energy, from x in [0, 1)^2. rgb: the sun's
 * radiance there divided by the probability density. sun_count must be > 0. */
void sky_split_sample(const struct sky_split *s, const struct environment *e, const double x[2], float w[3],
                      float rgb[3]);

/* The probability density with which sky_split_sample draws w, sr^-1; 0 outside the sun. */
float sky_split_density(const struct sky_split *s, const struct environment *e, const float w[3]);
