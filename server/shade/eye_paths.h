/* server/shade/eye_paths.h */
/* Light that arrives at the shade points of a G-buffer after more events than one, by paths that begin there: caustics
 * and interreflection (paths.h), at points that the camera sees directly and at those behind mirrors and glass, which
 * no path from the light can reach. Per point,
 *     Lo = integral of f(wo, w) max(0, n.w) L(w) dw,
 * where w is drawn by the rough lobe and L(w) is what a path along w finds:
 *  - the sky at once: direct light, which is direct.h's and counts 0 here;
 *  - the sky behind delta events alone: caustics;
 *  - a rough surface y, behind delta events or not: interreflection. At y, and at every further rough surface, the sky
 *    is sampled as one table (samples_whole) and by the lobe ray that goes on, with the balance heuristic
 *    [Veach 1997, Eq. 9.8]. Where delta events stand between a lobe ray and the sky no light sample can get through:
 *    then the lobe ray counts with weight 1.
 * One ray goes on from each event, chosen in proportion to what it carries; Russian roulette ends paths without bias
 * [Veach 1997, section 10.4]. What is scattered more than PATH_EVENTS_MAX times is left out.
 * Radiance in glass is n^2 times that outside: what a path brings through is scaled by it. */
#ifndef SHADE_EYE_PATHS_H
#define SHADE_EYE_PATHS_H

#include "environment.h"
#include "err.h"
#include "gbuffer.h"
#include "paths.h"
#include "rays.h"
#include "scene.h"
#include "scratch.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

struct eye_paths_desc {
    uint32_t classes; /* PATH_CAUSTICS | PATH_INDIRECT, or part of them, at points that the camera sees directly */
    uint32_t behind_classes; /* likewise at points behind mirrors and glass (shade_packet.behind) */
    uint32_t paths;          /* per shade point, >= 1 */
    const uint32_t *counts;  /* [packet_count]: of each packet's points, 1..paths; NULL: `paths`. As in direct.h */
    const struct packet_list *only; /* the packets to be shaded; NULL: all */
    uint64_t seed, pass;            /* together they decide every random number; the passes of a seed go on with one
                                     * low-discrepancy sequence, so that their mean gains from it */
    const atomic_bool *cancel;      /* once true, what is left is not shaded; may be NULL */
    struct scratch *scratch; /* memory that stays from call to call, this caller's alone; NULL: from the system */
};

struct eye_paths_stats {
    uint64_t paths; /* begun */
    uint64_t rays;  /* traced, shadow rays included */
};

/* Whether there is anything in the scene that they would find at all. */
bool eye_paths_find(const struct scene *scene, const struct eye_paths_desc *desc);

/* lo: float[packet_count][3][16], radiance towards the viewer; what is found is added to it. Runs on all OpenMP
 * threads; the result does not depend on their number. ERR_NOMEM: nothing was added. */
MUST_CHECK enum err eye_paths_shade(const struct scene *scene, const struct rays *rays, const struct gbuffer *g,
                                    const struct environment *e, const struct eye_paths_desc *desc, float *lo,
                                    struct eye_paths_stats *stats);

#endif
