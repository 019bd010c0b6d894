#include "light/frame/relight_cache.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/progress.h"
#include "base/rng.h"

#include <math.h>
#include <stdio.h>

#define PATHS_PER_PIXEL 64 /* stored by default */
#define PARTS_REFINE 64    /* if none is redrawn, for the progress line only */
#define SERVES 8           /* 1 / the share of its parts from which a live image's store is better than eye paths */
#define BEHIND_FOR_EACH 8  /* stored eye paths for each that would be traced in a frame: a frame hardly notices them */
#define PARTS_AT_ONCE 2    /* of a live image: one for either half */

void relight_caustics_finish(struct relight_caustics *c)
{
    eye_store_destroy(c->behind);
    caustic_store_destroy(c->store);
    sky_split_finish(&c->sky);
    *c = (struct relight_caustics){ .store = NULL };
}

static bool is_for(const struct relight_caustics *c, const struct caustic_store_desc *wish)
{
    const struct caustic_store_desc *m = &c->made;

    return c->store && m->classes == wish->classes && m->paths == wish->paths && m->parts == wish->parts &&
           m->start == wish->start && m->seed == wish->seed && m->max_bytes == wish->max_bytes;
}

static MUST_CHECK enum err create(struct relight_caustics *c, const struct prepared_scene *set,
                                  const struct relight_desc *desc, const struct caustic_store_desc *wish)
{
    struct reason why;

    caustic_store_destroy(c->store);
    c->store = NULL;
    const enum err e = caustic_store_create(set->scene, set->rays, &set->view, wish, &c->store, &why);
    if (e)
        return err_say(desc->direct.why, e, "%s%s", why.text, e == ERR_RANGE ? "; --cache-memory allows less" : "");
    c->made = *wish;
    c->image = 3 * (size_t)set->view.width * set->view.height;
    return ERR_OK;
}

static uint64_t turn_of(const struct relight_desc *desc)
{
    return desc->renew ? desc->turn : 0;
}

struct caustic_store_desc relight_caustics_describe(const struct prepared_scene *set, const struct relight_desc *desc,
                                                    uint32_t classes)
{
    const uint64_t pixels = (uint64_t)set->view.width * set->view.height;

    return (struct caustic_store_desc){
        .classes = classes,
        .paths = desc->stored_paths ? desc->stored_paths : pixels * PATHS_PER_PIXEL,
        .parts = desc->renew ? desc->renew : PARTS_REFINE,
        .start = desc->start,
        .seed = rng_mix(desc->direct.seed, 0x73746f7265),
        .max_bytes = desc->cache_bytes,
        .ground_apart = set->scene->ground.radius > 0.0f,
    };
}

enum err relight_caustics_begin(struct relight_caustics *c, const struct prepared_scene *set,
                                const struct relight_desc *desc, uint32_t classes)
{
    const struct caustic_store_desc wish = relight_caustics_describe(set, desc, classes);

    return is_for(c, &wish) ? ERR_OK : create(c, set, desc, &wish);
}

void relight_caustics_adopt(struct relight_caustics *c, struct caustic_store *made,
                            const struct caustic_store_desc *desc)
{
    if (!is_for(c, desc)) {
        caustic_store_destroy(made);
        return;
    }
    caustic_store_destroy(c->store);
    c->store = made;
}

enum err relight_caustics_make(struct relight_caustics *c, const struct prepared_scene *set,
                               const struct relight_desc *desc, uint32_t classes, bool progress, double *ms)
{
    const struct caustic_store_desc wish = relight_caustics_describe(set, desc, classes);

    if (is_for(c, &wish) && caustic_store_is_complete(c->store))
        return ERR_OK;
    struct progress line;
    const bool first = !c->store; /* a chart has one for each of its runs */
    const double start = clock_seconds();
    enum err e = relight_caustics_begin(c, set, desc, classes);
    if (e)
        return e;
    progress_begin(&line, "tracing the store of caustics", wish.parts, progress ? stderr : NULL);
    e = caustic_store_turn(c->store, turn_of(desc), &line, desc->direct.cancel);
    progress_end(&line);
    *ms += 1e3 * (clock_seconds() - start);
    const struct caustic_store_stats *s = caustic_store_stats(c->store);
    if (!e && first && caustic_store_is_complete(c->store))
        log_info("store of caustics: %.1f s, %.1f million paths, %.1f million splats, %.0f MB", clock_seconds() - start,
                 1e-6 * (double)s->paths, 1e-6 * (double)s->splats, 1e-6 * (double)s->bytes);
    return e;
}

/* The particles of the sun: the same number as would start there if plan->particles were drawn from the whole
 * sky. */
static uint64_t sun_particles(const struct relight_caustics *c, const struct environment *e, uint64_t particles)
{
    return c->sky.sun_count ? (uint64_t)ceil((double)particles * fmin(1.0, c->sky.sun_energy / e->total_energy)) : 0;
}

struct light_tracer_desc relight_caustics_sun(const struct relight_caustics *c, const struct environment *e,
                                              const struct relight_desc *desc, uint64_t particles)
{
    return (struct light_tracer_desc){
        .classes = c->made.classes,
        .particles = sun_particles(c, e, particles),
        .seed = rng_mix(desc->direct.seed, 0x627269676874),
        .pass = desc->direct.pass,
        .start = desc->start,
        .sun = &c->sky,
        .cancel = desc->direct.cancel,
    };
}

enum err relight_caustics_grow(struct relight_caustics *c, const struct relight_desc *desc, double seconds,
                               struct relight_stats *stats)
{
    const double start = clock_seconds();
    const struct caustic_store_stats *s = caustic_store_stats(c->store);
    enum err e = ERR_OK;

    stats->stored = *s;
    if (relight_caustics_serve(c) && s->splats == 0) /* the camera sees none of them */
        return ERR_OK;
    do
        e = caustic_store_grow(c->store, turn_of(desc), PARTS_AT_ONCE, desc->direct.cancel);
    while (!e && s->renewed > 0 && s->filled < s->parts && clock_seconds() - start < seconds);
    stats->stored = *s;
    return e;
}

bool relight_caustics_is_full(const struct relight_caustics *c)
{
    const struct caustic_store_stats *s = caustic_store_stats(c->store);

    return s->filled == s->parts;
}

bool relight_caustics_serve(const struct relight_caustics *c)
{
    const struct caustic_store_stats *s = c->store ? caustic_store_stats(c->store) : NULL;

    return s && s->filled * SERVES >= s->parts;
}

enum err relight_caustics_take(struct relight_caustics *c, const struct environment *e, const struct relight_desc *desc)
{
    c->sky.unsplit = desc->unsplit;
    return sky_split_begin(&c->sky, e);
}

enum err relight_caustics_run(struct relight_caustics *c, struct light_tracer *light, const struct environment *e,
                              const struct relight_desc *desc, float *rgb, struct relight_stats *stats)
{
    enum err result = caustic_store_turn(c->store, turn_of(desc), NULL, desc->direct.cancel);

    stats->stored = *caustic_store_stats(c->store);
    if (result || !caustic_store_is_complete(c->store)) /* cancelled */
        return result;
    result = relight_caustics_take(c, e, desc);
    if (!result)
        result = caustic_store_light(c->store, e, c->sky.level, rgb);
    struct light_tracer_desc sun = relight_caustics_sun(c, e, desc, stats->plan.particles);
    sun.ground = c->made.ground_apart ? rgb + c->image : NULL;
    if (!result)
        result = light_tracer_run(light, e, &sun, rgb, &stats->light);
    return result;
}

enum err relight_caustics_make_behind(struct relight_caustics *c, const struct prepared_scene *set,
                                      const struct relight_desc *desc, uint32_t classes, uint32_t paths, double *ms)
{
    const struct eye_store_desc wish = {
        .classes = classes,
        .paths = BEHIND_FOR_EACH * paths,
        .seed = rng_mix(desc->direct.seed, 0x657965),
        .max_bytes = desc->cache_bytes,
    };
    const struct eye_store_desc *made = &c->behind_made;
    struct eye_store_desc own = wish;

    if (c->behind && made->classes == wish.classes && made->paths == wish.paths && made->seed == wish.seed &&
        made->max_bytes == wish.max_bytes)
        return ERR_OK;
    const double start = clock_seconds();
    const bool first = !c->behind;
    eye_store_destroy(c->behind);
    own.cancel = desc->direct.cancel;
    const enum err e = eye_store_create(set->scene, set->rays, set->gbuffer, &own, &c->behind);
    c->behind_made = wish;
    *ms += 1e3 * (clock_seconds() - start);
    if (!e && first && c->behind)
        log_info("store of caustics behind mirrors and glass: %.1f s, %.1f million paths, %.1f MB",
                 clock_seconds() - start, 1e-6 * (double)eye_store_stats(c->behind)->paths,
                 1e-6 * (double)eye_store_stats(c->behind)->bytes);
    return e;
}

void relight_caustics_behind(const struct relight_caustics *c, const struct environment *e, float *lo,
                             struct relight_stats *stats)
{
    if (!c->behind) /* cancelled */
        return;
    eye_store_light(c->behind, e, INFINITY, lo);
    stats->stored_behind = *eye_store_stats(c->behind);
}
