/* server/shade/light_tracer.h */
/* Light followed from the sky into the scene, and joined to the eye wherever it meets a rough surface [DH09]: caustics,
 * which no path from the eye finds under a sun, and interreflection (paths.h).
 *
 * A particle begins with flux L / (p_w p_y) / N: its direction is drawn from the sky's whole table (samples_whole), its
 * line from the boxes that may count (start.h): those of the specular casters where only caustics and their
 * interreflection are wanted, else the scene's. At a surface it meets, with wi pointing back to where it came from, w
 * to where it goes, and n_s, n_g the shading and the geometric normal:
 *  - at a rough lobe f the eye receives flux f(wo, wi) |wi.n_s| / |wi.n_g| |wo.n_g| times the camera's response
 *    (view.h), if nothing is in between: one splat, on the pixel that sees the point;
 *  - it goes on by the rough lobe with f(w, wi) |wi.n_s| |w.n_g| / (|wi.n_g| pdf) of its flux, every w with w.n_g > 0
 *    being possible [Veach 1997, Eq. 5.19], or by one of the rays of scatter_light.
 * Both say what the eye's side says: light counts where wi is above both normals. Radiance's n^2 has no place here.
 * Russian roulette ends paths without bias; what is scattered more than PATH_EVENTS_MAX times is left out.
 *
 * What the camera sees in a mirror or through glass is out of reach: eye_paths.h has it. */
#ifndef SHADE_LIGHT_TRACER_H
#define SHADE_LIGHT_TRACER_H

#include "environment.h"
#include "err.h"
#include "paths.h"
#include "rays.h"
#include "scene.h"
#include "start.h"
#include "view.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

/* What 0 stands for in starts_per_direction. On the ring scene the variance of a picture is the same within its doubt
 * from 1 to 64, under a sun and under an overcast sky, and a particle takes half the time at 16 that it takes at 1. */
#define STARTS_PER_DIRECTION 16
#define STARTS_PER_DIRECTION_MAX 1024

struct light_tracer;
struct transport_sky;

struct light_tracer_desc {
    uint32_t classes;    /* PATH_CAUSTICS | PATH_INDIRECT, or part of them; without PATH_INDIRECT_LIT all begin
                          * at a caster, and the boxes are the casters' */
    uint64_t particles;  /* N; 0: nothing is done */
    uint64_t seed, pass; /* together they decide every random number; the passes of a seed that have the same N
                          * go on with one low-discrepancy sequence, so that their mean gains from it */
    enum start_kind start;
    uint32_t starts_per_direction;      /* 1..STARTS_PER_DIRECTION_MAX; 0: the default */
    const struct transport_sky *bright; /* of this very frame: its bright part alone lights; NULL: the whole sky */
    const atomic_bool *cancel;          /* once true, the run ends and adds nothing; may be NULL */
};

struct light_tracer_stats {
    uint64_t particles;  /* begun */
    uint64_t starts_hit; /* of these, whose first surface counts: a caster where only caustics are wanted, else any */
    uint64_t rays;       /* traced, those to the eye included */
    uint64_t splats;
};

/* Scene and rays must outlive the object; the view is copied. Memory: 24 bytes a pixel, and some 10 MB of splats that
 * wait to be summed. NULL when out of memory. One per thread of control. */
struct light_tracer *light_tracer_create(const struct scene *scene, const struct rays *rays, const struct view *view);
void light_tracer_destroy(struct light_tracer *t); /* NULL is allowed */

/* rgb: float[height][width][3], radiance; what is found is added to it. Runs on all OpenMP threads; the result does not
 * depend on their number. A scene without casters has no caustics, a black sky no light: then nothing is traced.
 * ERR_NOMEM: nothing was added. */
MUST_CHECK enum err light_tracer_run(struct light_tracer *t, const struct environment *e,
                                     const struct light_tracer_desc *desc, float *rgb,
                                     struct light_tracer_stats *stats);

#endif
