#include "light/estimators/light_tracer.h"

#include "base/cancel.h"
#include "base/mem.h"
#include "base/rng.h"

#include <assert.h>

struct light_tracer {
    struct particles particles;
    double *sum; /* [height][width][3], of one run; with a ground twice, the second for what arrives on it */
};

void light_tracer_stats_add(struct light_tracer_stats *to, const struct light_tracer_stats *more)
{
    to->particles += more->particles;
    to->starts_hit += more->starts_hit;
    to->rays += more->rays;
    to->splats += more->splats;
}

struct light_tracer *light_tracer_create(const struct scene *scene, const struct rays *rays, const struct view *view)
{
    struct light_tracer *t = mem_alloc(1, sizeof(*t));

    if (!t)
        return NULL;
    const bool ready = particles_init(&t->particles, scene, rays, view);
    t->sum = mem_alloc((size_t)view->width * view->height, (scene->ground.radius > 0.0f ? 6 : 3) * sizeof(*t->sum));
    if (!ready || !t->sum) {
        light_tracer_destroy(t);
        return NULL;
    }
    return t;
}

void light_tracer_destroy(struct light_tracer *t)
{
    if (!t)
        return;
    particles_finish(&t->particles);
    mem_free(t->sum);
    mem_free(t);
}

static enum err add(void *user, const struct particle_splat *splats, size_t count)
{
    const struct light_tracer *t = user;

    for (size_t i = 0; i < count; i++)
        for (int c = 0; c < 3; c++)
            t->sum[3 * (size_t)splats[i].pixel + (size_t)c] += splats[i].rgb[c];
    return ERR_OK;
}

enum err light_tracer_run(struct light_tracer *t, const struct environment *e, const struct light_tracer_desc *desc,
                          float *rgb, struct light_tracer_stats *stats)
{
    const size_t values = 3 * (size_t)t->particles.view.width * t->particles.view.height;
    const bool aimed = !(desc->classes & PATH_INDIRECT_LIT);
    const bool apart = desc->ground && t->particles.scene->ground.radius > 0.0f;

    assert(e->ready && desc->classes && !(desc->classes & ~(uint32_t)(PATH_CAUSTICS | PATH_INDIRECT)));
    *stats = (struct light_tracer_stats){ 0 };
    if (desc->particles == 0 || (aimed && t->particles.caster_count == 0))
        return ERR_OK;
    if (desc->sun ? desc->sun->sun_count == 0 : !(e->total_energy > 0.0))
        return ERR_OK;
    if (!desc->sun)
        environment_complete(e);
    struct particle_run run = {
        .environment = e,
        .sun = desc->sun,
        .start = desc->start,
        .classes = desc->classes,
        .progress = desc->progress,
        .shown = desc->shown ? desc->shown : desc->classes,
        .particles = desc->particles,
        .seed = rng_mix(rng_mix(desc->seed, desc->particles), desc->classes),
        .per_particle = (double)desc->particles,
        .ground_apart = apart,
        .cancel = desc->cancel,
    };
    particles_aim(&t->particles, aimed, &run);
    run.first_direction = desc->pass * ((desc->particles + STARTS_PER_DIRECTION - 1) / STARTS_PER_DIRECTION);
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < (apart ? 2 * values : values); i++)
        t->sum[i] = 0.0;
    const enum err result = particles_trace(&t->particles, &run, add, t, stats);
    if (result || is_cancelled(desc->cancel))
        return result;
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < values; i++)
        rgb[i] += (float)t->sum[i];
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < (apart ? values : 0); i++)
        desc->ground[i] += (float)t->sum[values + i];
    return ERR_OK;
}
