/* An environment map as the patches of Radiance's sky (sky/daylight/reinhart.h), for sums of daylight coefficients.
 * Thread: any that may read the environment; all OpenMP threads are used. */
#pragma once

#include "sky/tables/environment.h"

#include <stdint.h>

/* The mean radiance of each patch, gain and rotation included: the integral of L over the patch's solid angle, divided
 * by it. Of a lat-long map the integral of its texels is exact; of other layouts each texel of the cube map belongs to
 * the patch of its middle. radiance: float[reinhart_count(mf)][3]. ERR_NOMEM. */
MUST_CHECK enum err sky_patches(const struct environment *e, uint32_t mf, float (*radiance)[3]);
