/* server/shade/baselines/mlt.h */
/* Metropolis light transport in primary sample space [Kelemen et al. 2002] on top of path.h: Markov chains over the
 * numbers that a sample is made of. Numbers change a little at a time, or all at once ("large steps", 30 of 100); the
 * chains dwell where paths bring luminance, and splat both the state they have and the one that is proposed, each by
 * its probability. Large steps count as samples of their own, by the balance heuristic.
 *
 * Brightness comes from a bootstrap of independent samples, from which the chains' first states are drawn in proportion
 * to luminance, so that with the bootstrap's mean as weight every state counts right from the first on, and nothing
 * need be thrown away [Veach 1997, chapter 11]. The balance weights come from a pilot apart from both. So the
 * picture is right in the mean, like path.h's, at any number of mutations; but its error is spread unevenly, and its
 * pixels are correlated. */
#ifndef SHADE_BASELINES_MLT_H
#define SHADE_BASELINES_MLT_H

#include "baselines/path.h"

/* As path_render, with desc->samples mutations per pixel; bootstrap and pilot, about a quarter more, are counted in
 * stats->samples. Chains are many and short, their number depends on the picture alone, and splats are summed as whole
 * numbers, so that the result does not depend on threads. Once cancelled all of the picture is black. Where neither
 * pilot nor bootstrap found any light the picture is black too. ERR_NOMEM. */
MUST_CHECK enum err mlt_render(const struct path_world *world, const struct path_desc *desc, float *rgb,
                               struct path_stats *stats);

#endif
