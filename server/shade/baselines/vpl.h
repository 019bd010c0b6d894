/* server/shade/baselines/vpl.h */
/* Virtual point lights [Keller 1997]: particles from the sky leave a small light wherever they meet a D lobe, and what
 * the camera sees is lit by those. A use that [DH09, section 1] names for its light paths; for the chart, never for
 * auto.
 *
 * Background and direct light are path.h's. Interreflection is what the lights bring, as far as light and point see
 * each other: paths with a mirror or glass between the two, and caustics, are missing. Light that is too near a point
 * is cut to what the patch that it stands for could bring at most, so that it is too dark in corners, the less the more
 * samples there are. */
#ifndef SHADE_BASELINES_VPL_H
#define SHADE_BASELINES_VPL_H

#include "baselines/path.h"

/* As path_render; desc->samples is also the number of particles: sample i of every pixel is lit by particle i. stats
 * counts both and carries the bias in words. ERR_NOMEM. */
MUST_CHECK enum err vpl_render(const struct path_world *world, const struct path_desc *desc, float *rgb,
                               struct path_stats *stats);

#endif
