/* One path from a shading point to the scene's emitters. With f the BRDF and w a direction from the rough lobe,
 *     Lo = integral of f(wo, w) max(0, n.w) L(w) dw + sum over the punctual lights of f(wo, w_i) max(0, n.w_i) E_i,
 * where L(w) is the light that the surface along w emits, plus the emitters' light that it reflects. At the point and
 * at every further rough surface, an emissive triangle is sampled and a BRDF ray continues the path; the balance
 * heuristic combines the two [Veach 1997, Eq. 9.8]. Mirrors and glass block shadow rays: behind them the BRDF ray
 * counts with weight 1, and punctual lights, which no ray can hit, contribute no light. One ray continues from each
 * event, selected in proportion to throughput; Russian roulette ends paths without bias [Veach 1997, section 10.4].
 * Thread: any. */
#pragma once

#include "base/rng.h"
#include "scene/lamps/emitters.h"
#include "scene/surface/lobe.h"

/* Maximum number of events of a path, see PATH_EVENTS_MAX. */
#define WALK_EVENTS_MAX 256

/* Numbers in [0, 1) for the first event; later events use a stream of the path's own. */
enum walk_number {
    WALK_PICK_TRIANGLE,
    WALK_PICK_LOBE,
    WALK_TRIANGLE, /* two: the position on it */
    WALK_LOBE = 4, /* two: the direction */
    WALK_NUMBERS = 6,
};

struct walk_world { /* borrowed */
    const struct scene *scene;
    const struct rays *rays;
    const struct emitters *emitters;
    bool by_lobes_alone; /* sample no triangles, for tests: the same mean with more noise */
};

struct walk_start { /* a shading point */
    struct lobe lobe;
    struct vec3 origin, wo;
};

/* Adds the radiance of one path to sum, and its rays to *rays. */
void walk_sample(const struct walk_world *world, const struct walk_start *start, const double x[WALK_NUMBERS],
                 struct rng *rng, double sum[3], uint64_t *rays);
