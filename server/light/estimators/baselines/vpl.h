/* Virtual point lights [Keller 1997]: particles from the sky leave a small light wherever they hit a D lobe, and these
 * light what the camera sees. [DH09, section 1] suggests this use of its light paths. For comparison on the charts;
 * `auto` never selects it.
 *
 * Background and direct light are path.h's. Indirect light is what the lights contribute where they are visible from
 * the point: paths with a mirror or glass in between, and caustics, are missing. The contribution of a near light is
 * clamped to what the patch it represents could contribute, so that corners are too dark, less so with more samples.
 * Thread: any; runs on all OpenMP threads. */
#pragma once

#include "light/estimators/baselines/path.h"

/* As path_render; desc->samples is also the number of particles: sample i of every pixel is lit by particle i. stats
 * includes both and describes the bias. ERR_NOMEM. */
MUST_CHECK enum err vpl_render(const struct path_world *world, const struct path_desc *desc, float *rgb,
                               struct path_stats *stats);
