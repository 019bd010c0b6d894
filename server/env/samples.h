/* server/env/samples.h */
/* Light samples of one environment frame: drawn once, shared by every shade point. A stratum is a region of the sphere
 * with a density of its own: the whole sphere, one face of the cube map or a cell of it, the sun. Within a stratum the
 * samples invert its tables from a progressive low-discrepancy sequence, so that each prefix is as good as a set of its
 * own. samples_draw is for one thread; then any number may read. */
#ifndef ENV_SAMPLES_H
#define ENV_SAMPLES_H

#include "environment.h"
#include "err.h"
#include "latlong.h"
#include "sky_table.h"

#include <stdbool.h>
#include <stdint.h>

enum strata_kind {
    STRATA_SPHERE,  /* one stratum, uniform over the sphere: pdf 1 / (4 pi) */
    STRATA_ALL,     /* one stratum, all faces as one table: pdf in proportion to luminance */
    STRATA_FACES,   /* six strata [LPG13, 2.1] */
    STRATA_TABLE,   /* those of a sky_table: cells of the faces, and behind them the sun if it is out */
    STRATA_LATLONG, /* one stratum: the lat-long source's own texels, marginal and conditional */
    STRATA_ROWS,    /* likewise, one row-major table */
};

#define STRATA_MAX (STRATA_CELLS_MAX + 1) /* and the sun */

/* Arrays over all samples; stratum s owns first[s] .. first[s + 1]. */
struct light_samples {
    enum strata_kind kind;
    uint32_t strata;
    uint32_t cells;                 /* along a face's edge, of a sky_table; else 0 */
    uint32_t first[STRATA_MAX + 1]; /* an empty stratum is black */
    float *x, *y, *z;               /* direction, unit */
    float *r, *g, *b;               /* radiance of the texel */
    float *pdf;                     /* within the stratum that it falls in, the sun's apart, sr^-1; > 0 without a sun */
    float *sun_pdf;                 /* within the sun, where that is a stratum; one of the two is > 0 */
    uint32_t *stratum;              /* that it falls in, the sun apart */
    uint32_t capacity;              /* samples the arrays have room for */

    double energy[STRATA_MAX];      /* I_f of Eq. 3: luminance x solid angle of the stratum */
    float corner[STRATA_MAX][4][3]; /* unit vectors, for F_f of Eq. 3; not of the sun */

    bool has_sun;      /* the last stratum is the sun: it lies over the others, and both densities count there */
    float sun_axis[3]; /* unit */
    float sun_cos, sun_sin; /* of an angle from its axis within which the sun lies, and a little more */
};

/* `count` samples in each stratum that is not black. Same environment, kind, count and seed give the same samples.
 * ERR_NOMEM. The arrays are reused; free them with samples_finish (zeroed memory is allowed at first). */
MUST_CHECK enum err samples_draw(const struct environment *e, enum strata_kind kind, uint32_t count, uint64_t seed,
                                 struct light_samples *out);
void samples_finish(struct light_samples *s); /* NULL is allowed */

/* The strata of a table with their energies and corners, none of them holding a sample yet. */
void samples_shape(const struct sky_table *t, struct light_samples *out);

/* count[s] samples in stratum s of the table by which `s` was shaped; those that are black stay empty. ERR_NOMEM. */
MUST_CHECK enum err samples_draw_table(const struct sky_table *t, const uint32_t *count, uint64_t seed,
                                       struct light_samples *s);

/* `count` samples by the source's own texels, which they carry: STRATA_LATLONG or STRATA_ROWS. ERR_NOMEM. */
MUST_CHECK enum err samples_draw_latlong(const struct latlong *t, enum strata_kind kind, uint32_t count, uint64_t seed,
                                         struct light_samples *out);

/* Inverts the tables of one face at x in [0, 1)^2: a direction (unit) with density pdf(w | face). The face must not be
 * black. */
void samples_invert_face(const struct environment *e, uint32_t face, const double x[2], float w[3]);

/* One direction by all faces as one table, for who needs them one at a time: paths from the light, next event
 * estimation. w unit, the radiance that environment_evaluate gives there, and its density sr^-1 over the sphere: in
 * proportion to luminance. False under a black sky. samples_whole_density is that density of any direction, with the
 * radiance there. Any thread. */
bool samples_whole(const struct environment *e, const double x[2], float w[3], float rgb[3], float *pdf);
float samples_whole_density(const struct environment *e, const float w[3], float rgb[3]);

#endif
