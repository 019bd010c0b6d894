#include "relight.h"

#include "clock.h"
#include "facts.h"
#include "mem.h"
#include "progress.h"
#include "reference.h"
#include "relight_cache.h"
#include "relight_caustics.h"
#include "resolve.h"
#include "rng.h"

#include <stdio.h>
#include <string.h>

struct relighter {
    const struct set *set;
    const struct kernels *kernels;
    struct direct *direct;
    struct relight_cache cache;
    struct relight_caustics caustics;
    struct light_tracer *light;
    struct resolver *resolver;
    float *lo;               /* [packet_count][3][16] */
    float *direct_lo;        /* likewise; what the cache alone writes, from frame to frame; NULL until it is needed */
    const float *points;     /* one of them: the picture's */
    struct scratch *scratch; /* of the eye paths */
};

static enum err load_scene(struct set *s, const struct set_desc *desc, struct reason *why)
{
    struct progress line;
    enum err e = ERR_OK;

    snprintf(s->name, sizeof(s->name), "%s", desc->scene ? desc->scene : "the built-in scene");
    if (desc->scene && strlen(desc->scene) < sizeof(s->file))
        strcpy(s->file, desc->scene);
    progress_begin(&line, "loading the scene", 0, desc->progress ? stderr : NULL);
    const double start = clock_seconds();
    if (desc->scene) {
        e = scene_load(desc->scene, &s->scene, &line, why);
    } else {
        s->scene = scene_create_builtin();
        if (!s->scene)
            e = err_say(why, ERR_NOMEM, "no memory for the built-in scene");
    }
    s->load_ms = 1e3 * (clock_seconds() - start);
    progress_end(&line);
    return e;
}

static enum err build_bvh(struct set *s, const struct set_desc *desc, struct reason *why)
{
    struct progress line;

    progress_begin(&line, "building the BVH", 0, desc->progress ? stderr : NULL);
    const double start = clock_seconds();
    s->rays = rays_create(s->scene);
    s->bvh_ms = 1e3 * (clock_seconds() - start);
    progress_end(&line);
    return s->rays ? ERR_OK : err_say(why, ERR_NOMEM, "%s: the ray structure could not be built", s->name);
}

static enum err build_gbuffer(struct set *s, const struct set_desc *desc, struct progress *line, struct reason *why)
{
    const struct camera *camera = scene_camera(s->scene, desc->camera);

    if (!camera)
        return err_say(why, ERR_USAGE, "%s: there is no camera '%s'", s->name, desc->camera);
    const double start = clock_seconds();
    const struct gbuffer_desc g = {
        .camera = camera,
        .width = desc->width,
        .height = desc->height,
        .edge_rays = desc->edge_rays,
        .every_pixel = desc->every_pixel,
        .interleave = desc->interleave,
        .progress = line,
    };
    const enum err e = gbuffer_create(s->scene, s->rays, &g, &s->gbuffer, why);
    s->gbuffer_ms = 1e3 * (clock_seconds() - start);
    snprintf(s->camera, sizeof(s->camera), "%s", camera->name);
    view_init(&s->view, camera, desc->width, desc->height);
    if (!e)
        facts_of_set(s->scene, s->gbuffer, &s->facts);
    return e;
}

static enum err build_view(struct set *s, const struct set_desc *desc, struct reason *why)
{
    struct progress line;

    progress_begin(&line, "building the G-buffer", desc->height, desc->progress ? stderr : NULL);
    const enum err e = build_gbuffer(s, desc, &line, why);
    progress_end(&line);
    return e;
}

enum err set_create(const struct set_desc *desc, struct set **out, struct reason *why)
{
    *out = NULL;
    struct set *s = mem_alloc(1, sizeof(*s));
    if (!s)
        return err_say(why, ERR_NOMEM, "out of memory");
    enum err e = load_scene(s, desc, why);
    if (!e)
        e = build_bvh(s, desc, why);
    if (!e)
        e = build_view(s, desc, why);
    if (e) {
        set_destroy(s);
        return e;
    }
    *out = s;
    return ERR_OK;
}

enum err set_create_view(const struct set *of, const struct set_desc *desc, struct progress *line, struct set **out,
                         struct reason *why)
{
    *out = NULL;
    struct set *s = mem_alloc(1, sizeof(*s));
    if (!s)
        return err_say(why, ERR_NOMEM, "out of memory");
    memcpy(s->name, of->name, sizeof(s->name));
    memcpy(s->file, of->file, sizeof(s->file));
    s->scene = of->scene;
    s->rays = of->rays;
    s->borrowed = true;
    const enum err e = build_gbuffer(s, desc, line, why);
    if (e) {
        set_destroy(s);
        return e;
    }
    *out = s;
    return ERR_OK;
}

void set_destroy(struct set *s)
{
    if (!s)
        return;
    gbuffer_destroy(s->gbuffer);
    if (!s->borrowed) {
        rays_destroy(s->rays);
        scene_destroy(s->scene);
    }
    mem_free(s);
}

struct relighter *relighter_create(const struct set *set, const struct kernels *kernels)
{
    struct relighter *r = mem_alloc(1, sizeof(*r));
    if (!r)
        return NULL;
    r->set = set;
    r->kernels = kernels;
    r->direct = direct_create(kernels);
    r->lo = mem_alloc(set->gbuffer->packet_count, 3 * PACKET * sizeof(float));
    r->points = r->lo;
    r->light = light_tracer_create(set->scene, set->rays, &set->view);
    r->scratch = scratch_create();
    r->resolver = resolver_create(set->gbuffer);
    if (!r->direct || !r->lo || !r->light || !r->scratch || !r->resolver) {
        relighter_destroy(r);
        return NULL;
    }
    return r;
}

void relighter_destroy(struct relighter *r)
{
    if (!r)
        return;
    direct_destroy(r->direct);
    relight_cache_finish(&r->cache);
    relight_caustics_finish(&r->caustics);
    light_tracer_destroy(r->light);
    resolver_destroy(r->resolver);
    mem_free(r->lo);
    mem_free(r->direct_lo);
    scratch_destroy(r->scratch);
    mem_free(r);
}

static bool has_bounce(const struct relighter *r, const struct relight_desc *desc)
{
    return r->cache.bounce.bounce && relight_bounce_wanted(r->set, desc);
}

/* e may be NULL: what it decides, who finds caustics where nothing is stored, is then left open. */
static void make_plan(const struct relighter *r, const struct environment *e, const struct relight_desc *desc,
                      struct plan *out)
{
    const struct plan_wish wish = {
        .caustics = desc->classes & PATH_CAUSTICS,
        .indirect = desc->classes & PATH_INDIRECT,
        .caustics_by = desc->caustics,
        .indirect_by = desc->indirect,
        .particles = desc->particles,
        .eye_paths = desc->eye_paths,
        .samples = desc->direct.samples,
        .stored = desc->direct.method == METHOD_CACHED,
    };
    struct plan_facts facts = r->set->facts;

    if (wish.caustics && wish.caustics_by == PLAN_AUTO && facts.casters > 0 && e)
        facts.peakedness = facts_peakedness(e);
    plan_make(&facts, &wish, out);
    if (has_bounce(r, desc))
        out->indirect = PLAN_CACHE;
}

static bool is_cached(const struct relight_desc *desc)
{
    return desc->direct.method == METHOD_CACHED && (desc->classes & PATH_DIRECT || desc->classes == 0);
}

static uint32_t classes_by(const struct plan *p, enum plan_estimator who)
{
    return (p->caustics == who ? PATH_CAUSTICS : 0) | (p->indirect == who ? PATH_INDIRECT_LIT : 0) |
           (p->indirect_caustics == who ? PATH_INDIRECT_CAUSTIC : 0);
}

static struct eye_paths_desc eye_paths_of(const struct relighter *r, const struct relight_desc *desc,
                                          const struct plan *p)
{
    const uint32_t behind = p->indirect == PLAN_CACHE ? PATH_INDIRECT_CAUSTIC : PATH_INDIRECT;

    return (struct eye_paths_desc){
        .classes = classes_by(p, PLAN_EYE),
        .behind_classes = (p->behind_caustics ? PATH_CAUSTICS : 0) | (p->behind_indirect ? behind : 0),
        .paths = p->eye_paths,
        .seed = rng_mix(desc->direct.seed, 0x657965),
        .pass = desc->direct.pass,
        .cancel = desc->direct.cancel,
        .scratch = r->scratch,
    };
}

/* Packets of which the cache leaves interreflection to eye paths. */
static const struct packet_list *left_by_cache(const struct relighter *r, const struct plan *p)
{
    const struct packet_list *left =
        p->indirect == PLAN_CACHE && r->cache.bounce.bounce ? bounce_left(r->cache.bounce.bounce) : NULL;

    return left && left->count > 0 ? left : NULL;
}

static bool has_eye_paths(const struct relighter *r, const struct relight_desc *desc, const struct plan *p)
{
    const struct eye_paths_desc eye = eye_paths_of(r, desc, p);

    return p->eye_paths > 0 && (eye_paths_find(r->set->scene, &eye) || left_by_cache(r, p));
}

/* The cache's light is left as it is for the next frame: what is added to it is added to a copy. */
static enum err run_kept(struct relighter *r, const struct environment *e, const struct relight_desc *desc,
                         struct relight_stats *stats)
{
    const size_t packets = r->set->gbuffer->packet_count, size = 3 * PACKET * sizeof(float);

    if (!r->direct_lo)
        r->direct_lo = mem_alloc(packets, size);
    if (!r->direct_lo)
        return ERR_NOMEM;
    const enum err result = relight_cache_shade(&r->cache, r->direct, r->set, e, desc, r->direct_lo, stats);
    r->points = r->direct_lo;
    if (result || !has_eye_paths(r, desc, &stats->plan))
        return result;
    memcpy(r->lo, r->direct_lo, packets * size);
    r->points = r->lo;
    return ERR_OK;
}

/* Direct light, or darkness where it was not asked for; with interreflection, where the cache has that. */
static enum err run_direct(struct relighter *r, const struct environment *e, const struct relight_desc *desc,
                           struct relight_stats *stats)
{
    const struct gbuffer *g = r->set->gbuffer;

    r->points = r->lo;
    if (is_cached(desc) && desc->cache_keep)
        return run_kept(r, e, desc, stats);
    if (is_cached(desc))
        return relight_cache_shade(&r->cache, r->direct, r->set, e, desc, r->lo, stats);
    if (desc->classes & PATH_DIRECT || desc->classes == 0)
        return direct_shade(r->direct, g, r->set->rays, e, &desc->direct, r->lo, &stats->direct);
    memset(r->lo, 0, (size_t)g->packet_count * 3 * PACKET * sizeof(float));
    return ERR_OK;
}

enum err relighter_prepare(struct relighter *r, const struct relight_desc *desc, bool progress, double *ms)
{
    struct plan plan;

    *ms = 0.0;
    make_plan(r, NULL, desc, &plan);
    const uint32_t stored = classes_by(&plan, PLAN_STORED);
    enum err e = is_cached(desc) ? relight_cache_make(&r->cache, r->set, r->kernels, desc, progress, ms) : ERR_OK;
    if (!e && is_cached(desc) && !r->cache.building)
        e = relight_bounce_make(&r->cache.bounce, r->cache.transport, r->set, r->kernels, desc, &r->cache.keep,
                                progress, ms);
    if (!e && stored)
        e = relight_caustics_make(&r->caustics, r->set, desc, stored, progress, ms);
    return e;
}

double relighter_follow(struct relighter *r)
{
    return relight_cache_follow(&r->cache);
}

static enum err run_eye_paths(struct relighter *r, const struct environment *e, const struct relight_desc *desc,
                              struct relight_stats *stats)
{
    struct eye_paths_desc eye = eye_paths_of(r, desc, &stats->plan);
    struct eye_paths_stats more = { 0 };

    if (!has_eye_paths(r, desc, &stats->plan))
        return ERR_OK;
    enum err result = eye_paths_shade(r->set->scene, r->set->rays, r->set->gbuffer, e, &eye, r->lo, &stats->eye);
    eye.classes = eye.behind_classes = PATH_INDIRECT_LIT;
    eye.only = left_by_cache(r, &stats->plan);
    if (!result && eye.only)
        result = eye_paths_shade(r->set->scene, r->set->rays, r->set->gbuffer, e, &eye, r->lo, &more);
    stats->eye.paths += more.paths;
    stats->eye.rays += more.rays;
    return result;
}

static void add_stats(struct light_tracer_stats *to, const struct light_tracer_stats *more)
{
    to->particles += more->particles;
    to->starts_hit += more->starts_hit;
    to->rays += more->rays;
    to->splats += more->splats;
}

/* Particles that are aimed at the casters apart from those for the whole scene: each run has as many as the plan says.
 */
static enum err run_light_tracer(struct relighter *r, const struct environment *e, const struct relight_desc *desc,
                                 float *rgb, struct relight_stats *stats)
{
    const uint32_t all = classes_by(&stats->plan, PLAN_LIGHT);
    const uint32_t runs[2] = { all & (PATH_CAUSTICS | PATH_INDIRECT_CAUSTIC), all & PATH_INDIRECT_LIT };
    struct light_tracer_desc light = {
        .particles = stats->plan.particles,
        .seed = rng_mix(desc->direct.seed, 0x6c6967),
        .pass = desc->direct.pass,
        .start = desc->start,
        .cancel = desc->direct.cancel,
    };
    enum err result = ERR_OK;

    if (classes_by(&stats->plan, PLAN_STORED))
        result = relight_caustics_run(&r->caustics, r->light, e, desc, rgb, stats);
    for (int k = 0; k < 2 && !result; k++) {
        struct light_tracer_stats one = { 0 };
        light.classes = runs[k];
        if (light.classes && light.particles > 0)
            result = light_tracer_run(r->light, e, &light, rgb, &one);
        add_stats(&stats->light, &one);
    }
    return result;
}

enum err relighter_run(struct relighter *r, const struct environment *e, const struct relight_desc *desc, float *rgb,
                       struct relight_stats *stats)
{
    double at[5] = { clock_seconds() };

    *stats = (struct relight_stats){ 0 };
    if (method_is_reference(desc->direct.method)) {
        const enum err failed = reference_run(r->set, e, desc, rgb, stats);
        stats->shade_ms = 1e3 * (clock_seconds() - at[0]);
        return failed;
    }
    enum err result = relighter_prepare(r, desc, false, &stats->cache_ms);
    if (result)
        return result;
    at[0] = clock_seconds(); /* what is computed once is told apart */
    make_plan(r, e, desc, &stats->plan);
    result = run_direct(r, e, desc, stats);
    at[1] = clock_seconds();
    if (!result)
        result = run_eye_paths(r, e, desc, stats);
    at[2] = clock_seconds();
    if (result)
        return result;
    resolver_pixels(r->resolver, r->points, desc->classes & PATH_BACKGROUND || desc->classes == 0 ? e : NULL, rgb);
    at[3] = clock_seconds();
    result = run_light_tracer(r, e, desc, rgb, stats);
    at[4] = clock_seconds();
    stats->shade_ms = 1e3 * (at[1] - at[0]);
    stats->eye_ms = 1e3 * (at[2] - at[1]);
    stats->resolve_ms = 1e3 * (at[3] - at[2]);
    stats->light_ms = 1e3 * (at[4] - at[3]);
    return result;
}

const float *relighter_points(const struct relighter *r)
{
    return r->points;
}
