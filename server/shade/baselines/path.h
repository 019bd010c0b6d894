/* server/shade/baselines/path.h */
/* The reference: unidirectional path tracing with next event estimation and multiple importance sampling (balance
 * heuristic [Veach 1997, section 9.2]), one sample after another. It shares no code with the other estimators beyond
 * rays, materials and the sky's own tables, so that agreement means something: camera rays are its own, evenly over
 * the pixel (box filter), and followed through mirrors and glass by chance instead of by a list.
 *
 * A sample is a function of numbers in [0, 1) that have places: the same place always decides the same thing. Here they
 * come from a counter; mlt.h changes them a little at a time.
 *
 * Unbiased but for paths of more than PATH_EVENTS_MAX events. Pure functions; any thread may call them. */
#ifndef SHADE_BASELINES_PATH_H
#define SHADE_BASELINES_PATH_H

#include "environment.h"
#include "err.h"
#include "paths.h"
#include "rays.h"
#include "scene.h"
#include "view.h"

#include <stdatomic.h>
#include <stdint.h>

struct path_world { /* what is looked at, from where and in which light; borrowed */
    const struct scene *scene;
    const struct rays *rays;
    const struct view *view;
    const struct environment *environment; /* ready */
};

struct path_desc {
    uint32_t classes;          /* PATH_* of paths.h: what is counted; paths behind specular count as PATH_CAUSTICS
                                * (E S+ D S+ L) or PATH_INDIRECT (E S+ D (S* D)+ S* L) */
    uint32_t samples;          /* per pixel, >= 1 */
    uint64_t seed, pass;       /* together they decide every random number */
    const atomic_bool *cancel; /* once true, what is left stays black; may be NULL */
};

struct path_stats {
    uint64_t rays;    /* traced, shadow rays included */
    uint64_t samples; /* paths from the eye */
    const char *bias; /* NULL: right in the mean; else in what it is not, in words */
};

/* rgb: float[height][width][3] of the view's size, every pixel is written: mean radiance over the pixel. Runs on all
 * OpenMP threads; the result does not depend on their number. Always ERR_OK: it has the shape of its neighbours. */
MUST_CHECK enum err path_render(const struct path_world *world, const struct path_desc *desc, float *rgb,
                                struct path_stats *stats);

/* Where a sample's numbers come from: asked by place, in any order and maybe not at all. */
struct numbers {
    double (*at)(struct numbers *n, uint32_t place); /* in [0, 1), the same each time within one sample */
};

/* Places 0 and 1 are left to the caller, for the place in the picture; then so many for each event. */
#define PATH_PLACES_EVENT 7
#define PATH_PLACES (2 + PATH_EVENTS_MAX * PATH_PLACES_EVENT)

/* One sample: an estimate of the radiance that comes through (x, y) of the picture by paths of these classes. Adds to
 * *rays. */
void path_sample(const struct path_world *world, uint32_t classes, const double xy[2], struct numbers *numbers,
                 double rgb[3], uint64_t *rays);

#endif
