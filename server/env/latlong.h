/* server/env/latlong.h */
/* Sampling tables on the texels of a lat-long source itself, as the literature on environment lights has them: beside
 * the cube map, for those who compare. The sampled function is the source, nearest texel, times gain: piecewise
 * constant, so that what is sampled is what is evaluated.
 *
 * Both weigh a texel by importance x solid angle. Rows [Scotty3D]: one row-major running sum over all texels, a place
 * within the texel even in (u, v), and pdf(w) = p(texel) w h / (2 pi^2 sin theta) at the sampled theta. Marginal and
 * conditional [Nori]: a row by the marginal, a column by its own running sum, a place within the texel even in solid
 * angle, and pdf(w) = p(texel) / solid angle.
 * latlong_build is for one thread at a time; then any number may read. Memory is reused. */
#ifndef ENV_LATLONG_H
#define ENV_LATLONG_H

#include "environment.h"
#include "err.h"

#include <stdbool.h>
#include <stdint.h>

struct latlong {
    const struct environment *environment; /* of the last build: its image is read */
    uint32_t width, height;
    bool bottom_first;
    double *cdf;       /* [height][width]: row-major running sums of importance x solid angle over all texels; within
                        * row y the conditional's are those minus what stands before the row */
    double *row_angle; /* [height]: solid angle of a texel of the row */
    double total;
};

/* ERR_UNSUPPORTED, and why, when the source is no lat-long; ERR_NOMEM. */
MUST_CHECK enum err latlong_build(struct latlong *t, const struct environment *e, struct reason *why);
void latlong_finish(struct latlong *t); /* zeroed memory is allowed */

/* A direction (unit, world) with the radiance of its texel and its density, sr^-1 over the sphere; total must be > 0. */
void latlong_sample_rows(const struct latlong *t, const double x[2], float w[3], float rgb[3], float *pdf);
void latlong_sample(const struct latlong *t, const double x[2], float w[3], float rgb[3], float *pdf);

/* The same for a direction that came otherwise. */
void latlong_evaluate_rows(const struct latlong *t, const float w[3], float rgb[3], float *pdf);
void latlong_evaluate(const struct latlong *t, const float w[3], float rgb[3], float *pdf);

#endif
