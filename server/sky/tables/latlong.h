/* Sampling tables on the texels of the lat-long source, as is usual in the literature: an alternative to the cube map,
 * for comparison. The sampled function is the source, nearest texel, times gain: piecewise constant, so that sampling
 * and evaluation agree.
 *
 * Both variants weight a texel by luminance x solid angle. Rows [Scotty3D]: one row-major CDF over all texels, a
 * position within the texel uniform in (u, v), and pdf(w) = p(texel) w h / (2 pi^2 sin theta) at the sampled theta.
 * Marginal and conditional [Nori]: a row by the marginal CDF, a column by the row's CDF, a position within the texel
 * uniform in solid angle, and pdf(w) = p(texel) / solid angle.
 * Thread: one at a time may build; then any number may read. Memory is reused. */
#pragma once

#include "base/err.h"
#include "sky/tables/environment.h"

#include <stdbool.h>
#include <stdint.h>

struct latlong {
    const struct environment *environment; /* of the last build; its image is read */
    uint32_t width, height;
    bool bottom_first;
    double *cdf; /* [height][width]: CDF of luminance x solid angle within each row, not across rows, since a row's
                    total may be 1e-12 of the preceding rows' */
    double *marginal;  /* [height]: CDF over the rows; with cdf, the row-major CDF in two steps */
    double *row_angle; /* [height]: solid angle of a texel */
    double total;
    float gain;
    double rotation[2]; /* cosine and sine */
};

/* Builds the tables. e must be ready and unchanged while they are used. ERR_UNSUPPORTED: the source is not lat-long.
 * ERR_NOMEM. On error the tables must not be used. */
MUST_CHECK enum err latlong_build(struct latlong *t, const struct environment *e, struct reason *why);
void latlong_finish(struct latlong *t); /* frees the tables; zeroed memory is allowed */

/* Sample a direction (unit, world) from x in [0, 1)^2, with the radiance of its texel and its density, sr^-1 over the
 * sphere. total must be > 0. The direction always lies in the texel that x selects. */
void latlong_sample_rows(const struct latlong *t, const double x[2], float w[3], float rgb[3], float *pdf);
/* Marginal and conditional. */
void latlong_sample(const struct latlong *t, const double x[2], float w[3], float rgb[3], float *pdf);

/* Radiance and density of a given direction; 0 where the texel is black. */
void latlong_evaluate_rows(const struct latlong *t, const float w[3], float rgb[3], float *pdf);
/* Marginal and conditional. */
void latlong_evaluate(const struct latlong *t, const float w[3], float rgb[3], float *pdf);
