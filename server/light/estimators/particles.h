/* Particles from the sky and their splats: shared by light_tracer.h and caustic_store.h. Private to this room.
 *
 * A particle starts with flux L / (p_w p_y) / N on a line of direction -w, is traced through the scene, and leaves a
 * splat wherever the camera sees it on a rough surface; light_tracer.h has the equations. The run determines the
 * sampled directions and their L. Thread: one at a time per struct particles. */
#pragma once

#include "light/estimators/light_tracer.h"
#include "light/estimators/packed_direction.h"
#include "sky/tables/sky_split.h"

#define PARTICLE_ROUND 128u /* batches between two calls of `take` for each of them */

struct progress_part;
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
