/* Resampling from a source layout to the cube map: a sparse matrix of the solid angles in which source and cube texels
 * overlap, computed once per layout, size and rotation (resample_table.h) and applied to every frame. A constant sky
 * stays constant, and each source texel's energy is conserved, both to 1e-5. Directions that a layout does not cover (a
 * fisheye's lower hemisphere) get the mean of the covered ones [LPG13, 3]. An image of many more texels than the cube
 * map can use is first reduced to blocks of factor x factor texels, weighted by solid angle, so that the table stays
 * below about 100 MB. Thread: one at a time, except resampler_band. */
#pragma once

#include "base/err.h"
#include "sky/tables/resample_table.h"

#include <stdint.h>

struct resampler { /* per-frame state */
    const struct resample_table *table;
    struct resample_tables *tables; /* where the table came from; may be NULL */
    struct resample_table *taken;   /* the same table, to be released */
    float *reduced;                 /* [blocks][3]; NULL when the table's factor is 1 */
    const float *source;            /* the loaded frame: the caller's texels, or `reduced` */
    float mean[3];                  /* mean of the covered directions; 0 if the layout covers everything */
};

/* Takes the table from `tables`, which must outlive the resampler, or creates its own if NULL. On ERR_OK the caller
 * owns *out. ERR_UNSUPPORTED: the size does not fit the layout. ERR_NOMEM. */
MUST_CHECK enum err resampler_create(struct resample_tables *tables, const struct resample_key *key,
                                     struct resampler **out);
void resampler_destroy(struct resampler *r); /* NULL is allowed */

/* Loads a frame's texels, float[height][width][3], which must stay valid while bands are computed. Uses all OpenMP
 * threads. */
void resampler_load(struct resampler *r, const float *rgb);

/* Texels per row of a band: padded, and not a power of two, so that a column does not map to a single cache set. */
#define RESAMPLE_PITCH(n) (((n) + 7) / 8 * 8 + 4)

/* Computes band b of face f, b < (n + 7) / 8: rows 8 b .. 8 b + 7 of the cube map of the loaded frame, times gain, to
 * texels[8][RESAMPLE_PITCH(n)][4]. The fourth float and the padding are undefined. Thread: any. */
void resampler_band(const struct resampler *r, float gain, uint32_t face, uint32_t b, float *texels);
