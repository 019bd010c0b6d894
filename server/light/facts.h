/* server/light/facts.h */
/* The facts for choose/plan.h: the contents of the scene and the distribution of the sky's light. Pure functions; any
 * thread. */
#ifndef LIGHT_FACTS_H
#define LIGHT_FACTS_H

#include "env/environment.h"
#include "scene/gbuffer.h"
#include "choose/plan.h"
#include "scene/scene.h"

/* All of *out but the sky's. */
void facts_of_set(const struct scene *scene, const struct gbuffer *g, struct plan_facts *out);

/* Mean square of the sky's luminance over the square of its mean, over the sphere: 1 where it is even, and by how much
 * the variance of directions drawn without regard to the sky exceeds that. 0 under a black sky. */
double facts_peakedness(const struct environment *e);

#endif
