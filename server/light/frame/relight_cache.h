/* The relighter's caches: of direct light, of indirect light and of caustics; the file that stores the first two; the
 * thread that computes them beside images. Thread: one, unless noted. */
#pragma once

#include "base/digest.h"
#include "base/precedence.h"
#include "light/cache/cache_file.h"
#include "light/cache_direct/live.h"
#include "light/cache_direct/transport.h"
#include "light/cache_indirect/indirect.h"
#include "light/estimators/caustic_store.h"
#include "light/estimators/eye_paths.h"
#include "light/frame/relight.h"
#include "sky/tables/sky_split.h"

/* ---- The file ---- */

/* The file of a relighter's cache, at the path of its place: read before the computation, written after
 * it. Each fault is logged once, and parts that cannot be loaded are computed. Thread: one at a time. */

struct relight_keep {
    struct cache_place place;
    struct digest key;
    bool unreadable, unwritable;     /* a warning was logged */
    const struct cache_share *share; /* other processes that load the same; process 0 stores it. NULL: none */
};

/* desc: names the file; transport: the cache to compute, with these kernels. */
void relight_keep_init(struct relight_keep *k, const struct prepared_scene *set, const struct kernels *kernels,
                       const struct relight_desc *desc, const struct transport_desc *transport);

/* *out is NULL if the file cannot be used. ERR_RANGE: it would exceed the memory limit; ERR_NOMEM. */
MUST_CHECK enum err relight_keep_load(struct relight_keep *k, const struct prepared_scene *set,
                                      const struct kernels *kernels, const struct transport_desc *transport,
                                      struct transport **out, struct reason *why);

/* Collective, after loading: returns this process's error or that of another, and whether all processes have loaded it;
 * if not, all compute it. */
MUST_CHECK enum err relight_keep_agree(const struct relight_keep *k, enum err own, bool loaded, bool *all,
                                       struct reason *why);

/* Loads indirect light from the same file, as relight_keep_load. */
MUST_CHECK enum err relight_keep_load_indirect(struct relight_keep *k, const struct kernels *kernels,
                                               const struct indirect_desc *desc, struct indirect_cache **out,
                                               struct reason *why);

/* Stores direct light and indirect light. t NULL: direct light is not computed yet, and a file with it will replace
 * this one. bounce and its desc NULL: no indirect light. */
void relight_keep_save(struct relight_keep *k, const struct transport *t, const struct indirect_cache *indirect,
                       const struct indirect_desc *desc);

/* What live images store beside the two caches; NULL: nothing of the kind. */
struct relight_paths {
    struct eye_store *behind[2];    /* halves of eye paths at points behind mirrors and glass */
    struct caustic_store *caustics; /* light paths, of turn 0 */
};

/* The file of these paths, which lies beside that of the caches in their folder; with --cache-file there is none.
 * paths: a digest of what they depend on beyond the caches and the scene's materials. */
void relight_keep_init_paths(struct relight_keep *k, const struct relight_keep *caches,
                             const struct prepared_scene *set, const struct relight_desc *desc,
                             const struct digest *paths);

/* Reads them. behind: eye paths are wanted; p->caustics: an empty store if light paths are. False: some are missing,
 * and *p is as before. */
bool relight_keep_load_paths(struct relight_keep *k, const struct prepared_scene *set, bool behind,
                             struct relight_paths *p);
void relight_keep_save_paths(struct relight_keep *k, const struct relight_paths *p);

/* The file of what points see of the sun, which lies there too, and whose place relight_keep_init_paths names: adds it
 * to t, false if there is none, *whole: it has all of the day with this digest; and stores it, with all of a day. */
bool relight_keep_load_sun(struct relight_keep *k, struct transport *t, const struct digest *day, bool *whole);
void relight_keep_save_sun(struct relight_keep *k, struct transport *t, const struct digest *day);

struct relight_builder;

/* ---- Indirect light ---- */

/* Indirect light by a cache (light/cache_indirect/indirect.h), in addition to the cache of direct light, if the request
 * includes indirect light and leaves its estimator to the plan. Thread: one. */

struct relight_indirect { /* zero it first */
    struct indirect_cache *indirect;
    bool loaded;  /* from a file */
    bool refused; /* it exceeds the memory limit, which is logged; eye paths replace it */
};

/* Frees it and leaves it zeroed. */
void relight_indirect_finish(struct relight_indirect *b);

/* The cache description for a request, with the blocks of `direct`. */
struct indirect_desc relight_indirect_describe(const struct prepared_scene *set, const struct relight_desc *desc,
                                               const struct transport *direct);

/* Whether the cache provides PATH_INDIRECT_LIT of the request. */
bool relight_indirect_wanted(const struct prepared_scene *set, const struct relight_desc *desc);

/* Loads or computes the cache if it is needed and missing, and adds the milliseconds to *ms. direct: the cache of
 * direct light, whose packets and file it shares; NULL: that one was cancelled, and so is this one. Errors are those of
 * indirect_create, but too little memory is not an error. */
MUST_CHECK enum err relight_indirect_make(struct relight_indirect *b, const struct transport *direct,
                                          const struct prepared_scene *set, const struct kernels *kernels,
                                          const struct relight_desc *desc, struct relight_keep *keep, bool progress,
                                          double *ms);

/* The argument of transport_frame, borrowed. Fills stats->indirect and bias. */
const struct transport_indirect *relight_indirect_take(const struct relight_indirect *b, struct relight_stats *stats);

/* ---- Caustics ---- */

/* The relighter's store of light paths for PLAN_STORED: built before the first frame, or on request; every turn redraws
 * a part of it. One thread. */

struct relight_caustics { /* zero it first */
    struct caustic_store *store;
    struct caustic_store_desc made; /* the settings it was built with */
    struct sky_split sky;
    size_t image;                      /* floats in one image */
    struct eye_store *behind;          /* of points behind mirrors and glass; NULL: not asked for */
    struct eye_store_desc behind_made; /* the settings it was built with */
};

/* Frees it and leaves it zeroed. */
void relight_caustics_finish(struct relight_caustics *c);

/* Creates an empty store for these classes if it is missing. ERR_RANGE, ERR_NOMEM. */
MUST_CHECK enum err relight_caustics_begin(struct relight_caustics *c, const struct prepared_scene *set,
                                           const struct relight_desc *desc, uint32_t classes);

/* What such a store is made of. */
struct caustic_store_desc relight_caustics_describe(const struct prepared_scene *set, const struct relight_desc *desc,
                                                    uint32_t classes);

/* Owns `made`, of this description; the store so far is replaced if it is of the same. */
void relight_caustics_adopt(struct relight_caustics *c, struct caustic_store *made,
                            const struct caustic_store_desc *desc);

/* For live images: draws missing parts of desc->turn for about `seconds`, at least two parts. ERR_NOMEM. */
MUST_CHECK enum err relight_caustics_grow(struct relight_caustics *c, const struct relight_desc *desc, double seconds,
                                          struct relight_stats *stats);

/* Whether the store has all its parts, of whichever turns. */
bool relight_caustics_is_full(const struct relight_caustics *c);

/* True once the store of live images has grown enough to light them better than eye paths. */
bool relight_caustics_serve(const struct relight_caustics *c);

/* Divides the sky of an image into what stored paths light and what particles of the sun do. ERR_NOMEM. */
MUST_CHECK enum err relight_caustics_take(struct relight_caustics *c, const struct environment *e,
                                          const struct relight_desc *desc);

/* The light tracer's description for the sun of e, which gets its energy share of `particles`, under the sky
 * taken. */
struct light_tracer_desc relight_caustics_sun(const struct relight_caustics *c, const struct environment *e,
                                              const struct relight_desc *desc, uint64_t particles);

/* Builds the store for these classes if it is missing, and adds the milliseconds to *ms. progress: draw a line.
 * ERR_RANGE: a few paths would exceed the memory limit. Cancellation may leave it incomplete and is not an error. */
MUST_CHECK enum err relight_caustics_make(struct relight_caustics *c, const struct prepared_scene *set,
                                          const struct relight_desc *desc, uint32_t classes, bool progress, double *ms);

/* Draws the missing parts of desc->turn, then adds to rgb the store's light under e and the light of particles from the
 * sun, which gets its energy share of plan->particles. With a ground, rgb has the layout of
 * caustic_store_desc.ground_apart. Fills stats->light and stats->stored. ERR_NOMEM. */
MUST_CHECK enum err relight_caustics_run(struct relight_caustics *c, struct light_tracer *light,
                                         const struct environment *e, const struct relight_desc *desc, float *rgb,
                                         struct relight_stats *stats);

/* Stores eye paths of these classes at points behind mirrors and glass (eye_paths.h), 8 for each of `paths`, if they
 * are missing, and adds the milliseconds to *ms. ERR_NOMEM. */
MUST_CHECK enum err relight_caustics_make_behind(struct relight_caustics *c, const struct prepared_scene *set,
                                                 const struct relight_desc *desc, uint32_t classes, uint32_t paths,
                                                 double *ms);

/* Adds their light to the shade points, if there are any. */
void relight_caustics_behind(const struct relight_caustics *c, const struct environment *e, float *lo,
                             struct relight_stats *stats);

/* ---- The cache of light transport ---- */

/* The light transport cache of `--method cached`, loaded or computed before the relighter's first frame, or on request.
 */

struct relight_cache {                /* zero it first */
    struct transport *transport;      /* the builder's if there is one */
    struct relight_builder *builder;  /* computes it in the background, or has finished */
    bool building;                    /* the builder has not finished */
    struct precedence urgent;         /* of images over it */
    struct relight_indirect indirect; /* of the same packets */
    struct relight_keep keep;         /* the file of both */
    const struct cache_share *share;  /* other processes that have the same cache; NULL: none. Stays when it is freed */
    bool no_visibility;               /* the setting it was computed with */
    uint64_t max_bytes;
    bool loaded;  /* from a file */
    bool refused; /* with these settings; it is not retried */
    bool kept;    /* relight_cache_keep was called */
    struct reason why;
};

/* Frees it. */
void relight_cache_finish(struct relight_cache *c);

/* Loads or computes it if it is missing, in *ms milliseconds (0: it was there). progress: draw a line. With
 * desc->cache_background a thread computes it, and a refusal is not an error, because METHOD_AUTO lights the images
 * then. Otherwise the call waits for a running computation. ERR_RANGE: it would exceed the memory limit. Cancellation
 * leaves no cache and is not an error. A file that cannot be used or written is logged and is not an error. */
MUST_CHECK enum err relight_cache_make(struct relight_cache *c, const struct prepared_scene *set,
                                       const struct kernels *kernels, const struct relight_desc *desc, bool progress,
                                       double *ms);

/* With other processes: tells them if a request needs a missing cache, so that all load or compute it. ERR_IO:
 * one does not answer. */
MUST_CHECK enum err relight_cache_begin(const struct relight_cache *c, const struct prepared_scene *set,
                                        const struct relight_desc *desc);

/* With other processes, once both caches are complete and stored: process 0 frees the parts that only other processes
 * need. ERR_NOMEM. */
MUST_CHECK enum err relight_cache_keep(struct relight_cache *c);

/* With other processes, once the range share->first to share->end has shrunk: frees the data outside. ERR_NOMEM.
 */
MUST_CHECK enum err relight_cache_narrow(struct relight_cache *c);

/* As relighter_follow. */
double relight_cache_follow(struct relight_cache *c);

/* As relight_builder_behind. */
const struct eye_store *const *relight_cache_behind(const struct relight_cache *c);

/* True once there is a finished cache, and frames use no other. */
bool relight_cache_is_settled(const struct relight_cache *c);

/* ---- The builder's thread ---- */

/* A thread that computes a relighter's cache of light transport while the relighter renders images
 * (light/cache_direct/live.h), and then writes its file. */

/* The request; set and kernels must outlive the builder. */
struct relight_builder_desc {
    const struct prepared_scene *set;
    const struct kernels *kernels;
    const struct relight_desc *light;       /* copied */
    const struct transport_desc *transport; /* `urgent` precedes indirect light, too */
    const struct relight_keep *keep;
    const struct transport *loaded; /* the cache of direct light if it exists already; else NULL */
};

/* Starts the builder, which removes the largest errors first: a quick, rough cache of indirect light, if needed, that
 * frames use at once; coarse direct light; stored paths of caustics; full indirect light, stored at once so
 * that a kill does not lose it; full direct light. Parts in the file are loaded instead. ERR_NOMEM. */
MUST_CHECK enum err relight_builder_create(const struct relight_builder_desc *desc, struct relight_builder **out,
                                           struct reason *why);

/* Stops the computation within some hundredths of a second, and frees the cache. NULL is allowed. */
void relight_builder_destroy(struct relight_builder *b);

/* Waits until it has read what files hold: afterwards it is done or computes. */
void relight_builder_await_files(struct relight_builder *b);

/* The cache of direct light that it computes; NULL if it was loaded. */
struct transport_live *relight_builder_live(struct relight_builder *b);

/* Returns a new cache of indirect light or NULL. The caller owns it and must keep it until it gets another one or
 * destroys the builder. Thread: any. */
struct indirect_cache *relight_builder_take(struct relight_builder *b);

/* Two halves of the eye paths behind mirrors and glass of live images (eye_paths.h); NULL: not there, or not wanted.
 * They are the builder's. Thread: any. */
const struct eye_store *const *relight_builder_behind(const struct relight_builder *b);

/* Hands over the store of light paths, once, to those who have begun one like it. */
void relight_builder_take_caustics(struct relight_builder *b, struct relight_caustics *to);

/* False while it computes. Once true, one more call of relight_builder_take returns the last cache. *e is the result of
 * direct light, with a reason: ERR_RANGE, ERR_NOMEM. bounce->loaded and bounce->refused are the result of
 * indirect light; if refused, no cache of it may be used. */
bool relight_builder_is_done(struct relight_builder *b, enum err *e, struct relight_indirect *indirect,
                             struct reason *why);

/* How far the stages of both caches are, each 0 to 1. */
struct relight_stages {
    bool wanted, quick_ended; /* indirect light; its quick cache is there */
    double quick, whole;      /* of indirect light */
    double coarse, fine;      /* of direct light */
};

/* The share of all, at most 0.99. */
double relight_share(const struct relight_stages *s);

/* After a frame by the finished cache t: the builder asks ahead for what its points see of the sun on this day, from
 * where it stood in that frame (transport_look_at). */
void relight_builder_aim(struct relight_builder *b, struct transport *t, const struct sun_day *day);

/* The computed share, 0 to 1; 1 only when complete. See relight.h for RELIGHT_COARSE and RELIGHT_DIRECT. */
double relight_builder_share(const struct relight_builder *b);

/* As relighter_awaits_whole. */
bool relight_builder_awaits_whole(const struct relight_builder *b);
