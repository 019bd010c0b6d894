/* Light samples of one environment map: drawn once per frame and shared by all shading points. A stratum is a region of
 * the sphere with its own density: the whole sphere, a face of the cube map or a cell of it, or the sun. Samples of a
 * stratum invert its tables with a progressive low-discrepancy sequence, so that each prefix is itself well
 * distributed. Thread: one at a time may draw; then any number may read. */
#pragma once

#include "base/err.h"
#include "sky/tables/environment.h"
#include "sky/tables/sky_table.h"

#include <stdbool.h>
#include <stdint.h>

/* ---- Lat-long maps ---- */

/* Sampling tables on the texels of the lat-long source, as is usual in the literature: an alternative to the cube map,
 * for comparison. The sampled function is the source, nearest texel, times gain: piecewise constant, so that sampling
 * and evaluation agree.
 *
 * Both variants weight a texel by luminance x solid angle. Rows [Scotty3D]: one row-major CDF over all texels, a
 * position within the texel uniform in (u, v), and pdf(w) = p(texel) w h / (2 pi^2 sin theta) at the sampled theta.
 * Marginal and conditional [Nori]: a row by the marginal CDF, a column by the row's CDF, a position within the texel
 * uniform in solid angle, and pdf(w) = p(texel) / solid angle.
 * Thread: one at a time may build; then any number may read. Memory is reused. */

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

enum strata_kind {
    STRATA_SPHERE,  /* one stratum, uniform over the sphere: pdf 1 / (4 pi) */
    STRATA_ALL,     /* one stratum, one table for all faces: pdf in proportion to luminance */
    STRATA_FACES,   /* six strata [LPG13, 2.1] */
    STRATA_TABLE,   /* those of a sky_table: cells of the faces and, if there is one, the sun */
    STRATA_LATLONG, /* one stratum: the lat-long source's own texels, marginal and conditional */
    STRATA_ROWS,    /* likewise, one row-major CDF */
};

#define STRATA_MAX (STRATA_CELLS_MAX + 1) /* and the sun */

/* Arrays over all samples; stratum s has samples first[s] .. first[s + 1] - 1. The struct owns the arrays. */
struct light_samples {
    enum strata_kind kind;
    uint32_t strata;
    uint32_t cells;                 /* cells per edge of a face, for a sky_table; else 0 */
    uint32_t first[STRATA_MAX + 1]; /* an empty stratum is black */
    float *x, *y, *z;               /* direction, unit */
    float *r, *g, *b;               /* radiance of the texel */
    float *pdf;                     /* density of its stratum apart from the sun, sr^-1; > 0 if there is no sun */
    float *sun_pdf;                 /* density of the sun's stratum; at least one of the two is > 0 */
    uint32_t *stratum;              /* stratum that contains it, apart from the sun */
    uint32_t capacity;              /* of the arrays, in samples */

    double energy[STRATA_MAX];      /* I_f of [LPG13, Eq. 3]: luminance x solid angle of the stratum */
    float corner[STRATA_MAX][4][3]; /* unit vectors, for F_f of Eq. 3; not for the sun */

    bool has_sun;           /* the last stratum is the sun; it overlaps the others, and both densities apply there */
    float sun_axis[3];      /* unit */
    float sun_cos, sun_sin; /* of a cone about the axis that contains the sun, with a margin */
};

/* Draws `count` samples in each stratum that is not black. Deterministic in environment, kind, count and seed. Reuses
 * the arrays; *out may be zeroed. ERR_NOMEM. */
MUST_CHECK enum err samples_draw(const struct environment *e, enum strata_kind kind, uint32_t count, uint64_t seed,
                                 struct light_samples *out);
void samples_finish(struct light_samples *s); /* frees the arrays; NULL is allowed */

/* Sets up the strata of a table, with energies and corners but no samples. */
void samples_shape(const struct sky_table *t, struct light_samples *out);

/* Draws count[s] samples in stratum s of the table that `s` was set up for; black strata stay empty. ERR_NOMEM. */
MUST_CHECK enum err samples_draw_table(const struct sky_table *t, const uint32_t *count, uint64_t seed,
                                       struct light_samples *s);

/* Draws `count` samples on the source's own texels, with their radiance: STRATA_LATLONG or STRATA_ROWS. ERR_NOMEM. */
MUST_CHECK enum err samples_draw_latlong(const struct latlong *t, enum strata_kind kind, uint32_t count, uint64_t seed,
                                         struct light_samples *out);

/* Inverts the CDFs of a face at x in [0, 1)^2: a unit direction with density pdf(w | face). The face must not be black.
 */
void samples_invert_face(const struct environment *e, uint32_t face, const double x[2], float w[3]);

/* Samples one direction from all faces as one table, for path tracing and next event estimation: w (unit), the radiance
 * as by environment_evaluate, and its density, sr^-1 over the sphere, in proportion to luminance. False if the sky is
 * black. Thread: any. */
bool environment_sample(const struct environment *e, const double x[2], float w[3], float rgb[3], float *pdf);

/* The density with which environment_sample draws w, and the radiance there. Thread: any. */
float environment_sample_density(const struct environment *e, const float w[3], float rgb[3]);
