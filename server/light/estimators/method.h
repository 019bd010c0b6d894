/* The methods for direct light (--method) and their sampling techniques. Thread: any. */
#pragma once

#include "base/setting.h"
#include "sky/tables/samples.h"

#include <stdbool.h>

enum method {
    METHOD_UNIFORM,       /* uniform over the sphere */
    METHOD_BRDF,          /* by the BRDF */
    METHOD_LIGHT,         /* by luminance, one table for all faces */
    METHOD_FACES_UNIFORM, /* six faces, a sixth of the samples each: Eq. 2 of [LPG13] with mu_f = 1/6 */
    METHOD_FACES,         /* six faces, shares by Eq. 3: the estimator of Eq. 4 */
    METHOD_MIS,           /* half by faces, half by the BRDF, balance heuristic: Eq. 6 */
    METHOD_LATLONG,       /* by the texels of a lat-long source, marginal and conditional */
    METHOD_LATLONG_ROWS,  /* likewise, one row-major CDF */
    METHOD_PATH,          /* the whole image by path tracing, including camera rays: baselines/path.h */
    METHOD_MLT,           /* likewise by Metropolis light transport: baselines/path.h */
    METHOD_PHOTONS,       /* likewise by photon mapping, biased: baselines/path.h */
    METHOD_VPL,           /* likewise by virtual point lights, biased: baselines/path.h */
    METHOD_COMPONENTS,    /* likewise as a sum of parts, one a patch of the sky: light/radiance/components.h */
    METHOD_CACHED,        /* direct light from the cache, biased: light/cache_direct/transport.h */
    METHOD_AUTO, /* METHOD_MIS with the sun, if any, as a separate stratum, and MIS compensation: never worse in
                    measurements (tests/unit/light/estimators/test_gain.c) */
    METHOD_COUNT,
};

/* How the light samples of a shading point are distributed over the strata. */
enum share {
    SHARE_WHOLE,   /* there is only one stratum */
    SHARE_EVEN,    /* mu = 1 / strata */
    SHARE_CORNERS, /* mu_f(n) of Eq. 3: energy times the corners' clamped cosines */
};

struct method_recipe {
    enum strata_kind strata;
    enum share share;
    float light_part; /* share of light samples in N_s; 0: none */
    float brdf_part;  /* share of BRDF samples in N_s; the two sum to 1 */
    bool sun_apart;   /* the sun, if there is one, is a separate stratum, and the tables are compensated */
    bool known;       /* the light of an open sky, which is known, corrects the samples of matte surfaces */
};

/* The recipe of a method. Static; never NULL. */
const struct method_recipe *method_recipe(enum method m);

/* The method that METHOD_AUTO is a variant of, for reports; the identity for other methods. */
enum method method_by_rule(enum method m);

/* All methods. */
extern const struct setting_choice method_choices[];
const char *method_name(enum method m); /* static; any thread */

/* Whether the method renders a whole image without a G-buffer. It then has no recipe. */
bool method_is_reference(enum method m);
