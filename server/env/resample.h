/* server/env/resample.h */
/* From a source layout to the cube map: a sparse table of the solid angles in which source and cube texels overlap,
 * made once per layout, size and rotation, then applied to every frame. A constant sky stays constant and each source
 * texel's energy arrives whole, both to 1e-5. What a layout does not show (a fisheye's lower hemisphere) takes the mean
 * of what was seen [LPG13, 3]. A picture of many more texels than the cube map can use is first reduced to blocks of
 * factor x factor texels, weighted by solid angle, so that the table stays below some 100 MB. */
#ifndef ENV_RESAMPLE_H
#define ENV_RESAMPLE_H

#include "err.h"
#include "image.h"

#include <stdint.h>

struct resampler {
    enum layout layout; /* any but LAYOUT_AUTO */
    uint32_t width, height;
    uint32_t n;      /* texels along an edge of the cube's faces */
    double rotation; /* radians about +Y, right-handed: takes what the source shows at +Z towards +X */

    /* Blocks of the source, row by row: columns x rows of them. With factor 1 they are its texels. */
    uint32_t factor, columns, rows;
    /* Cube texel t (face-major, then row, then column) is the sum over k in first[t]..first[t+1] of
     * weight[k] * block[index[k]], plus unseen[t] times the mean; the weights and unseen[t] add up to 1. */
    uint32_t *first;
    uint32_t *index; /* ascending within a texel */
    float *weight;
    float *unseen;    /* NULL where the layout shows everything */
    float *block_sum; /* [blocks]: their shares of all that is seen; NULL with unseen */
    float *share;     /* solid angles of source texels, for the reduction; NULL when factor is 1 */
    float *reduced;   /* [blocks][3]; NULL when factor is 1 */

    const float *source; /* of the frame that was loaded: the caller's, or reduced */
    float mean[3];       /* of what is seen; 0 where the layout shows everything */
};

/* The shape must fit the layout (layout_fits). ERR_UNSUPPORTED when it does not, ERR_NOMEM. On ERR_OK the caller owns
 * *out. Uses all OpenMP threads; the table is the same at any number of them. */
MUST_CHECK enum err resampler_create(enum layout layout, uint32_t width, uint32_t height, uint32_t n, double rotation,
                                     struct resampler **out);
void resampler_destroy(struct resampler *r); /* NULL is allowed */

/* Takes the texels of a frame, which must stay as long as rows are asked for. Uses all OpenMP threads. */
void resampler_load(struct resampler *r, const float *rgb);

/* Row i (of 6n) of the cube map of the loaded frame times gain: texels[n][4], of which the first three floats are set.
 * Any thread. */
void resampler_row(const struct resampler *r, float gain, uint32_t row, float *texels);

#endif
