/* The light tracer: traces paths from the sky into the scene and connects them to the camera at every rough surface
 * [DH09]: it finds caustics, which eye paths miss under a sun, and indirect light (paths.h).
 *
 * A particle starts with flux L / (p_w p_y) / N: its direction is sampled from the whole sky (environment_sample), its
 * line from boxes (struct start, below): those of the specular casters if only caustics and their indirect light are
 * requested, else the scene's. At a hit, let wi point back to where the particle came from, w to where it continues,
 * and n_s, n_g be the shading and geometric normals:
 *  - at a rough lobe f, the camera receives flux f(wo, wi) |wi.n_s| / |wi.n_g| |wo.n_g| times its response (view.h), if
 *    unoccluded: one splat, on the pixel that sees the point;
 *  - the particle continues by the rough lobe with f(w, wi) |wi.n_s| |w.n_g| / (|wi.n_g| pdf) of its flux, where every
 * w with w.n_g > 0 is possible [Veach 1997, Eq. 5.19], or by one of the rays of scatter_light. Both match the camera
 * side: light counts where wi is above both normals. The n^2 of radiance does not apply to flux. Russian roulette ends
 * paths without bias; paths of more than PATH_EVENTS_MAX events are omitted.
 *
 * Surfaces seen in a mirror or through glass are out of reach; eye_paths.h handles them. Thread: one per tracer. */
#pragma once

#include "base/err.h"
#include "base/vec.h"
#include "light/estimators/packed.h"
#include "light/estimators/paths.h"
#include "scene/geometry/rays.h"
#include "scene/geometry/scene.h"
#include "scene/geometry/view.h"
#include "sky/tables/environment.h"
#include "sky/tables/sky_split.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* ---- Where paths start ---- */

/* Where light paths from the environment start [DH09, section 3]: for a direction, samples a line of light that hits
 * given boxes. The density is per square metre perpendicular to the direction.
 *
 * Several boxes form a mixture: a box is selected in proportion to the area of its shape, a position in it uniformly,
 * so that p = (number of shapes that the line crosses) / (sum of their areas). Every line that hits a box is possible.
 * Thread: any. */

enum start_kind {
    START_FACES, /* the visible faces of a box, by projected area: exactly its silhouette */
    START_QUAD,  /* the minimum-area rectangle around the projected box [DH09, Fig. 3] */
    START_DISC,  /* the projected bounding sphere [Pharr and Humphreys 2004, section 14.2] */
};

#define START_BOXES_MAX 32 /* bounds arrays on the stack: start_join joins the others */

struct start_shape {
    double centre[3], half[3]; /* of the box */
    double face[3];            /* START_FACES: projected area of the visible face per axis */
    double side[2][3];         /* START_QUAD: two unit vectors */
    double reach[2];           /* START_QUAD: half the edges along them; START_DISC: the radius */
};

struct start { /* the setup for one direction */
    enum start_kind kind;
    double along[3]; /* unit, the direction in which light travels */
    double area;     /* m^2, total of the shapes */
    double low[3], high[3];
    uint32_t count;
    double areas[START_BOXES_MAX]; /* m^2, perpendicular to the direction */
    struct start_shape shapes[START_BOXES_MAX];
};

/* Sets up a direction. boxes: 1..START_BOXES_MAX, possibly flat. bounds: the scene's, which contains all boxes. along:
 * unit. */
void start_init(struct start *s, enum start_kind kind, const struct box *boxes, uint32_t count,
                const struct box *bounds, struct vec3 along);

/* Samples a line along `along` from x in [0, 1)^2 and returns a point on it outside the scene's bounds, so that the ray
 * hits any occluder. False if there is nothing to hit: the line misses the bounds (*density is set), or no shape has an
 * area. */
bool start_sample(const struct start *s, const double x[2], struct vec3 *origin, double *density);

/* Reduces the boxes, in place, to at most START_BOXES_MAX by joining the pairs whose common box adds the least surface
 * area. Returns the number left. */
uint32_t start_join(struct box *boxes, size_t count);

/* Lines per direction. On the ring scene, the variance of an image is the same within measurement error
 * from 1 to 64, under a sun and under an overcast sky, and a particle takes half as long at 16 as at 1. */
#define STARTS_PER_DIRECTION 16

struct progress_part;
struct light_tracer;

#define PARTICLES_A_STEP 4 /* so that counting costs little */

struct light_tracer_desc {
    uint32_t classes; /* PATH_CAUSTICS | PATH_INDIRECT or a part of them; without PATH_INDIRECT_LIT all paths start at a
                         caster, and the boxes are the casters' */
    uint32_t shown;   /* the classes to add to rgb; the particles stay the same. 0: all */
    uint64_t particles;  /* N; 0: do nothing */
    uint64_t seed, pass; /* determine all random numbers; the passes of a seed with the same N continue one
                            low-discrepancy sequence, so that their mean converges faster */
    enum start_kind start;
    float *ground; /* float[height][width][3]: receives light on the ground (scene/geometry/ground.h); NULL: rgb
                      receives it */
    const struct sky_split *sun;    /* of this frame: only its sun emits light; NULL: the whole sky */
    struct progress_part *progress; /* stepped by one for each PARTICLES_A_STEP; may be NULL */
    const atomic_bool *cancel;      /* once true, the run ends and adds nothing; may be NULL */
};

struct light_tracer_stats {
    uint64_t particles;  /* started */
    uint64_t starts_hit; /* of these, particles that hit a first surface that counts: a caster if only caustics are
                            requested, else any surface */
    uint64_t rays;       /* traced, including those to the camera */
    uint64_t splats;
};

/* Adds the counts of another run. */
void light_tracer_stats_add(struct light_tracer_stats *to, const struct light_tracer_stats *more);

/* Scene and rays must outlive the object; the view is copied. Memory: 24 bytes per pixel, 48 with a ground, and about
 * 10 MB of buffered splats. NULL: out of memory. The caller owns the result. */
struct light_tracer *light_tracer_create(const struct scene *scene, const struct rays *rays, const struct view *view);
void light_tracer_destroy(struct light_tracer *t); /* NULL is allowed */

/* Adds to rgb, float[height][width][3], radiance. Runs on all OpenMP threads; the result does not depend on their
 * number. Traces nothing if there are no casters for caustics, or the sky is black. ERR_NOMEM: nothing was added. */
MUST_CHECK enum err light_tracer_run(struct light_tracer *t, const struct environment *e,
                                     const struct light_tracer_desc *desc, float *rgb,
                                     struct light_tracer_stats *stats);

/* ---- Particles ---- */

/* Particles from the sky and their splats: shared by light_tracer.h and caustic_store.h. Private to this room.
 *
 * A particle starts with flux L / (p_w p_y) / N on a line of direction -w, is traced through the scene, and leaves a
 * splat wherever the camera sees it on a rough surface; light_tracer.h has the equations. The run determines the
 * sampled directions and their L. Thread: one at a time per struct particles. */

#define PARTICLE_ROUND 128u /* batches between two calls of `take` for each of them */

struct particle_splat {
    uint32_t pixel, from; /* from: the packed direction w that the particle came from */
    float rgb[3];
};

struct particle_batch { /* results of one thread, in the order of its particles */
    struct particle_splat *splats;
    size_t count, capacity;
    struct light_tracer_stats stats;
    bool out_of_memory;
};

struct particles {
    const struct scene *scene;
    const struct rays *rays;
    struct view view;
    struct box bounds;
    struct box *casters; /* at most START_BOXES_MAX */
    uint32_t caster_count;
    struct particle_batch batches[PARTICLE_ROUND];
};

struct particle_run { /* common to all particles of a run */
    const struct particles *world;
    /* Directions are sampled from the whole sky, or from its sun with that part's radiance; both NULL: uniform
     * over the sphere, with radiance 1. */
    const struct environment *environment;
    const struct sky_split *sun;
    const struct box *boxes;
    uint32_t box_count;
    enum start_kind start;
    struct progress_part *progress; /* may be NULL */
    uint32_t shown;                 /* the classes to splat, a part of `classes` */
    uint32_t classes;
    uint64_t particles, first_direction, seed;
    double per_particle; /* N: every flux is divided by it */
    bool ground_apart;   /* splats on the ground (scene/geometry/ground.h) count for pixel + width * height */
    const atomic_bool *cancel;
};

/* Initialises *p; scene and rays must outlive it. False: out of memory; call particles_finish even then. */
MUST_CHECK bool particles_init(struct particles *p, const struct scene *scene, const struct rays *rays,
                               const struct view *view);
void particles_finish(struct particles *p); /* frees the memory */

/* Sets world and boxes: `aimed` at the casters, else at the scene. */
void particles_aim(const struct particles *p, bool aimed, struct particle_run *run);

/* Traces the run on all OpenMP threads. `take` receives the splats in an order that does not depend on the threads; an
 * error that it returns ends the run. Adds to *stats. Cancelled: ERR_OK, with some of the splats taken. ERR_NOMEM. */
MUST_CHECK enum err particles_trace(struct particles *p, const struct particle_run *run,
                                    enum err (*take)(void *user, const struct particle_splat *splats, size_t count),
                                    void *user, struct light_tracer_stats *stats);
