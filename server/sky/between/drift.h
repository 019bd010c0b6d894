/* How clouds move from one sky to the next: optical flow on the upper hemisphere.
 *
 * The hemisphere is seen from above in stereographic coordinates p = (x, z) / (1 + y), where no place is singular:
 * zenith (0, 0), horizon the unit circle. The logarithm of luminance is compared in thumbnails of it. First all clouds
 * move by one wind at one height, (x, z) / y -> (x, z) / y + wind, the best of a grid of winds; then each place by
 * itself [Lucas and Kanade 1981], coarse to fine. Where the way back disagrees with the way there, or where a motion
 * explains no more than standing still, it is 0 and the skies fade.
 *
 * Lat-long images as in sun_patch.h, without their suns. Thread: one per struct. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stdint.h>

#define DRIFT_SIDE 128 /* of the thumbnails, over -1..1 in both coordinates */

struct drift {
    bool moves;     /* better than fading: see gain */
    double gain;    /* squared difference of the thumbnails after the motion over that of standing still, 0..1 */
    double wind[2]; /* (x, z) / y per interval, for messages */
    float *flow[2]; /* owned; [DRIFT_SIDE^2] each: from the first sky to the second, both stereographic coordinates */
    float *work;    /* owned */
};

/* Finds the motion from `first` to `second`, of one size. Memory is reused. ERR_NOMEM. */
MUST_CHECK enum err drift_find(struct drift *d, const float *first, const float *second, uint32_t width,
                               uint32_t height);
void drift_finish(struct drift *d); /* frees; zeroed memory is allowed */

/* out = (1 - t) x first moved by t of the way + t x second moved back by 1 - t of it; without d->moves, or d NULL, they
 * fade. t in 0..1. */
void drift_blend(const struct drift *d, const float *first, const float *second, uint32_t width, uint32_t height,
                 double t, float *out);
