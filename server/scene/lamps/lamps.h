/* Computes the radiance of a G-buffer's shading points from the scene's own emitters, in successive batches of samples.
 * Sample i of a point does not depend on the batch sizes; sums are in float, in the order of batches. Thread: one at a
 * time; runs on all OpenMP threads, and the result does not depend on their number. */
#pragma once

#include "scene/geometry/gbuffer.h"
#include "scene/geometry/rays.h"
#include "scene/geometry/scene.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

struct lamps;

struct lamps_desc { /* all must outlive the lamps */
    const struct scene *scene;
    const struct rays *rays;
    const struct gbuffer *gbuffer;
    uint64_t seed;
    bool by_lobes_alone; /* see emitters.h; for tests */
};

struct lamps_stats {
    uint64_t triangles, lights; /* emissive triangles, punctual lights */
    uint64_t samples;           /* per shading point */
    uint64_t rays;
};

/* Needs 192 bytes per packet of shading points. The caller owns the result. NULL when out of memory. */
struct lamps *lamps_create(const struct lamps_desc *desc);
void lamps_destroy(struct lamps *l); /* NULL is allowed */

/* Adds `samples` paths per shading point. Once *cancel is true (NULL: never), abandons the batch and returns false; the
 * sums are then invalid. */
bool lamps_refine(struct lamps *l, uint32_t samples, const atomic_bool *cancel);

/* float[packet_count][3][16]: the sums over all samples, in the layout for resolve_pixels. Borrowed. */
const float *lamps_sums(const struct lamps *l);
void lamps_get_stats(const struct lamps *l, struct lamps_stats *out);
