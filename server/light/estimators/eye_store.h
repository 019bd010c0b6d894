/* Stores eye paths that meet the sky after a mirror or glass, and relights them under each sky without tracing rays.
 * They are caustics, and indirect light of caustics, at points seen in mirrors or through glass, which light paths
 * cannot reach (paths.h).
 *
 * Such a path depends on camera, geometry and materials alone, and what it adds to its point is linear in the sky:
 * L(w), where it leaves the scene, times its throughput T. A frame is Lo(point) += 1/N  sum over the point's paths that
 * meet the sky of  L(w) T with the whole of L, as eye_paths.h has it, so its mean over seeds is the same. For one seed
 * the same N paths light every frame: noise does not flicker, and does not average out over frames either.
 *
 * Thread: one at a time per store. Functions run on all OpenMP threads; results do not depend on their number. */
#pragma once

#include "base/err.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/rays.h"
#include "scene/geometry/scene.h"
#include "sky/tables/environment.h"

#include <stdatomic.h>
#include <stdint.h>

struct eye_store;
struct precedence;

struct eye_store_desc {
    uint32_t classes;   /* at points behind mirrors and glass: PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC, or one of them */
    uint32_t paths;     /* N per point, at least 1 */
    uint64_t seed;      /* determines the paths */
    uint64_t max_bytes; /* approximate; 0: 256 MiB. If it does not suffice, N is smaller */
    const atomic_bool *cancel;       /* may be NULL */
    const struct precedence *urgent; /* work that tracing gives way to; may be NULL */
};

struct eye_store_stats {
    uint64_t paths; /* N times the points */
    uint64_t ends;  /* stored: those that meet the sky */
    uint64_t rays, bytes;
    uint32_t per_point; /* N */
};

/* Traces the paths; scene, rays and g are read only here, g's packets must stay as they are. Cancelled: ERR_OK and
 * NULL. The caller owns *out, NULL on error. ERR_NOMEM. */
MUST_CHECK enum err eye_store_create(const struct scene *scene, const struct rays *rays, const struct gbuffer *g,
                                     const struct eye_store_desc *desc, struct eye_store **out);
void eye_store_destroy(struct eye_store *s); /* NULL is allowed */

/* Adds the light of e's part below `level` (sky_lower; infinite: the whole sky) to lo, float[packet_count][3][16]. */
void eye_store_light(const struct eye_store *s, const struct environment *e, float level, float *lo);

const struct eye_store_stats *eye_store_stats(const struct eye_store *s); /* owned by the store */
