/* server/chart/motion.h */
/* How wrong moving pictures are, beyond how wrong each of them is: whether they flicker where nothing moves, and
 * whether they move as the truth does. A sequence is judged by one struct judge (judge.h) a frame, all of one size and
 * one mask; errors are in proportion to brightness with that judge's weights, and products against its two references,
 * so that the references' own noise cancels. Sums are in fixed order: the same bits at any number of threads. */
#ifndef CHART_MOTION_H
#define CHART_MOTION_H

#include "judge.h"

#include <stdbool.h>
#include <stdint.h>

struct motion {
    const struct judge *frames; /* [count], borrowed */
    uint32_t count;
    uint8_t *still;        /* [height][width]: 1 where the truth stands still */
    uint64_t still_pixels; /* of them */
    double still_share;    /* of the pixels that count */
};

/* Still is a pixel that counts, and whose truth stays within `share` of its mean over the sequence, in proportion to
 * its brightness. count >= 2. ERR_NOMEM. */
MUST_CHECK enum err motion_init(struct motion *m, const struct judge *frames, uint32_t count, double share,
                                struct reason *why);
void motion_finish(struct motion *m); /* zeroed memory is allowed */

/* Standard deviation over time of x - truth, in proportion to brightness, root of the mean square over the pixels that
 * stand still: 0.1 is a flicker of 10 %. Noise that stands still has none. x: [count] pictures. map: float[height]
 * [width], each pixel's own, NAN where it is not still; may be NULL. NAN where no pixel is still; INFINITY for pictures
 * that hold what is no number. */
double motion_flicker(const struct motion *m, const float *const *x, float *map);

/* Error of frame differences, mean over frames t >= 1 of mean(q (dx - da)(dx - db)) where dx = x_t - x_(t-1) and q the
 * weights of frame t: 0 where all that changes changes as it should, whatever the error of each frame. Independent
 * noise in every frame gives twice its relMSE. INFINITY as above. */
double motion_change(const struct motion *m, const float *const *x);

/* Frames after a step until the values have settled: the first k from which on all values[k..n - 1] are at most
 * `bound`. 0: at once. n where the last one is not. */
uint32_t motion_settled(const double *values, uint32_t n, double bound);

#endif
