/* Stores light paths that start at specular objects (casters), and relights them under each sky: caustics and their
 * indirect light follow the sky without tracing rays.
 *
 * With camera, geometry and materials fixed, a particle's contribution to a pixel is linear in the radiance of the
 * direction it came from. A splat is therefore stored as that direction w, its pixel, and its throughput
 * T = f(o, w_i) ... / (p_w p_y), its contribution for radiance 1, and a frame is
 *     Lo(pixel) = 1/N  sum over the pixel's splats of  L(w) T.
 * Directions are uniform over the sphere, p_w = 1 / (4 pi), and lines as in light_tracer.h; tracing does not use the
 * sky. The store is thus independent of the sky, and each image is unbiased: its mean over stores (seeds) is the limit
 * of light_tracer.h. The store holds only splats; paths that the camera does not see only count towards N.
 *
 * Few of these paths hit a small bright sun. Separate particles (light_tracer_desc.bright) therefore carry the light
 * above the level of sky/tables/sky_split.h, and the store uses the lower part's share of L. The two add up to L.
 *
 * The paths belong to an endless low-discrepancy sequence, divided into parts of equal size; the store holds `parts`
 * consecutive ones. At turn t these are numbers t .. t + parts - 1: advancing by one replaces the oldest part and keeps
 * the others. Images of two turns share the paths that are in both, so noise changes slowly and averages out over many
 * turns. The contents depend only on seed and turn, not on earlier turns.
 *
 * Thread: one at a time per store. Functions run on all OpenMP threads; results do not depend on their number. */
#pragma once

#include "base/err.h"
#include "light/estimators/light_tracer.h"
#include "scene/geometry/rays.h"
#include "scene/geometry/scene.h"
#include "scene/geometry/view.h"
#include "sky/tables/environment.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#define CAUSTIC_PARTS 512 /* default number of parts */
#define CAUSTIC_PARTS_MAX 4096

struct cache_reader;
struct cache_writer;
struct caustic_store;
struct precedence;
struct progress;

struct caustic_store_desc {
    uint32_t classes; /* PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC, or one of them */
    uint64_t paths;   /* N, at least 1; rounded to a multiple of parts and of starts per direction */
    uint32_t parts;   /* 1..CAUSTIC_PARTS_MAX; 0: the default */
    enum start_kind start;
    uint64_t seed;
    bool ground_apart; /* light on the ground (scene/geometry/ground.h) gets an image of its own, after the other */
    const struct precedence *urgent; /* work that caustic_store_turn gives way to between parts; may be NULL */
    uint64_t max_bytes; /* approximate memory limit; 0: 256 MiB. Fewer paths are stored if it does not suffice. */
};

struct caustic_store_stats {
    uint64_t paths, requested; /* stored, and the number to store if memory suffices */
    uint64_t splats;           /* stored */
    uint64_t bytes;            /* in use */
    uint64_t rays;             /* traced at the last turn */
    uint32_t parts, filled;    /* filled: parts with paths; equals `parts` when complete */
    uint32_t renewed;          /* parts computed at the last turn */
};

/* Creates an empty store; scene and rays must outlive it, the view is copied. Traces some paths to estimate the number
 * of splats. The caller owns *out, NULL on error. ERR_RANGE: max_bytes does not suffice for any path; *why states a
 * sufficient limit. ERR_NOMEM. */
MUST_CHECK enum err caustic_store_create(const struct scene *scene, const struct rays *rays, const struct view *view,
                                         const struct caustic_store_desc *desc, struct caustic_store **out,
                                         struct reason *why);
void caustic_store_destroy(struct caustic_store *s); /* NULL is allowed */

/* Computes the parts of this turn that the store does not hold. progress (may be NULL) is stepped once for each. When
 * cancelled, returns ERR_OK and computes the missing parts next time; likewise after ERR_NOMEM. */
MUST_CHECK enum err caustic_store_turn(struct caustic_store *s, uint64_t turn, struct progress *progress,
                                       const atomic_bool *cancel);

/* Whether all parts of one turn are present; false after a cancelled turn. */
bool caustic_store_is_complete(const struct caustic_store *s);

/* For live images, which do not wait for the store: computes at most `most` of the missing parts, empty ones first.
 * Cancellation works as in caustic_store_turn. ERR_NOMEM. */
MUST_CHECK enum err caustic_store_grow(struct caustic_store *s, uint64_t turn, uint32_t most,
                                       const atomic_bool *cancel);

/* Adds the radiance of the sky's lower part to rgb, float[height][width][3], with ground_apart
 * float[2][height][width][3]. level: that of sky/tables/sky_split.h, 0 (nothing) to INFINITY (everything). The store
 * must be complete. ERR_NOMEM: nothing was added. */
MUST_CHECK enum err caustic_store_light(struct caustic_store *s, const struct environment *e, float level, float *rgb);

/* As caustic_store_light, with every second part, beginning with part `half`, 0 or 1. The halves are independent
 * estimates, and the store may be incomplete. Adds nothing if no such part exists. */
MUST_CHECK enum err caustic_store_light_half(struct caustic_store *s, const struct environment *e, float level,
                                             uint32_t half, float *rgb);

const struct caustic_store_stats *caustic_store_stats(const struct caustic_store *s); /* owned by the store */

/* Adds a complete store of turn 0, which must stay as it is, to a section of w. Reads such a section to its end,
 * into an empty store of the same description, which stays empty on errors. ERR_FORMAT: it is none; ERR_IO; ERR_NOMEM.
 */
void caustic_store_save(const struct caustic_store *s, struct cache_writer *w);
MUST_CHECK enum err caustic_store_load(struct caustic_store *s, struct cache_reader *r, struct reason *why);
