/* server/env/resample.h */
/* From a source layout to the cube map: a sparse table of the solid angles in which source and cube texels overlap,
 * made once per layout, size and rotation, then applied to every frame. Row and column sums are fitted to the exact
 * solid angles, so that a constant sky stays constant and each source texel's energy arrives whole, both to 1e-5. */
#ifndef ENV_RESAMPLE_H
#define ENV_RESAMPLE_H

#include "err.h"
#include "image.h"

#include <stdint.h>

struct resampler {
    enum layout layout; /* LAYOUT_LATLONG or LAYOUT_LATLONG_BOTTOM_FIRST */
    uint32_t width, height;
    uint32_t n;      /* texels along an edge of the cube's faces */
    double rotation; /* radians about +Y, right-handed: takes what the source shows at +Z towards +X */
    /* Cube texel t (face-major, then row, then column) is the sum over k in first[t]..first[t+1] of
     * weight[k] * source[index[k]]; its weights add up to 1. */
    uint64_t *first;
    uint32_t *index;
    float *weight;
};

/* ERR_UNSUPPORTED for other layouts, ERR_NOMEM. On ERR_OK the caller owns *out. Uses all OpenMP threads. */
MUST_CHECK enum err resampler_create(enum layout layout, uint32_t width, uint32_t height, uint32_t n, double rotation,
                                     struct resampler **out);
void resampler_destroy(struct resampler *r); /* NULL is allowed */

/* Row i (of 6n) of the cube map times gain: texels[n][4], of which the first three floats are set. Any thread. */
void resampler_row(const struct resampler *r, const float *rgb, float gain, uint32_t row, float *texels);

#endif
