/* Indirect light at the shading points of a G-buffer by path tracing: caustics and indirect light (paths.h), at points
 * seen directly and at points seen in mirrors and through glass, which light paths cannot reach. At each point,
 *     Lo = integral of f(wo, w) max(0, n.w) L(w) dw,
 * where w is sampled from the rough lobe and L(w) is the light that a path along w finds:
 *  - the sky, directly: direct light, which is direct.h's and counts 0 here;
 *  - the sky after delta events alone: caustics;
 *  - a rough surface y, possibly after delta events: indirect light. At y, and at every further rough surface, the sky
 *    is sampled as one table (environment_sample) and by the continuing BRDF ray, with the balance heuristic
 *    [Veach 1997, Eq. 9.8]. Light samples cannot pass delta events between a BRDF ray and the sky: there the BRDF ray
 *    counts with weight 1.
 * One ray continues from each event, selected in proportion to throughput; Russian roulette ends paths without bias
 * [Veach 1997, section 10.4]. Paths of more than PATH_EVENTS_MAX events are omitted.
 * Radiance in glass is n^2 times that outside; contributions are scaled accordingly.
 * Thread: one at a time per scratch; runs on all OpenMP threads. */
#pragma once

#include "base/err.h"
#include "base/mem.h"
#include "light/estimators/paths.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/rays.h"
#include "scene/geometry/scene.h"
#include "sky/tables/environment.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

struct precedence;
struct progress_part;
#define EYE_PATH_STEPS 8 /* cost in light samples of a point, approximately */

struct eye_paths_desc {
    uint32_t classes;               /* PATH_CAUSTICS | PATH_INDIRECT or a part of them, at points seen directly */
    uint32_t behind_classes;        /* likewise at points seen in mirrors or through glass (shade_packet.behind) */
    uint32_t paths;                 /* per shading point, >= 1 */
    const uint32_t *counts;         /* [packet_count]: per packet, 1..paths; NULL: `paths` for all. See direct.h. */
    const struct packet_list *only; /* the packets to shade; NULL: all */
    double most;         /* limit on a path's contribution, as the sum of its channels: biased. 0: no limit */
    uint64_t seed, pass; /* determine all random numbers; the passes of a seed continue one low-discrepancy sequence, so
                            that their mean converges faster */
    const atomic_bool *cancel;       /* once true, remaining packets are not shaded; may be NULL */
    const struct precedence *urgent; /* work that eye_paths_record gives way to between packets; may be NULL */
    struct progress_part *progress;  /* stepped by EYE_PATH_STEPS per path of a packet; may be NULL */
    struct scratch *scratch;         /* memory reused between calls, exclusive to this caller; NULL: from the system */
};

struct eye_paths_stats {
    uint64_t paths; /* started */
    uint64_t rays;  /* traced, including shadow rays */
};

/* Where a path of a packet's lane meets the sky. It adds L(dir) times weight / desc->paths to the lane's light. */
struct eye_path_end {
    float dir[3], weight[3];
    uint32_t lane;
};

/* Receives the ends of a packet's paths, lane by lane; called for each packet that has some, by several threads at once
 * and in no particular order. An error that it returns ends the run. */
typedef enum err eye_paths_take(void *context, uint32_t packet, const struct eye_path_end *ends, uint32_t count);

/* Traces the same paths without a sky, for light that meets it after a mirror or glass: desc's classes are among
 * PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC, and `most` is ignored. ERR_NOMEM and errors of `take`. */
MUST_CHECK enum err eye_paths_record(const struct scene *scene, const struct rays *rays, const struct gbuffer *g,
                                     const struct eye_paths_desc *desc, eye_paths_take *take, void *context,
                                     struct eye_paths_stats *stats);

/* Whether the scene can contain any of the requested light. */
bool eye_paths_can_find(const struct scene *scene, const struct eye_paths_desc *desc);

/* Adds to lo, float[packet_count][3][16], the radiance towards the viewer. The result does not depend on the number of
 * threads. ERR_NOMEM: nothing was added. */
MUST_CHECK enum err eye_paths_shade(const struct scene *scene, const struct rays *rays, const struct gbuffer *g,
                                    const struct environment *e, const struct eye_paths_desc *desc, float *lo,
                                    struct eye_paths_stats *stats);

/* ---- Stored paths ---- */

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

struct cache_reader;
struct cache_writer;
struct eye_store;

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

/* Adds the store, which must stay, to a section of w. Reads such a section's store for a G-buffer of so many packets.
 * ERR_FORMAT: it is none; ERR_IO; ERR_NOMEM. */
void eye_store_save(const struct eye_store *s, struct cache_writer *w);
MUST_CHECK enum err eye_store_load(struct cache_reader *r, uint32_t packets, struct eye_store **out,
                                   struct reason *why);
