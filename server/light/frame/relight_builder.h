/* A thread that computes a relighter's cache of light transport while the relighter renders images
 * (light/cache_direct/live.h), and then writes its file. */
#pragma once

#include "light/cache_direct/live.h"
#include "light/frame/relight_caustics.h"
#include "light/frame/relight_indirect.h"
#include "light/frame/relight_keep.h"

struct relight_builder;

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

/* Two halves of the eye paths behind mirrors and glass of live images (eye_store.h); NULL: not there, or not wanted.
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

/* The computed share, 0 to 1; 1 only when complete. See relight.h for RELIGHT_COARSE and RELIGHT_DIRECT. */
double relight_builder_share(const struct relight_builder *b);
