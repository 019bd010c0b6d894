/* The passes of an image: direct light and eye paths at the shade points, the resolve from points to pixels, and
 * particles from the light. A struct image_passes describes them: relighter_run fills it by rules, the pilot by
 * measurements, and one function runs it (relight.c). A struct passes holds their working memory. One thread of
 * control. */
#pragma once

#include "light/frame/relight.h"

struct backplate;
struct beside;
struct denoiser;
struct accumulation;
struct resolver;

enum { PASS_IMAGE, PASS_PROBE, PASS_TABLES }; /* sets of sky tables: one for images, one for measurements */

struct image_passes {
    const struct relight_desc *cached; /* direct light from its cache instead of `direct`; NULL: from `direct` */
    const struct relight_desc *stored; /* adds caustics from the store of light paths; NULL: does not */
    uint32_t stored_behind;            /* classes that stored eye paths light behind mirrors and glass; 0: none */
    struct direct_desc direct;         /* samples 0: no direct light */
    struct eye_paths_desc eye[2];      /* paths 0: omitted */
    struct light_tracer_desc light[2]; /* particles 0: omitted */
    struct denoiser *denoiser; /* not NULL: `direct` and `eye` run twice with their counts, for filtering (denoise.h) */
    bool glides;               /* the histories only move on: nothing is sampled */
    struct accumulation
        *accumulation;     /* not NULL: takes the halves, or gives way to the cache's light (accumulation.h) */
    struct beside *beside; /* not NULL: runs `stored`, `light` and eye_beside (beside.h) */
    struct eye_paths_desc eye_beside; /* paths 0: omitted */
    bool halves; /* run each of light[] in two halves with different seeds, kept in passes.half, and add their mean to
                    the image. Requires relighter_passes */
    bool background; /* add the sky where the camera sees it */
};

struct pass_costs { /* wall-clock seconds; of particles, without adding their halves to the image */
    double direct_s, eye_s, filter_s, pixels_s, light_s[2];
    uint64_t light_rays[2];
};

struct passes {
    const struct prepared_scene *set;
    const struct kernels *kernels;
    struct direct *direct[PASS_TABLES]; /* the second NULL until passes_measure */
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

/* Runs all passes of an image, for relighter_run and the pilot. Adds to *stats and sets its times; writes *costs.
 * Errors are those of relighter_run. */
MUST_CHECK enum err relighter_run_passes(struct relighter *r, const struct environment *e,
                                         const struct image_passes *passes, float *rgb, struct relight_stats *stats,
                                         struct pass_costs *costs);

/* The passes for half k of a denoised image, 0 and then 1 by the same tables. The counts in *p are per half. */
void passes_half(const struct image_passes *p, int k, struct image_passes *out);

/* Steps of struct progress_part in the passes: light samples of packets, and work of about the same duration. */
uint64_t passes_work(const struct prepared_scene *set, const struct image_passes *p);

/* The part of relighter_run before the passes: prepares the method, plans, and describes the passes. Writes *stats. Not
 * for references. Errors are those of relighter_run. */
MUST_CHECK enum err relighter_describe(struct relighter *r, const struct environment *e,
                                       const struct relight_desc *desc, struct image_passes *passes,
                                       struct relight_stats *stats);

/* Audits rgb, the last image, of desc under e with *stats, as far as desc->audit pays for: writes stats->error,
 * error_at_most and audited. measured: the pilot's, of which parts may be missing that are part of the truth. Without
 * memory the error is unknown. It is also unknown for METHOD_COMPONENTS, and where particles or stored paths bring
 * caustics: paths from the eye hardly find those. By the cache, on a ground and in a team it is bounded only. */
void relighter_state_error(struct relighter *r, const struct environment *e, const struct relight_desc *desc,
                           bool measured, const float *rgb, struct relight_stats *stats);

/* While held, the ground shows the share of the last image's sky light, whichever sky lights it (backplate.h). */
void relighter_hold_ground(struct relighter *r, bool hold);

/* The denoiser for images of desc, created on first use; NULL if desc does not need one. ERR_NOMEM. */
MUST_CHECK enum err relighter_denoiser(struct relighter *r, const struct relight_desc *desc, struct denoiser **out);

/* The packets that the cache of indirect light leaves to eye paths; NULL without such a cache. */
const struct packet_list *relighter_left(const struct relighter *r);

/* The relighter's own passes, after passes_measure: for the pilot. NULL when out of memory. */
struct passes *relighter_passes(struct relighter *r);
