/* server/shade/particles.h */
/* Particles from the sky and what the eye receives of them: what light_tracer.h and caustic_store.h have in common.
 * Inside this room only.
 *
 * A particle begins with flux L / (p_w p_y) / N on a line of direction -w, follows what it meets, and leaves a splat
 * wherever the eye sees it on a rough surface; light_tracer.h has the equations. Which directions are drawn, and with
 * what L, is the run's. */
#ifndef SHADE_PARTICLES_H
#define SHADE_PARTICLES_H

#include "light_tracer.h"
#include "transport_sky.h"

#define PARTICLE_ROUND 128u /* batches between two calls of `take` for each of them */

/* Directions, as 3 bits of face, 14 of row and 14 of column of a cube map with 2^14 texels along an edge: on any cube
 * map whose edge divides that, the texel is the one that cube_texel finds. */
#define DIRECTION_BITS 14

struct particle_splat {
    uint32_t pixel, from; /* from: the direction w that the particle came from, packed */
    float rgb[3];
};

struct particle_batch { /* what one thread found, in the order of its particles */
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
    struct box *casters; /* START_BOXES_MAX at most */
    uint32_t caster_count;
    struct particle_batch batches[PARTICLE_ROUND];
};

struct particle_run { /* what all particles of a run share */
    const struct particles *world;
    /* Directions by the whole sky, or by its bright part and with that part's radiance; both NULL: evenly over the
     * sphere, with a radiance of 1. */
    const struct environment *environment;
    const struct transport_sky *bright;
    const struct box *boxes;
    uint32_t box_count;
    enum start_kind start;
    uint32_t classes, starts; /* starts a direction */
    uint64_t particles, first_direction, seed;
    double per_particle; /* N: every flux is divided by it */
    const atomic_bool *cancel;
};

/* Scene and rays must outlive it. False when out of memory; finish it all the same. */
MUST_CHECK bool particles_init(struct particles *p, const struct scene *scene, const struct rays *rays,
                               const struct view *view);
void particles_finish(struct particles *p);

/* Fills in world, boxes and starts a direction (0: the default); `aimed` at the casters, else at the scene. */
void particles_aim(const struct particles *p, bool aimed, uint32_t starts_per_direction, struct particle_run *run);

/* Follows them on all OpenMP threads; `take` gets their splats in an order that does not depend on the threads, and
 * what it returns ends the run. Adds to *stats. Cancelled: ERR_OK, with some of the splats taken. */
MUST_CHECK enum err particles_trace(struct particles *p, const struct particle_run *run,
                                    enum err (*take)(void *user, const struct particle_splat *splats, size_t count),
                                    void *user, struct light_tracer_stats *stats);

bool particles_cancelled(const atomic_bool *cancel); /* NULL: no */

#endif
