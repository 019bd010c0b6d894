/* The inputs of light/plan/plan.h: the contents of the scene and the distribution of the sky's light. Pure functions.
 * Thread: any. */
#pragma once

#include "light/plan/plan.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/scene.h"
#include "sky/tables/environment.h"

/* Fills all of *out except the sky's facts. */
void facts_of_set(const struct scene *scene, const struct gbuffer *g, struct plan_facts *out);

/* Mean square of the sky's luminance over the square of its mean, over the sphere: 1 for a uniform sky; the excess over
 * 1 measures the extra variance of directions sampled without importance sampling of the sky. 0 under a black sky. */
double facts_peakedness(const struct environment *e);
