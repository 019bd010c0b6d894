/* server/env/resample.h */
/* From a source layout to the cube map: a sparse table of the solid angles in which source and cube texels overlap,
 * made once per layout, size and rotation (resample_table.h), then applied to every frame. A constant sky stays
 * constant and each source texel's energy arrives whole, both to 1e-5. What a layout does not show (a fisheye's lower
 * hemisphere) takes the mean of what was seen [LPG13, 3]. A picture of many more texels than the cube map can use is
 * first reduced to blocks of factor x factor texels, weighted by solid angle, so that the table stays below some
 * 100 MB. */
#ifndef ENV_RESAMPLE_H
#define ENV_RESAMPLE_H

#include "err.h"
#include "resample_table.h"

#include <stdint.h>

struct resampler { /* what belongs to a frame */
    const struct resample_table *table;
    struct resample_tables *tables; /* that it was taken from; may be NULL */
    struct resample_table *taken;   /* the same table, to be given back */
    float *reduced;                 /* [blocks][3]; NULL when the table's factor is 1 */
    const float *source;            /* of the frame that was loaded: the caller's, or reduced */
    float mean[3];                  /* of what is seen; 0 where the layout shows everything */
};

/* The table from `tables`, which must outlive the resampler, or NULL: one of its own. ERR_UNSUPPORTED when the shape
 * does not fit the layout, ERR_NOMEM. On ERR_OK the caller owns *out. */
MUST_CHECK enum err resampler_create(struct resample_tables *tables, const struct resample_key *key,
                                     struct resampler **out);
void resampler_destroy(struct resampler *r); /* NULL is allowed */

/* Takes the texels of a frame, which must stay as long as bands are asked for. Uses all OpenMP threads. */
void resampler_load(struct resampler *r, const float *rgb);

/* Rows of a band are this many texels apart: past the end, and not by a power of two, so that a column of them does not
 * fall into one set of the cache. */
#define RESAMPLE_PITCH(n) (((n) + 7) / 8 * 8 + 4)

/* Band b of face f, b < (n + 7) / 8: rows 8 b .. 8 b + 7 of the cube map of the loaded frame times gain, as
 * texels[8][RESAMPLE_PITCH(n)][4], of which the fourth float and what is beyond n mean nothing. Any thread. */
void resampler_band(const struct resampler *r, float gain, uint32_t face, uint32_t b, float *texels);

#endif
