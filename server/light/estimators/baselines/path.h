/* The reference: unidirectional path tracing with next event estimation and multiple importance sampling (balance
 * heuristic [Veach 1997, section 9.2]), one sample after another. It shares no code with the other estimators except
 * rays, materials and the sky's own tables, so that agreement is meaningful: it traces its own camera rays, uniform
 * over the pixel (box filter), and selects one continuation at mirrors and glass instead of following all.
 *
 * A sample is a function of indexed random numbers in [0, 1): the same index always decides the same thing. Here they
 * come from a counter; path.h mutates them.
 *
 * Unbiased, except for paths of more than PATH_EVENTS_MAX events. Thread: any. */
#pragma once

#include "base/err.h"
#include "light/estimators/paths.h"
#include "scene/geometry/gbuffer.h"
#include "scene/geometry/rays.h"
#include "scene/geometry/scene.h"
#include "scene/geometry/view.h"
#include "sky/tables/environment.h"

#include <stdatomic.h>
#include <stdint.h>

struct path_world { /* scene, camera and light; borrowed */
    const struct scene *scene;
    const struct rays *rays;
    const struct view *view;
    const struct environment *environment; /* ready */
    /* The radiance of the ground (scene/geometry/ground.h) if nothing were on it: where the camera sees it, also in
     * mirrors and through glass, its light counts as a share of that, times the sky behind it. NULL: it is seen as it
     * is. */
    const double *bare_ground;
};

/* Whether the eye sees the material as a share of the sky behind it. */
static inline bool path_shows_ground(const struct path_world *w, uint32_t material)
{
    return w->bare_ground && w->scene->materials[material].ground;
}

/* That sky over the bare ground's radiance: factors of the light that the ground sends against dir. Where no light
 * falls on a bare ground they are 0, and out[k] of `still` is the sky. */
void path_ground_factor(const struct path_world *w, struct vec3 dir, double factor[3], float still[3]);

struct path_desc {
    uint32_t classes; /* PATH_* of paths.h to include; paths behind specular surfaces count as PATH_CAUSTICS (E S+ D S+
                         L) or PATH_INDIRECT (E S+ D (S* D)+ S* L) */
    uint32_t samples; /* per pixel, >= 1 */
    uint64_t seed, pass;       /* determine all random numbers */
    const atomic_bool *cancel; /* once true, remaining pixels stay black; may be NULL */
};

struct path_stats {
    uint64_t rays;    /* traced, including shadow rays */
    uint64_t samples; /* paths from the eye */
    const char *bias; /* NULL: unbiased; else a description of the bias */
};

/* Renders rgb: float[height][width][3] of the view's size, mean radiance per pixel; writes every pixel. Runs on all
 * OpenMP threads; the result does not depend on their number. Always ERR_OK. */
MUST_CHECK enum err path_render(const struct path_world *world, const struct path_desc *desc, float *rgb,
                                struct path_stats *stats);

/* The random numbers of a sample: requested by index, in any order, possibly not at all. */
struct numbers {
    double (*at)(struct numbers *n, uint32_t place); /* in [0, 1), constant within one sample */
};

/* Indices 0 and 1 are the position in the image; then this many per event. */
#define PATH_PLACES_EVENT 7
#define PATH_PLACES (2 + PATH_EVENTS_MAX * PATH_PLACES_EVENT)

/* Evaluates one sample: an estimate of the radiance through (x, y) of the image by paths of these classes. Adds to
 * *rays. */
void path_sample(const struct path_world *world, uint32_t classes, const double xy[2], struct numbers *numbers,
                 double rgb[3], uint64_t *rays);

/* As path_sample, of the light of a shading point of the G-buffer towards the eye: classes are those of paths whose
 * first rough surface is there. Number 1 says where in the pixel its rays start; number 0 and the first event's choice
 * are not used. */
void path_sample_point(const struct path_world *world, const struct shade_packet *p, uint32_t lane, uint32_t classes,
                       struct numbers *numbers, double rgb[3], uint64_t *rays);

/* ---- Photon mapping ---- */

/* Photon mapping [Jensen 1996]: stores particles from the sky where they hit a D lobe; the radiance of a point is
 * estimated from its nearest photons and the disc that contains them. [DH09, section 1] suggests this use of its light
 * paths. For comparison on the charts; `auto` never selects it.
 *
 * Background and direct light are path.h's. Caustics have a separate map, whose particles start at the boxes of
 * specular objects. The estimate is blurred by the disc: biased at edges, in corners and on curved surfaces, and
 * consistent only as the number of particles goes to infinity. Thread: any; runs on all OpenMP threads. */

/* As path_render. Each of the two maps gets as many particles as the image has samples, at most 2^20, and is evaluated
 * for an eighth of the samples of each pixel. stats includes everything and describes the bias. ERR_NOMEM. */
MUST_CHECK enum err photons_render(const struct path_world *world, const struct path_desc *desc, float *rgb,
                                   struct path_stats *stats);

/* ---- Virtual point lights ---- */

/* Virtual point lights [Keller 1997]: particles from the sky leave a small light wherever they hit a D lobe, and these
 * light what the camera sees. [DH09, section 1] suggests this use of its light paths. For comparison on the charts;
 * `auto` never selects it.
 *
 * Background and direct light are path.h's. Indirect light is what the lights contribute where they are visible from
 * the point: paths with a mirror or glass in between, and caustics, are missing. The contribution of a near light is
 * clamped to what the patch it represents could contribute, so that corners are too dark, less so with more samples.
 * Thread: any; runs on all OpenMP threads. */

/* As path_render; desc->samples is also the number of particles: sample i of every pixel is lit by particle i. stats
 * includes both and describes the bias. ERR_NOMEM. */
MUST_CHECK enum err vpl_render(const struct path_world *world, const struct path_desc *desc, float *rgb,
                               struct path_stats *stats);

/* ---- Metropolis light transport ---- */

/* Metropolis light transport in primary sample space [Kelemen et al. 2002], on top of path.h: Markov chains over the
 * random numbers of a sample. A mutation changes all numbers slightly, or redraws all of them (a large step, 30 %).
 * Chains spend more time where paths carry more luminance; both the current and the proposed state are splatted,
 * weighted by their probability. Large steps also count as independent samples, by the balance heuristic.
 *
 * Normalisation comes from a bootstrap of independent samples. Chains start at bootstrap samples selected in proportion
 * to luminance; with the bootstrap's mean as weight, all states are unbiased from the start, and none is discarded
 * [Veach 1997, chapter 11]. The balance weights come from a separate pilot. The image is therefore unbiased for any
 * number of mutations, like path.h's, but its error is distributed unevenly and correlated between pixels.
 * Thread: any; runs on all OpenMP threads. */

/* As path_render, with desc->samples mutations per pixel; stats->samples includes bootstrap and pilot, about a quarter
 * more. Chains are many and short, their number depends only on the image size, and splats are integers, so that the
 * result does not depend on the number of threads. The image is black once cancelled, or if neither pilot nor bootstrap
 * found light. ERR_NOMEM. */
MUST_CHECK enum err mlt_render(const struct path_world *world, const struct path_desc *desc, float *rgb,
                               struct path_stats *stats);
