/* A frame's sky as the cache of light transport takes it: split at a level into a part that is kept by cells' means and
 * a bright part that is kept by texels. Of a texel of importance g above the level the lower part has (level / g)^2, so
 * that nothing jumps where a texel comes up to the level, and that of a sun, far above it, next to nothing is left
 * behind. Energies of the two add up to the sky's. The level is that of sky_table.h; a sky of which less than 1/16 is
 * lit has none, and is bright as a whole. A bright part of less than a thousandth of the energy stays in the cells. */
#ifndef SHADE_TRANSPORT_SKY_H
#define SHADE_TRANSPORT_SKY_H

#include "environment.h"
#include "err.h"

#include <stdbool.h>
#include <stdint.h>

#define TRANSPORT_EDGE 16                                              /* cells along a face's edge */
#define TRANSPORT_CELLS (CUBE_FACES * TRANSPORT_EDGE * TRANSPORT_EDGE) /* 1536 */
#define TRANSPORT_CHUNK 16                                             /* cells, 4 x 4 of a face */
#define TRANSPORT_CHUNKS (TRANSPORT_CELLS / TRANSPORT_CHUNK)

/* The place of a face's cell (row i, column j): Morton order within the face, so that 16 that follow are 4 x 4. */
static inline uint32_t transport_cell(uint32_t face, uint32_t i, uint32_t j)
{
    uint32_t place = 0;

    for (uint32_t b = 0; b < 4; b++)
        place |= (j >> b & 1u) << 2 * b | (i >> b & 1u) << (2 * b + 1);
    return face * TRANSPORT_EDGE * TRANSPORT_EDGE + place;
}

/* The lower part's share of a texel of importance g. */
static inline float transport_lower(float level, float g)
{
    return g > level ? level / g * (level / g) : 1.0f;
}

struct transport_sky {
    bool unsplit;                                                   /* in: all stays in the cells, whatever the sky */
    _Alignas(64) float cells[TRANSPORT_CHUNKS][3][TRANSPORT_CHUNK]; /* mean radiance of the lower part */
    float level; /* 0: there is none; infinite: all is in the cells */
    uint32_t n;  /* of the environment */
    uint32_t bright_count, bright_capacity;
    uint32_t *bright;      /* [bright_count]: index into environment.texels, ascending */
    double *bright_cdf;    /* running sums of their importance above the level x solid angle */
    double bright_energy;  /* the last of them */
    float *row_max;        /* [6][n] */
    uint32_t row_capacity; /* of row_max */
};

/* e must be ready. Memory is reused from frame to frame. The same bits at any number of threads. ERR_NOMEM. */
MUST_CHECK enum err transport_sky_take(struct transport_sky *s, const struct environment *e);

/* The same in steps: all but the cells, and then each of TRANSPORT_SKY_PARTS, on any thread. */
#define TRANSPORT_SKY_PARTS (CUBE_FACES * TRANSPORT_EDGE)
MUST_CHECK enum err transport_sky_begin(struct transport_sky *s, const struct environment *e);
void transport_sky_part(struct transport_sky *s, const struct environment *e, uint32_t part);

void transport_sky_finish(struct transport_sky *s); /* zeroed memory is allowed */

/* Solid angle of a cell, sr, by its place. */
double transport_cell_solid_angle(uint32_t place);

/* A direction (unit) of the bright part by its energy, from x in [0, 1)^2, and the bright part's radiance there over
 * the direction's density. bright_count must be above 0. */
void transport_sky_sample(const struct transport_sky *s, const struct environment *e, const double x[2], float w[3],
                          float rgb[3]);

/* The density by which the former draws w, per sr; 0 outside of the bright part. */
float transport_sky_density(const struct transport_sky *s, const struct environment *e, const float w[3]);

#endif
