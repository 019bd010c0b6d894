/* server/env/samples.h */
/* Light samples of one environment frame: drawn once, shared by every shade point. A stratum is a region of the sphere
 * with a density of its own: the whole sphere, or one face of the cube map. Within a stratum the samples invert its
 * tables from a progressive low-discrepancy sequence, so that each prefix is as good as a set of its own.
 * samples_draw is for one thread; then any number may read. */
#ifndef ENV_SAMPLES_H
#define ENV_SAMPLES_H

#include "environment.h"
#include "err.h"

#include <stdbool.h>
#include <stdint.h>

enum strata_kind {
    STRATA_SPHERE, /* one stratum, uniform over the sphere: pdf 1 / (4 pi) */
    STRATA_ALL,    /* one stratum, all faces as one table: pdf in proportion to luminance */
    STRATA_FACES,  /* six strata [LPG13, 2.1] */
};

#define STRATA_MAX CUBE_FACES

/* Arrays over all samples; stratum s owns first[s] .. first[s + 1]. */
struct light_samples {
    enum strata_kind kind;
    uint32_t strata;
    uint32_t first[STRATA_MAX + 1]; /* an empty stratum is black */
    float *x, *y, *z;               /* direction, unit */
    float *r, *g, *b;               /* radiance of the texel */
    float *pdf;                     /* within the stratum, sr^-1, > 0 */
    uint32_t capacity;              /* samples the arrays have room for */

    double energy[STRATA_MAX];      /* I_f of Eq. 3: luminance x solid angle of the stratum */
    float corner[STRATA_MAX][4][3]; /* unit vectors, for F_f of Eq. 3 */
};

/* `count` samples in each stratum that is not black. Same environment, kind, count and seed give the same samples.
 * ERR_NOMEM. The arrays are reused; free them with samples_finish (zeroed memory is allowed at first). */
MUST_CHECK enum err samples_draw(const struct environment *e, enum strata_kind kind, uint32_t count, uint64_t seed,
                                 struct light_samples *out);
void samples_finish(struct light_samples *s); /* NULL is allowed */

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
