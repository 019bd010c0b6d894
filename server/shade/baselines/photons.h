/* server/shade/baselines/photons.h */
/* A photon map with density estimation [Jensen 1996]: particles from the sky are stored where they meet a D lobe, and
 * the radiance of a point is what its nearest ones bring, over the disc that they lie in. A use that [DH09, section 1]
 * names for its light paths; for the chart, never for auto.
 *
 * Background and direct light are path.h's. Caustics have a map of their own, whose particles set out on the boxes of
 * what is specular. The estimate is blurred by its disc: wrong at edges, in corners and on curved surfaces, and right
 * only as the number of particles goes to infinity. */
#ifndef SHADE_BASELINES_PHOTONS_H
#define SHADE_BASELINES_PHOTONS_H

#include "baselines/path.h"

/* As path_render; each of the two maps is made of as many particles as the picture has samples, at most 2^20, and read
 * at an eighth of the samples of each pixel. stats counts all and carries the bias in words. ERR_NOMEM. */
MUST_CHECK enum err photons_render(const struct path_world *world, const struct path_desc *desc, float *rgb,
                                   struct path_stats *stats);

#endif
