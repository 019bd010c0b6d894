/* server/light/relight_passes.h */
/* The passes of a picture: direct light and eye paths at the shade points, from points to pixels, particles from the
 * light. A struct picture_passes describes them: relighter_run fills it by rule, the pilot by measurement, and one
 * function runs it (relight.c). A struct passes holds their working memory. One thread of control. */
#ifndef LIGHT_RELIGHT_PASSES_H
#define LIGHT_RELIGHT_PASSES_H

#include "light/relight.h"

struct backplate;
struct beside;
struct denoiser;
struct history;
struct resolver;

enum { PASS_PICTURE, PASS_PROBE, PASS_TABLES }; /* sets of sky tables: the picture's, and measurements' */

struct picture_passes {
    const struct relight_desc *cached; /* direct light by its cache instead of `direct`; NULL: by `direct` */
    const struct relight_desc *stored; /* the store of light paths adds its caustics; NULL: it does not */
    struct direct_desc direct;         /* samples 0: it is dark */
    struct eye_paths_desc eye[2];      /* paths 0: left out */
    struct light_tracer_desc light[2]; /* particles 0: left out */
    struct denoiser *denoiser; /* not NULL: `direct` and `eye` run twice with their counts, for filtering (denoise.h) */
    struct history *history;   /* not NULL: the halves, or samples beside the cache, join it (history.h) */
    struct beside *beside;     /* not NULL: it runs `stored`, `light` and eye_beside (beside.h) */
    struct eye_paths_desc eye_beside; /* paths 0: left out */
    bool halves; /* each of light[] runs in two halves with seeds of their own, which passes.half keeps; their mean is
                  * added to the picture. relighter_passes was called */
    bool background; /* the sky where the camera sees it */
};

struct pass_costs { /* seconds by the clock; of particles, without what adds their halves to the picture */
    double direct_s, eye_s, filter_s, pixels_s, light_s[2];
    uint64_t light_rays[2];
};

struct passes {
    const struct set *set;
    const struct kernels *kernels;
    struct direct *direct[PASS_TABLES]; /* the second NULL until passes_measure */
    struct light_tracer *light;
    struct resolver *resolver;
    struct backplate *backplate; /* NULL: the scene has no ground */
    struct scratch *scratch;     /* of the eye paths */
    float *lo;                   /* [packet_count][3][16]: the sum of the passes over shade points */
    float *half[2][2]; /* [height][width][3]: of light[0], of light[1]; NULL until passes_measure. With a ground
                          twice as many, the second half for what arrives on it */
};

/* False when out of memory; finish all the same. The set and kernels must outlive it. */
bool passes_init(struct passes *s, const struct set *set, const struct kernels *kernels);
void passes_finish(struct passes *s); /* zeroed memory is allowed */

/* Makes room for measurements and halves, once. ERR_NOMEM: what there is stays as it is. */
MUST_CHECK enum err passes_measure(struct passes *s);

/* direct_shade by one of the sets of tables, and the seconds it took. Errors are those of direct_shade. */
MUST_CHECK enum err passes_direct(struct passes *s, int tables, const struct environment *e,
                                  const struct direct_desc *desc, float *lo, struct direct_stats *stats,
                                  double *seconds);

/* Eye paths alone: writes the packets of desc->only instead of adding. ERR_NOMEM. */
MUST_CHECK enum err passes_eye(struct passes *s, const struct environment *e, const struct eye_paths_desc *desc,
                               float *lo, struct eye_paths_stats *stats, double *seconds);

/* desc->particles in two halves, into half[0] and half[1]: float[height][width][3], with a ground twice that, written.
 * ERR_NOMEM. */
MUST_CHECK enum err passes_halves(struct passes *s, const struct environment *e, const struct light_tracer_desc *desc,
                                  float *const half[2], struct light_tracer_stats *stats, double *seconds);

/* Runs all passes of a picture, for relighter_run and the pilot. Adds to *stats and sets its times; writes *costs.
 * Errors are those of relighter_run. */
MUST_CHECK enum err relighter_run_passes(struct relighter *r, const struct environment *e,
                                         const struct picture_passes *passes, float *rgb, struct relight_stats *stats,
                                         struct pass_costs *costs);

/* Steps of struct progress_part in the passes: light samples of packets, and what takes about as long. */
uint64_t passes_work(const struct set *set, const struct picture_passes *p);

/* What relighter_run does before it runs the passes: prepares what the method needs, plans, and describes the passes.
 * Writes *stats. Not for references. Errors are those of relighter_run. */
MUST_CHECK enum err relighter_describe(struct relighter *r, const struct environment *e,
                                       const struct relight_desc *desc, struct picture_passes *passes,
                                       struct relight_stats *stats);

/* While held, the ground shows shares of the light of the last picture's sky, whatever sky lights it (backplate.h). */
void relighter_hold_ground(struct relighter *r, bool hold);

/* The denoiser for pictures of desc, made when first asked for; NULL if desc wants none. ERR_NOMEM. */
MUST_CHECK enum err relighter_denoiser(struct relighter *r, const struct relight_desc *desc, struct denoiser **out);

/* What the cache of indirect light leaves to eye paths; NULL: there is no such cache. */
const struct packet_list *relighter_left(const struct relighter *r);

/* The relighter's own, after passes_measure: for the pilot. NULL when out of memory. */
struct passes *relighter_passes(struct relighter *r);

#endif
