/* server/film/relight.h */
/* A scene that stands still, and one environment frame after another upon it: what relightd and the tools share.
 * struct set is made once and then only read: any number of threads. struct relighter belongs to one thread. */
#ifndef FILM_RELIGHT_H
#define FILM_RELIGHT_H

#include "direct.h"
#include "environment.h"
#include "err.h"
#include "gbuffer.h"
#include "kernels.h"
#include "rays.h"
#include "scene.h"

#include <stdbool.h>
#include <stdint.h>

/* The stage with its camera: geometry, BVH and G-buffer. */
struct set {
    char name[256]; /* the scene file, or "the built-in scene" */
    struct scene *scene;
    struct rays *rays;
    struct gbuffer *gbuffer;
    double load_ms, bvh_ms, gbuffer_ms;
};

struct set_desc {
    const char *scene;  /* a path; NULL: the built-in one */
    const char *camera; /* NULL: the first */
    uint32_t width, height;
    uint32_t edge_rays; /* per side; 0: the default of gbuffer.h */
    bool every_pixel;   /* all pixels get the rays of edges */
    bool progress;      /* show a progress line on standard error, if that is a terminal */
};

/* On ERR_OK the caller owns *out. Errors are those of scene_load and gbuffer_create; ERR_USAGE: no such camera. */
MUST_CHECK enum err set_create(const struct set_desc *desc, struct set **out, struct reason *why);
void set_destroy(struct set *s); /* NULL is allowed */

struct relight_stats { /* of one picture */
    double shade_ms, resolve_ms;
    struct direct_stats direct;
};

struct relighter;

/* set and kernels must outlive it. NULL when out of memory. */
struct relighter *relighter_create(const struct set *set, const struct kernels *kernels);
void relighter_destroy(struct relighter *r); /* NULL is allowed */

/* The picture of the set under e: rgb float[height][width][3], linear. ERR_NOMEM. */
MUST_CHECK enum err relighter_run(struct relighter *r, const struct environment *e, const struct direct_desc *desc,
                                  float *rgb, struct relight_stats *stats);

/* The shade points' own radiance of the last run, as direct_shade writes it. */
const float *relighter_points(const struct relighter *r);

#endif
