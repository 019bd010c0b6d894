/* One entry point for all methods that render whole images, camera rays included: the reference and the baselines of
 * server/light/estimators/baselines. */
#pragma once

#include "light/frame/relight.h"

/* Fills rgb float[height][width][3] by desc->direct.method, which must be one of them, with desc->direct.samples per
 * pixel. Sets the reference fields of *stats. ERR_NOMEM; METHOD_COMPONENTS: errors of relight_whole. Runs on all OpenMP
 * threads. */
MUST_CHECK enum err reference_run(const struct prepared_scene *set, const struct environment *e,
                                  const struct relight_desc *desc, float *rgb, struct relight_stats *stats);
