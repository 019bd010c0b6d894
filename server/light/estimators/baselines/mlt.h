/* Metropolis light transport in primary sample space [Kelemen et al. 2002], on top of path.h: Markov chains over the
 * random numbers of a sample. A mutation changes all numbers slightly, or redraws all of them (a large step, 30 %).
 * Chains spend more time where paths carry more luminance; both the current and the proposed state are splatted,
 * weighted by their probability. Large steps also count as independent samples, by the balance heuristic.
 *
 * Normalisation comes from a bootstrap of independent samples. Chains start at bootstrap samples selected in proportion
 * to luminance; with the bootstrap's mean as weight, all states are unbiased from the start, and none is discarded
 * [Veach 1997, chapter 11]. The balance weights come from a separate pilot. The image is therefore unbiased for any
 * number of mutations, like path.h's, but its error is distributed unevenly and correlated between pixels.
 * Thread: any; runs on all OpenMP threads. */
#pragma once

#include "light/estimators/baselines/path.h"

/* As path_render, with desc->samples mutations per pixel; stats->samples includes bootstrap and pilot, about a quarter
 * more. Chains are many and short, their number depends only on the image size, and splats are integers, so that the
 * result does not depend on the number of threads. The image is black once cancelled, or if neither pilot nor bootstrap
 * found light. ERR_NOMEM. */
MUST_CHECK enum err mlt_render(const struct path_world *world, const struct path_desc *desc, float *rgb,
                               struct path_stats *stats);
