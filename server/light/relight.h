/* server/light/relight.h */
/* A static scene, relit by one environment frame after another, for relightd and the tools. A struct set is made once
 * and then only read, by any number of threads. A struct relighter belongs to one thread. */
#ifndef LIGHT_RELIGHT_H
#define LIGHT_RELIGHT_H

#include "bounce/bounce.h"
#include "estimators/caustic_store.h"
#include "estimators/direct.h"
#include "env/environment.h"
#include "base/err.h"
#include "estimators/eye_paths.h"
#include "scene/free_view.h"
#include "scene/gbuffer.h"
#include "estimators/kernels.h"
#include "estimators/light_tracer.h"
#include "estimators/paths.h"
#include "choose/plan.h"
#include "reader/reader.h"
#include "scene/rays.h"
#include "scene/scene.h"
#include "transport/transport.h"
#include "scene/view.h"

#include <stdbool.h>
#include <stdint.h>

struct progress;

/* A scene before a camera: geometry, BVH and G-buffer. */
struct set {
    char name[256];              /* the scene file, or "the built-in scene" */
    char file[4096];             /* the scene file; empty: the built-in one, or a path that is too long */
    char camera[64];             /* its name */
    char placed[FREE_VIEW_TEXT]; /* the same camera as a free view */
    struct scene *scene;
    struct rays *rays;
    struct gbuffer *gbuffer;
    struct view view;
    struct plan_facts facts; /* without the sky's */
    double load_ms, bvh_ms, gbuffer_ms;
    bool borrowed; /* scene and rays belong to another set */
};

struct set_desc {
    const char *scene;            /* a path; NULL: the built-in one */
    struct scene_reading reading; /* of reading it */
    bool ground;                  /* below the model, even if the scene does not ask for one: scene/ground.h */
    const char *camera;           /* a name or a free view; NULL: the first of the scene */
    struct view_change change;    /* of that camera; not by set_create_view */
    uint32_t width, height;
    uint32_t edge_rays;            /* per side; 0: the default of gbuffer.h */
    bool every_pixel;              /* all pixels get the rays of edges */
    uint32_t interleave;           /* sets of light samples among neighbouring pixels, per side: gbuffer.h; 0: 1 */
    const struct kernels *kernels; /* whose CPU level Embree is held to; NULL: the best of this CPU */
    bool progress;                 /* show a progress line on standard error, if that is a terminal */
};

/* On ERR_OK the caller owns *out. Errors are those of scene_load, scene_add_ground, ground_check_camera and
 * gbuffer_create; ERR_USAGE: no such camera. */
MUST_CHECK enum err set_create(const struct set_desc *desc, struct set **out, struct reason *why);
void set_destroy(struct set *s); /* NULL is allowed */

/* Another camera (desc->camera) of the same scene: only the G-buffer is made; scene and rays are those of `of`, which
 * must outlive it. line is stepped once per row; the caller begins and ends it. Errors are those of set_create. */
MUST_CHECK enum err set_create_view(const struct set *of, const struct set_desc *desc, struct progress *line,
                                    struct set **out, struct reason *why);

struct relight_desc {
    struct direct_desc direct; /* seed, pass and cancel are those of all parts; a reference's samples are per pixel */
    uint32_t classes;          /* PATH_* of paths.h; 0: PATH_BACKGROUND | PATH_DIRECT */
    enum plan_estimator caustics, indirect; /* PLAN_AUTO: the plan chooses */
    uint64_t particles;                     /* 0: the plan chooses */
    uint32_t eye_paths;                     /* per shade point; 0: the plan chooses */
    enum start_kind start;                  /* of light paths */
    uint64_t cache_bytes;                   /* METHOD_CACHED: memory limit of its cache; 0: CACHE_MEMORY_DEFAULT */
    bool cache_if_kept;     /* only load it from a file, never compute it; that there is none is no error */
    bool cache_background;  /* compute it while pictures are made by other means; else the first waits for it */
    const char *cache_file; /* to keep it for the next run; "": in the cache folder (cache_place.h), NULL: none */
    const char *cache_dir;  /* the cache folder; NULL: the user's or the service's (cache/cache_folder.h) */
    bool denoise;           /* filter the light of shade points (denoise.h): half the samples and paths at a time, and
                             * at least one in either half. Not for references */
    bool remember;          /* live pictures: samples of the pictures before count too (history.h). Before there is a
                             * cache with `denoise`; then until it is complete, caustics (beside.h) also later, those
                             * not with a ground */
    struct progress *progress; /* a line of which the picture is one step; may be NULL. Not for references */
    bool unsplit;              /* METHOD_CACHED: no split of the sky: its bright part is not traced */
    /* PLAN_STORED, with the same memory limit: the number of stored paths, 0: 64 per pixel; one of `renew` parts is
     * redrawn with every turn, 0: none. The picture depends on the turn, not on earlier ones. */
    uint64_t stored_paths, turn;
    uint32_t renew;
};

struct relight_stats {           /* of one picture */
    double shade_ms, resolve_ms; /* direct light and all light of the cache; from points to pixels */
    double eye_ms, light_ms;     /* eye paths; light tracer */
    double filter_ms;            /* of the denoiser (denoise.h); 0: there was none */
    struct plan plan;
    struct direct_stats direct;
    struct eye_paths_stats eye;
    struct light_tracer_stats light;
    struct caustic_store_stats stored; /* PLAN_STORED; `light` is then that of the bright part */
    /* Of reference methods, whose whole time is in shade_ms. */
    uint64_t reference_rays;
    /* METHOD_CACHED: the cache, this frame's use of it, and cache_ms for computing or loading it in this run; 0: it was
     * there. */
    struct transport_stats cache;
    struct transport_frame_stats cache_frame;
    bool cache_loaded;  /* from a file */
    bool cache_refused; /* it would take too much memory: METHOD_AUTO lit the picture */
    double cache_share; /* that is computed: below 1 during computation in the background */
    double cache_ms;
    struct bounce_stats bounce; /* if the cache has interreflection too, */
    bool bounce_loaded;         /* and whether from a file */
    double error;               /* of live pictures while caches are computed: estimated relMSE against the truth
                                 * (stated.h); 0: unknown */
    const char *bias;           /* the bias of the picture in words; NULL: none */
};

struct relighter;

/* set and kernels must outlive it. NULL when out of memory. */
struct relighter *relighter_create(const struct set *set, const struct kernels *kernels);
void relighter_destroy(struct relighter *r);                /* NULL is allowed */
const struct set *relighter_set(const struct relighter *r); /* as created; borrowed. Any thread. */

/* Computes what desc's method needs before its first frame, optionally with a progress line, in *ms milliseconds.
 * relighter_run does it otherwise. Errors are those of relighter_run. */
MUST_CHECK enum err relighter_prepare(struct relighter *r, const struct relight_desc *desc, bool progress, double *ms);

/* Shares of a cache's computation, about those of its time. From RELIGHT_COARSE on it can make pictures: without
 * interreflection all of direct light is there coarsely; with it, that is there roughly, and direct light comes block
 * by block, until at RELIGHT_DIRECT all of it is there coarsely. */
#define RELIGHT_COARSE (1.0 / 17.0)
#define RELIGHT_DIRECT (2.0 / 17.0)

/* Progress of a cache in the background, while pictures are made by another method; to be called for each of them. 0:
 * there is none, or it was refused; below 1: it is being computed; 1: it is complete, with interreflection. */
double relighter_follow(struct relighter *r);

/* Renders the set under e: rgb float[height][width][3], linear. ERR_NOMEM; ERR_UNSUPPORTED where the method
 * needs another layout of environment; ERR_RANGE where its cache would exceed the memory limit. */
MUST_CHECK enum err relighter_run(struct relighter *r, const struct environment *e, const struct relight_desc *desc,
                                  float *rgb, struct relight_stats *stats);

/* With a ground, what makes pictures to be laid over other backgrounds (backplate.h). From now on keeps what
 * relighter_split needs. ERR_NOMEM. */
MUST_CHECK enum err relighter_keep_backplate(struct relighter *r);

/* Splits the last picture, not by a reference method, as backplate_split does. */
void relighter_split(const struct relighter *r, const struct environment *e, const float *rgb, float *rgba);

/* The radiance of the shade points in the last run, as direct_shade writes it. Borrowed. */
const float *relighter_points(const struct relighter *r);

#endif
