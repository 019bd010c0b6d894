/* What the passes of an image (frame_plan.h) work with, and the functions that describe and run them: relighter_run by
 * rules, the pilot by measurements. One thread of control. */
#pragma once

#include "light/frame/frame_plan.h"

struct backplate;
struct denoiser;
struct resolver;

enum { TABLES_IMAGE, TABLES_PILOT, TABLES_COUNT }; /* sets of sky tables: one for images, one for measurements */

struct passes {
    const struct prepared_scene *set;
    const struct kernels *kernels;
    struct direct *direct[TABLES_COUNT]; /* the second NULL until passes_measure */
    struct light_tracer *light;
    struct resolver *resolver;
    struct backplate *backplate; /* NULL: the scene has no ground */
    struct scratch *scratch;     /* of the eye paths */
    float *lo;                   /* [packet_count][3][16]: the sum of the passes over shade points */
    float *half[2][2]; /* [height][width][3]: of light[0], of light[1]; NULL until passes_measure. With a ground twice
                          the size; the second half is for light on the ground */
};

/* False when out of memory; call passes_finish even then. The set and kernels must outlive it. */
bool passes_init(struct passes *s, const struct prepared_scene *set, const struct kernels *kernels);
void passes_finish(struct passes *s); /* zeroed memory is allowed */

/* Allocates memory for measurements and halves, once. ERR_NOMEM: nothing changes. */
MUST_CHECK enum err passes_measure(struct passes *s);

/* Runs direct_shade with one of the sets of tables and measures its seconds. Errors are those of direct_shade. */
MUST_CHECK enum err passes_direct(struct passes *s, int tables, const struct environment *e,
                                  const struct direct_desc *desc, float *lo, struct direct_stats *stats,
                                  double *seconds);

/* Runs eye paths alone: overwrites the packets of desc->only instead of adding. ERR_NOMEM. */
MUST_CHECK enum err passes_eye(struct passes *s, const struct environment *e, const struct eye_paths_desc *desc,
                               float *lo, struct eye_paths_stats *stats, double *seconds);

/* Runs desc->particles in two halves and writes them to half[0] and half[1]: float[height][width][3], with a ground
 * twice that. ERR_NOMEM. */
MUST_CHECK enum err passes_halves(struct passes *s, const struct environment *e, const struct light_tracer_desc *desc,
                                  float *const half[2], struct light_tracer_stats *stats, double *seconds);

/* Runs the passes of an image, for relighter_run and the pilot, and writes their seconds and rays; a filtered plan
 * becomes that of its halves. Adds to *stats, its times included. Errors are those of relighter_run. */
MUST_CHECK enum err relighter_run_plan(struct relighter *r, const struct environment *e, struct frame_plan *plan,
                                       float *rgb, struct relight_stats *stats);

/* The part of relighter_run before the passes: prepares the method and plans. Writes *stats. Not for
 * references. Errors are those of relighter_run. */
MUST_CHECK enum err relighter_describe(struct relighter *r, const struct environment *e,
                                       const struct relight_desc *desc, struct frame_plan *plan,
                                       struct relight_stats *stats);

/* Audits rgb, the last image, of desc under e with *stats, as far as desc->audit pays for: writes stats->error,
 * error_at_most and audited. measured: the pilot's, of which parts may be missing that are part of the truth. Without
 * memory the error is unknown. It is also unknown for METHOD_COMPONENTS, and where particles or stored paths bring
 * caustics: paths from the eye hardly find those. By the cache, on a ground and in a team it is bounded only. */
void relighter_state_error(struct relighter *r, const struct environment *e, const struct relight_desc *desc,
                           bool measured, const float *rgb, struct relight_stats *stats);

/* While held, the ground shows the share of the last image's sky light, whichever sky lights it (backplate.h). */
void relighter_hold_ground(struct relighter *r, bool hold);

/* Lets the plan's image be denoised, by a denoiser that is created on first use. ERR_NOMEM. */
MUST_CHECK enum err relighter_add_filter(struct relighter *r, struct frame_plan *plan);

/* The packets that the cache of indirect light leaves to eye paths; NULL without such a cache. */
const struct packet_list *relighter_left(const struct relighter *r);

/* The relighter's own passes, after passes_measure: for the pilot. NULL when out of memory. */
struct passes *relighter_passes(struct relighter *r);
