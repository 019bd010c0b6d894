/* What an image is made of: its light as a list of passes, chosen from scene, sky and request. Pure functions; the
 * passes run in relight.c, in this order. Thread: any. */
#pragma once

#include "light/frame/relight.h"
#include "light/plan/plan.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/scene.h"
#include "sky/tables/environment.h"

enum pass_kind {
    /* Light at the shade points, float[packet_count][3][16] */
    PASS_GLIDE,      /* an accumulation under a still sky moves on; nothing is sampled */
    PASS_DIRECT,     /* direct light by `direct`; without samples none: the others add to it */
    PASS_CACHED,     /* direct light by the cache, and indirect light if the plan leaves it to the cache */
    PASS_EYE,        /* adds `eye` */
    PASS_FILTER,     /* denoises two halves */
    PASS_ACCUMULATE, /* the same, with the light of earlier images (denoise.h) */
    PASS_LEAVE,      /* light of earlier images gives way to the cache's */
    PASS_BEHIND,     /* adds stored eye paths behind mirrors and glass */
    PASS_BESIDE,     /* adds live caustics (beside.h), among them `eye` */
    /* Pixels, float[height][width][3] */
    PASS_RESOLVE,   /* from the points, with the sky where the camera sees it if `background` */
    PASS_REST,      /* adds those of PASS_BESIDE that no point shows */
    PASS_STORED,    /* adds stored light paths */
    PASS_PARTICLES, /* adds `light` */
    PASS_SPLATS,    /* what the two before have gathered: spread if the image is denoised, and seen on a ground */
    PASS_KINDS,
};

struct pass {
    enum pass_kind kind;
    int half;         /* of the denoiser, whose points it writes: 0 or 1; -1: the image's points */
    uint32_t classes; /* PATH_* that it brings; 0: those of others */
    union {
        struct direct_desc direct;
        struct eye_paths_desc eye;
        struct {
            struct light_tracer_desc light;
            bool halves; /* run it in two, with different seeds, kept in passes.half; their mean is added. Requires
                            relighter_passes */
        };
        const struct relight_desc *request; /* of PASS_CACHED and PASS_STORED; borrowed */
    };
    /* Once it has run: */
    double seconds; /* by the clock */
    uint64_t rays;  /* of PASS_DIRECT, PASS_EYE and PASS_PARTICLES */
};

#define PASSES_MAX 16 /* bounds a table; an assertion checks it */

struct frame_plan {
    struct plan light; /* which estimator brings which class */
    struct pass pass[PASSES_MAX];
    uint32_t count;
    bool background;           /* the sky where the camera sees it */
    const atomic_bool *cancel; /* may be NULL */
};

/* Whether METHOD_CACHED computes direct light. */
bool relight_is_cached(const struct relight_desc *desc);

/* Assigns each requested class to an estimator. stored: caustics by stored light paths, unless the request names
 * another estimator. */
void plan_make(const struct plan_facts *facts, const struct relight_desc *desc, bool stored, struct plan *out);

/* The classes that the plan assigns to `who`. */
uint32_t relight_plan_classes(const struct plan *p, enum plan_estimator who);

/* The classes that images with the cache will take from stored light paths, even if this one cannot yet; 0: none. */
uint32_t relight_plan_later(const struct relight_desc *desc, const struct plan *p);

/* The classes that stored eye paths can light at points behind mirrors and glass; 0: none. */
uint32_t relight_plan_behind(const struct relight_desc *desc, const struct plan *p);

/* The same if the image waits for them; live images do not (beside.h). */
uint32_t relight_plan_awaited(const struct prepared_scene *set, const struct relight_desc *desc, const struct plan *p);

/* Assigns the classes of an image of this set and lists the passes, without a filter. indirect: the cache of indirect
 * light, or NULL. e may be NULL: the estimator of caustics is then undecided unless they are stored. grown:
 * relight_caustics_serve, before which live images under a soft sky take eye paths. *out borrows desc, indirect and
 * scratch. */
void frame_plan_make(const struct prepared_scene *set, const struct indirect_cache *indirect, struct scratch *scratch,
                     const struct environment *e, const struct relight_desc *desc, bool grown, struct frame_plan *out);

/* ---- Lists ---- */

/* Inserts a zeroed pass of this kind behind those of lower or equal kind. The pointer is valid until the next
 * insertion or removal. */
struct pass *frame_plan_add(struct frame_plan *p, enum pass_kind kind, uint32_t classes);
/* The first of this kind; NULL: none. */
struct pass *frame_plan_find(struct frame_plan *p, enum pass_kind kind);
bool frame_plan_has(const struct frame_plan *p, enum pass_kind kind);
void frame_plan_remove(struct frame_plan *p, struct pass *s); /* one of its passes */
/* Removes all of this kind. */
void frame_plan_drop(struct frame_plan *p, enum pass_kind kind);
/* Removes what brings none of these classes, and lets the rest bring no others. Direct light becomes none. */
void frame_plan_keep(struct frame_plan *p, uint32_t classes);

/* Whether two halves are denoised: what they sample has the counts of one half. */
bool frame_plan_is_filtered(const struct frame_plan *p);
/* The passes of half k, 0 and then 1 by the same tables, without the filter. */
void frame_plan_half(const struct frame_plan *p, int k, struct frame_plan *out);
/* Turns what a filtered plan samples into the passes of both halves. */
void frame_plan_split(struct frame_plan *p);

/* Steps of struct progress_part in the passes: light samples of packets, and work of about the same duration. */
uint64_t frame_plan_work(const struct prepared_scene *set, const struct frame_plan *p);

/* ---- Facts of scene and sky ---- */

/* The inputs of light/plan/plan.h: the contents of the scene and the distribution of the sky's light. Pure functions.
 * Thread: any. */

/* Fills all of *out except the sky's facts. */
void facts_of_set(const struct scene *scene, const struct gbuffer *g, struct plan_facts *out);

/* Mean square of the sky's luminance over the square of its mean, over the sphere: 1 for a uniform sky; the excess over
 * 1 measures the extra variance of directions sampled without importance sampling of the sky. 0 under a black sky. */
double facts_peakedness(const struct environment *e);

/* ---- Running the passes ---- */

/* What the passes of an image (frame_plan.h) work with, and the functions that describe and run them: relighter_run by
 * rules, the pilot by measurements. One thread of control. */

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

/* While held, the ground shows the share of the last image's sky light, whichever sky lights it (resolve.h). */
void relighter_hold_ground(struct relighter *r, bool hold);

/* Lets the plan's image be denoised, by a denoiser that is created on first use. ERR_NOMEM. */
MUST_CHECK enum err relighter_add_filter(struct relighter *r, struct frame_plan *plan);

/* The packets that the cache of indirect light leaves to eye paths; NULL without such a cache. */
const struct packet_list *relighter_left(const struct relighter *r);

/* The relighter's own passes, after passes_measure: for the pilot. NULL when out of memory. */
struct passes *relighter_passes(struct relighter *r);
