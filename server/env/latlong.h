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
    double *cdf; /* [height][width]: running sums of importance x solid angle along each row, begun anew in each:
                  * what stands before a row may be 1e12 times what is in it */
    double
        *marginal; /* [height]: running sums of the rows' sums; with cdf the one row-major running sum in two steps */
    double *row_angle; /* [height]: solid angle of a texel of the row */
    double total;
    enum importance importance; /* of the build, as gain and rotation */
    float gain;
    double rotation[2]; /* cosine and sine */
};

/* e must be ready, and stay as it is while the table is used. ERR_UNSUPPORTED, and why, when the source is no lat-long;
 * ERR_NOMEM. On an error the table must not be read. */
MUST_CHECK enum err latlong_build(struct latlong *t, const struct environment *e, struct reason *why);
void latlong_finish(struct latlong *t); /* zeroed memory is allowed */

/* A direction (unit, world) with the radiance of its texel and its density, sr^-1 over the sphere; total must be > 0.
 * It is always in the very texel that x falls in. */
void latlong_sample_rows(const struct latlong *t, const double x[2], float w[3], float rgb[3], float *pdf);
void latlong_sample(const struct latlong *t, const double x[2], float w[3], float rgb[3], float *pdf);

/* The same for a direction that came otherwise; 0 where the texel is black. */
void latlong_evaluate_rows(const struct latlong *t, const float w[3], float rgb[3], float *pdf);
void latlong_evaluate(const struct latlong *t, const float w[3], float rgb[3], float *pdf);

#endif
