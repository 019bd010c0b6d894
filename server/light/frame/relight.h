/* A static scene, relit by one environment frame after another, for relightd and the tools. A struct prepared_scene is
 * immutable; any number of threads may read it. A struct relighter belongs to one thread. */
#pragma once

#include "base/err.h"
#include "import/reader/reader.h"
#include "light/cache_direct/transport.h"
#include "light/cache_indirect/indirect.h"
#include "light/estimators/caustic_store.h"
#include "light/estimators/direct.h"
#include "light/estimators/eye_paths.h"
#include "light/estimators/kernels.h"
#include "light/estimators/light_tracer.h"
#include "light/plan/plan.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/rays.h"
#include "scene/geometry/scene.h"
#include "scene/geometry/view.h"
#include "sky/daylight/sun.h"
#include "sky/tables/environment.h"

#include <stdbool.h>
#include <stdint.h>

struct progress;

/* A scene as seen by one camera: geometry, BVH and G-buffer. */
struct prepared_scene {
    char name[256];              /* the scene file, or "the built-in scene" */
    char file[4096];             /* the scene file; empty: the built-in scene, or the path is too long */
    char camera[64];             /* its name */
    char placed[FREE_VIEW_TEXT]; /* the same camera as a free view */
    struct scene *scene;
    struct rays *rays;
    struct gbuffer *gbuffer;
    struct view view;
    struct plan_facts facts; /* except the sky's */
    double load_ms, bvh_ms, gbuffer_ms;
    double gbuffer_cost_s; /* processor time per thread */
    bool borrowed;         /* scene and rays belong to another set */
    bool coarse;           /* by set_desc.soon: one camera ray per pixel */
};

struct prepared_scene_desc {
    const char *scene;            /* a path; NULL: the built-in one */
    struct scene_reading reading; /* options for reading it */
    bool ground;                  /* add a ground below the model even if the scene does not request one:
                                     scene/geometry/ground.h */
    const char *camera;           /* a name or a free view; NULL: the scene's first */
    struct view_change change;    /* changes to that camera; set_create_view ignores it */
    uint32_t width, height;
    uint32_t edge_rays;            /* per side; 0: the default of gbuffer.h */
    bool every_pixel;              /* trace the edge rays in all pixels */
    bool soon;                     /* for a first image: if the scene has glass, whose rays branch, one camera ray per
                                      pixel, until set_create_complete; not with every_pixel */
    const struct kernels *kernels; /* whose CPU level limits Embree; NULL: the best of this CPU */
    bool progress;                 /* show a progress line on standard error, if that is a terminal */
};

/* On ERR_OK the caller owns *out. Errors are those of scene_load, scene_add_ground, ground_check_camera and
 * gbuffer_create; ERR_USAGE: no such camera. */
MUST_CHECK enum err set_create(const struct prepared_scene_desc *desc, struct prepared_scene **out, struct reason *why);
void set_destroy(struct prepared_scene *s); /* NULL is allowed */

/* Creates the complete set, of the same view, for a coarse one; desc as for that, without `soon`. Otherwise like
 * set_create_view. */
MUST_CHECK enum err set_create_complete(const struct prepared_scene *coarse, const struct prepared_scene_desc *desc,
                                        struct progress *line, struct prepared_scene **out, struct reason *why);
/* Scene and rays, which `to` borrows from `from`, become its own: `from` may now go first. */
void set_hand_over(struct prepared_scene *from, struct prepared_scene *to);

/* Creates a set for another camera (desc->camera) of the same scene: builds only the G-buffer and borrows scene and
 * rays from `of`, which must outlive the set. line is stepped once per row; the caller begins and ends it. Errors are
 * those of set_create. */
MUST_CHECK enum err set_create_view(const struct prepared_scene *of, const struct prepared_scene_desc *desc,
                                    struct progress *line, struct prepared_scene **out, struct reason *why);

/* METHOD_COMPONENTS: what makes the whole image. run: float[height][width][3]; ERR_UNSUPPORTED, ERR_NOMEM. */
struct relight_whole {
    enum err (*run)(void *self, const struct prepared_scene *set, const struct environment *e, float *rgb,
                    struct reason *why);
    void *self;
    const char *bias; /* as in relight_stats */
};

struct relight_desc {
    struct direct_desc direct; /* seed, pass and cancel apply to all parts; a reference's samples are per pixel */
    uint32_t classes;          /* PATH_* of paths.h; 0: PATH_BACKGROUND | PATH_DIRECT */
    enum plan_estimator caustics, indirect; /* PLAN_AUTO: the plan chooses */
    uint64_t particles;                     /* 0: the plan chooses */
    uint32_t eye_paths;                     /* per shade point; 0: the plan chooses */
    enum start_kind start;                  /* of light paths */
    uint64_t cache_bytes;                   /* METHOD_CACHED: memory limit of its cache; 0: CACHE_MEMORY_DEFAULT */
    bool cache_if_kept;     /* only load the cache from a file, never compute it; a missing file is not an error */
    bool cache_background;  /* compute it while other techniques make images; else the first image waits for it */
    bool has_sun_day;       /* the sun's way is known, */
    struct sun_day sun_day; /* in the scene, and asked for ahead in the background */
    const char
        *cache_file; /* file to store it for the next run; "": in the folder (light/cache/cache_file.h), NULL: none */
    const char *cache_dir; /* the cache folder; NULL: the user's or the service's (light/cache/cache_file.h) */
    bool denoise;          /* filter the light at shade points (denoise.h): each half gets half the samples and paths,
                              but at least one path, and eight samples of direct light alone without `remember`. Not
                              for references */
    bool remember;         /* live images: samples of earlier images count, too (denoise.h). With `denoise`, before
                              a cache exists. Caustics (beside.h) keep this afterwards, except with a ground */
    bool glide;            /* under a still sky images with a filter glide (ACCUMULATION_GLIDE) */
    struct progress *progress;         /* a progress line that the image advances by one step; may be NULL. Not for
                                          references */
    const struct relight_whole *whole; /* METHOD_COMPONENTS; NULL: there is none */
    double audit; /* rays spent on stating the image's error, over its own, and those of light/audit/audit.h. 0: none */
    bool audit_live;   /* images save their rays up, and an audit tells of later ones too */
    double audit_most; /* of the processor time since the first image, for audits; half of it, while the cache is
                          computed, so that its first image has some left. 0: any */
    bool unsplit;      /* METHOD_CACHED: do not split the sky, so that its sun is not traced */
    /* PLAN_STORED, with the same memory limit: the number of stored paths (0: 64 per pixel). Every turn redraws one of
     * `renew` parts (0: none). The image depends on the turn, but not on earlier turns. */
    uint64_t stored_paths, turn;
    uint32_t renew;
};

struct relight_stats {           /* of one image */
    double shade_ms, resolve_ms; /* direct light and all light by the cache; resolving to pixels */
    double eye_ms, light_ms;     /* eye paths; light tracer */
    double filter_ms;            /* of the denoiser (denoise.h); 0 without one */
    struct plan plan;
    struct direct_stats direct;
    struct eye_paths_stats eye;
    struct light_tracer_stats light;
    struct caustic_store_stats stored;    /* PLAN_STORED; `light` is then that of the sun */
    struct eye_store_stats stored_behind; /* of points behind mirrors and glass, with METHOD_CACHED */
    /* Of reference methods, which report their whole time in shade_ms. */
    uint64_t reference_rays;
    /* METHOD_CACHED: the cache, this frame's use of it, and cache_ms, the time of computing or loading it in this run;
     * 0: it existed already. */
    struct transport_stats cache;
    struct transport_frame_stats cache_frame;
    bool cache_loaded;  /* from a file */
    bool cache_refused; /* it needs too much memory, so METHOD_AUTO lit the image */
    double cache_share; /* computed share: below 1 during computation in the background */
    double cache_ms;
    struct indirect_stats indirect; /* if the cache includes indirect light, */
    bool indirect_loaded;           /* and whether from a file */
    double error;                   /* relMSE against the truth, by an audit (light/audit/audit.h); 0: unknown */
    double error_at_most;           /* where it is unknown: an upper bound (section 19 of mathematics.md); 0: none */
    struct {
        uint32_t pixels;
        uint64_t rays; /* for this image */
        double ms;     /* and the process's processor time meanwhile: */
        double processor_s;
        double found; /* the error, however uncertain; 0: no pixel was judged */
    } audited;
    bool still;       /* the sky is the last image's; of live images */
    unsigned glides;  /* images that will only move on to the light of this one's samples, if the sky stays */
    const char *bias; /* a description of the image's bias; NULL: none */
};

struct relighter;

/* set and kernels must outlive it. NULL when out of memory. */
struct relighter *relighter_create(const struct prepared_scene *set, const struct kernels *kernels);
void relighter_destroy(struct relighter *r);                           /* NULL is allowed */
const struct prepared_scene *relighter_set(const struct relighter *r); /* as created; borrowed. Any thread. */

/* Prepares what desc's method needs before its first frame, optionally with a progress line, in *ms milliseconds.
 * Otherwise relighter_run does it. Errors are those of relighter_run. */
MUST_CHECK enum err relighter_prepare(struct relighter *r, const struct relight_desc *desc, bool progress, double *ms);

/* Progress of a cache's computation, roughly in proportion to time. From RELIGHT_COARSE on the cache can make images.
 * Without indirect light, all direct light is available coarsely then; with it, rough indirect light is available and
 * direct light follows block by block, until all of it is available coarsely at RELIGHT_DIRECT. */
#define RELIGHT_COARSE (1.0 / 17.0)
#define RELIGHT_DIRECT (2.0 / 17.0)
#define RELIGHT_WHOLE (RELIGHT_DIRECT + 0.5 * (1.0 - RELIGHT_DIRECT)) /* all indirect light */

/* Progress of a cache in the background while another method makes the images; call it for each image. 0: there is
 * none, or it was refused; below 1: it is being computed; 1: it is complete, with indirect light. */
double relighter_follow(struct relighter *r);

/* Whether there is no rough indirect light (indirect.h), so that the cache makes images from RELIGHT_WHOLE on only. */
bool relighter_awaits_whole(const struct relighter *r);

/* Renders the set under e: rgb float[height][width][3], linear. ERR_NOMEM; ERR_UNSUPPORTED if the method needs another
 * environment layout; ERR_RANGE if its cache would exceed the memory limit. */
MUST_CHECK enum err relighter_run(struct relighter *r, const struct environment *e, const struct relight_desc *desc,
                                  float *rgb, struct relight_stats *stats);

/* With a ground: from now on keeps the data that relighter_split needs to composite images over other backgrounds
 * (resolve.h). ERR_NOMEM. */
MUST_CHECK enum err relighter_keep_backplate(struct relighter *r);

/* Splits the last image, which no reference method may have made, as backplate_split does. */
void relighter_split(const struct relighter *r, const struct environment *e, const float *rgb, float *rgba);

/* The radiance at the shade points in the last run, in the layout of direct_shade. Borrowed. */
const float *relighter_points(const struct relighter *r);
