/* server/shade/method.h */
/* The names by which estimators of direct light are asked for, and what each draws. */
#ifndef SHADE_METHOD_H
#define SHADE_METHOD_H

#include "err.h"
#include "samples.h"

#include <stdbool.h>

enum method {
    METHOD_UNIFORM,       /* directions evenly over the sphere */
    METHOD_BRDF,          /* directions by the material's lobes */
    METHOD_LIGHT,         /* directions by luminance, all faces as one table */
    METHOD_FACES_UNIFORM, /* six faces, a sixth of the samples each: Eq. 2 of [LPG13] with mu_f = 1/6 */
    METHOD_FACES,         /* six faces, shares by Eq. 3: the estimator of Eq. 4 */
    METHOD_MIS,           /* half by faces, half by the lobes, balance heuristic: Eq. 6 */
    METHOD_LATLONG,       /* by the texels of a lat-long source, a row and then a place within it */
    METHOD_LATLONG_ROWS,  /* likewise, all texels as one row-major table */
    METHOD_PATH,          /* the whole picture by path tracing, camera rays included: baselines/path.h */
    METHOD_MLT,           /* likewise by Metropolis sampling: baselines/mlt.h */
    METHOD_PHOTONS,       /* likewise by a photon map, biased: baselines/photons.h */
    METHOD_VPL,           /* likewise by virtual point lights, biased: baselines/vpl.h */
    METHOD_CACHED,        /* direct light by a cache of light transport, biased: transport.h */
    METHOD_AUTO, /* METHOD_MIS with the sun apart, where there is one, and compensated: what has been measured to
                  * lose nowhere (tests/unit/shade/test_gain.c) */
    METHOD_COUNT,
};

/* How the light samples of a shade point are divided among the strata. */
enum share {
    SHARE_WHOLE,   /* there is one stratum */
    SHARE_EVEN,    /* mu = 1 / strata */
    SHARE_CORNERS, /* mu_f(n) of Eq. 3: energy times the corners' clamped cosines */
};

struct method_recipe {
    const char *name;
    const char *about; /* for --help and the page */
    enum strata_kind strata;
    enum share share;
    float light_part; /* of N_s: samples by light; 0: none */
    float brdf_part;  /* of N_s: samples by lobes; the two add up to 1 */
};

/* METHOD_AUTO gives the recipe it stands for at present. Never NULL. */
const struct method_recipe *method_recipe(enum method m);

/* ERR_USAGE with the list of names for an unknown one. */
MUST_CHECK enum err method_parse(const char *name, enum method *out, struct reason *why);
const char *method_name(enum method m);

/* Whether it makes a whole picture by itself; its recipe has a name and no more. */
bool method_is_reference(enum method m);

#endif
