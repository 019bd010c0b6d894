/* Photon mapping [Jensen 1996]: stores particles from the sky where they hit a D lobe; the radiance of a point is
 * estimated from its nearest photons and the disc that contains them. [DH09, section 1] suggests this use of its light
 * paths. For comparison on the charts; `auto` never selects it.
 *
 * Background and direct light are path.h's. Caustics have a separate map, whose particles start at the boxes of
 * specular objects. The estimate is blurred by the disc: biased at edges, in corners and on curved surfaces, and
 * consistent only as the number of particles goes to infinity. Thread: any; runs on all OpenMP threads. */
#pragma once

#include "light/estimators/baselines/path.h"

/* As path_render. Each of the two maps gets as many particles as the image has samples, at most 2^20, and is evaluated
 * for an eighth of the samples of each pixel. stats includes everything and describes the bias. ERR_NOMEM. */
MUST_CHECK enum err photons_render(const struct path_world *world, const struct path_desc *desc, float *rgb,
                                   struct path_stats *stats);
