#include "light/frame/relight.h"

#include "base/cancel.h"
#include "base/clock.h"
#include "base/mem.h"
#include "base/progress.h"
#include "base/rng.h"
#include "light/denoise/denoise.h"
#include "light/denoise/accumulation.h"
#include "light/denoise/splats.h"
#include "light/frame/beside.h"
#include "light/frame/part.h"
#include "light/frame/reference.h"
#include "light/frame/relight_plan.h"
#include "light/frame/relighter.h"
#include "light/frame/stated.h"
#include "light/resolve/backplate.h"
#include "light/resolve/resolve.h"

#include <string.h>

#define HALF_LEAST 8 /* of direct light alone without a history: with fewer, the filter loses at equal time */

struct relighter *relighter_create(const struct prepared_scene *set, const struct kernels *kernels)
{
    struct relighter *r = mem_alloc(1, sizeof(*r));
    if (!r)
        return NULL;
    r->set = set;
    r->kernels = kernels;
    const bool all = passes_init(&r->passes, set, kernels);
    r->points = r->passes.lo;
    if (!all) {
        relighter_destroy(r);
        return NULL;
    }
    return r;
}

void relighter_destroy(struct relighter *r)
{
    if (!r)
        return;
    stated_destroy(r->stated);
    beside_destroy(r->beside);
    accumulation_destroy(r->accumulation);
    denoiser_destroy(r->denoiser);
    relight_cache_finish(&r->cache);
    relight_caustics_finish(&r->caustics);
    passes_finish(&r->passes);
    mem_free(r->packets);
    mem_free(r);
}

static size_t points_bytes(const struct relighter *r)
{
    return (size_t)r->set->gbuffer->packet_count * 3 * PACKET * sizeof(float);
}

/* Writes direct light, or zeros if it is not requested; with indirect light if the cache includes it. */
static enum err run_direct(struct relighter *r, const struct environment *e, const struct image_passes *p, float *lo,
                           struct relight_stats *stats)
{
    struct passes *s = &r->passes;
    double seconds;

    if (p->cached)
        return relight_cache_shade(&r->cache, s->direct[PASS_IMAGE], r->set, e, p->cached, NULL, lo, stats);
    if (p->direct.samples > 0)
        return passes_direct(s, PASS_IMAGE, e, &p->direct, lo, &stats->direct, &seconds);
    memset(lo, 0, points_bytes(r));
    return ERR_OK;
}

enum err relighter_prepare(struct relighter *r, const struct relight_desc *desc, bool progress, double *ms)
{
    struct plan plan;

    *ms = 0.0;
    relight_plan(r->set, r->cache.indirect.indirect, NULL, desc, false, &plan);
    const uint32_t stored = beside_wanted(r->set, desc) ? 0 : relight_plan_classes(&plan, PLAN_STORED);
    enum err e = relight_is_cached(desc) ? relight_cache_begin(&r->cache, r->set, desc) : ERR_OK;
    if (!e && relight_is_cached(desc))
        e = relight_cache_make(&r->cache, r->set, r->kernels, desc, progress, ms);
    if (!e && relight_is_cached(desc) && !r->cache.building)
        e = relight_indirect_make(&r->cache.indirect, r->cache.transport, r->set, r->kernels, desc, &r->cache.keep,
                                  progress, ms);
    if (!e && relight_is_cached(desc))
        e = relight_cache_keep(&r->cache);
    if (!e && stored)
        e = relight_caustics_make(&r->caustics, r->set, desc, stored, progress, ms);
    const uint32_t behind = relight_plan_behind(r->set, desc, &plan);
    if (!e && behind)
        e = relight_caustics_make_behind(&r->caustics, r->set, desc, behind, plan.eye_paths, ms);
    return e;
}

double relighter_follow(struct relighter *r)
{
    return relight_cache_follow(&r->cache);
}

/* Adds to lo. */
static enum err run_eye_paths(struct relighter *r, const struct environment *e, const struct image_passes *p, float *lo,
                              struct relight_stats *stats)
{
    enum err result = ERR_OK;

    for (int k = 0; k < 2 && !result; k++) {
        struct eye_paths_stats one = { 0 };
        if (p->eye[k].paths > 0)
            result = eye_paths_shade(r->set->scene, r->set->rays, r->set->gbuffer, e, &p->eye[k], lo, &one);
        stats->eye.paths += one.paths;
        stats->eye.rays += one.rays;
    }
    return result;
}

/* Runs once, or in two halves whose mean is added to the image; with a ground, to that of backplate_splats. */
static enum err run_particles(struct relighter *r, const struct environment *e, const struct image_passes *p, int k,
                              float *rgb, struct light_tracer_stats *stats, struct pass_costs *costs)
{
    const size_t image = 3 * (size_t)r->set->gbuffer->width * r->set->gbuffer->height;
    struct passes *s = &r->passes;
    const size_t values = s->backplate ? 2 * image : image;
    struct light_tracer_desc own = p->light[k];

    own.ground = s->backplate ? rgb + image : NULL;
    if (!p->halves)
        return light_tracer_run(s->light, e, &own, rgb, stats);
    const enum err result = passes_halves(s, e, &p->light[k], s->half[k], stats, &costs->light_s[k]);
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < values; i++)
        rgb[i] += 0.5f * (s->half[k][0][i] + s->half[k][1][i]);
    return result;
}

static enum err run_light_tracer(struct relighter *r, const struct environment *e, const struct image_passes *p,
                                 float *picture, struct relight_stats *stats, struct pass_costs *costs)
{
    struct backplate *b = r->passes.backplate;
    const bool any = !p->beside && (p->stored || p->light[0].particles > 0 || p->light[1].particles > 0);
    const struct gbuffer *g = r->set->gbuffer;
    const size_t values = 3 * (size_t)g->width * g->height;
    const bool apart = any && p->denoiser && !b; /* from the image, to be spread */
    float *own = apart ? mem_alloc(values, sizeof(*own)) : NULL;
    float *rgb = b && any ? backplate_splats(b) : apart ? own : picture;
    enum err result = rgb ? ERR_OK : ERR_NOMEM;

    if (any && p->stored && !result)
        result = relight_caustics_run(&r->caustics, r->passes.light, e, p->stored, rgb, stats);
    for (int k = 0; k < 2 && any && !result; k++) {
        struct light_tracer_stats one = { 0 };
        if (p->light[k].particles > 0)
            result = run_particles(r, e, p, k, rgb, &one, costs);
        costs->light_rays[k] = one.rays;
        stats->light.particles += one.particles;
        stats->light.starts_hit += one.starts_hit;
        stats->light.rays += one.rays;
        stats->light.splats += one.splats;
    }
    for (uint32_t k = 0; k < (b ? 2 : 1) && any && p->denoiser && !result; k++)
        result = splats_spread(rgb + k * values, g->width, g->height);
    for (size_t i = 0; i < values && apart && !result; i++)
        picture[i] += own[i];
    if (b && any && !result)
        backplate_add_splats(b, e, picture);
    mem_free(own);
    return result;
}

/* Unshadowed direct light on the ground, with the samples of `by`, removes most of its noise. only: the ground's
 * packets, and possibly others. */
static enum err steady_ground(struct relighter *r, const struct environment *e, const struct direct_desc *by,
                              const struct packet_list *only, float *lit)
{
    struct passes *s = &r->passes;
    struct direct_desc bare = *by;
    struct direct_stats stats;
    double seconds;

    if (bare.samples == 0 || only->count == 0 || backplate_is_held(s->backplate))
        return ERR_OK;
    float *lo = backplate_unshadowed(s->backplate);
    if (!lo)
        return ERR_NOMEM;
    bare.no_visibility = bare.keep = true;
    bare.only = only;
    bare.log = NULL;
    const enum err result = passes_direct(s, PASS_IMAGE, e, &bare, lo, &stats, &seconds);
    if (!result && !is_cancelled(by->cancel))
        backplate_steady(s->backplate, lit);
    return result;
}

static void resolve(struct relighter *r, const struct environment *e, bool background, float *rgb)
{
    struct passes *s = &r->passes;

    if (s->backplate)
        backplate_show(s->backplate, e, s->lo);
    resolver_pixels(s->resolver, r->points, background ? e : NULL, rgb);
    if (s->backplate)
        backplate_restore(s->backplate, s->lo);
}

/* Direct light, with a ground that is steady. */
static enum err run_lit(struct relighter *r, const struct environment *e, const struct image_passes *p, float *lo,
                        struct relight_stats *stats)
{
    const enum err result = run_direct(r, e, p, lo, stats);

    if (result || !r->passes.backplate || p->cached)
        return result;
    return steady_ground(r, e, &p->direct, backplate_packets(r->passes.backplate), lo);
}

/* Counts of one of two halves. */
static void halve(struct image_passes *p)
{
    const bool alone = p->direct.samples > 0 && !p->accumulation && p->eye[0].paths == 0;
    const uint32_t least = alone ? HALF_LEAST : 0, half = (p->direct.samples + 1) / 2;

    p->direct.samples = half > least ? half : least;
    for (int k = 0; k < 2; k++)
        p->eye[k].paths = (p->eye[k].paths + 1) / 2;
}

/* Direct light of both halves; the cache's light has no noise and is the same in both. */
static enum err run_direct_halves(struct relighter *r, const struct environment *e, const struct image_passes *halves,
                                  struct relight_stats *stats)
{
    struct direct_stats first;
    enum err result = run_lit(r, e, &halves[0], denoiser_half(r->denoiser, 0), stats);

    if (result)
        return result;
    if (halves->cached) {
        memcpy(denoiser_half(r->denoiser, 1), denoiser_half(r->denoiser, 0), points_bytes(r));
        return ERR_OK;
    }
    first = stats->direct;
    result = run_lit(r, e, &halves[1], denoiser_half(r->denoiser, 1), stats);
    stats->direct.rays += first.rays;
    stats->direct.generated += first.generated;
    stats->direct.chosen += first.chosen;
    stats->direct.effective += first.effective;
    stats->direct.lobes += first.lobes;
    return result;
}

/* To r->passes.lo, by way of a history if there is one. */
static void filter_halves(struct relighter *r, const struct image_passes *p)
{
    const float *const half[2] = { denoiser_half(r->denoiser, 0), denoiser_half(r->denoiser, 1) };

    if (p->accumulation && !is_cancelled(p->direct.cancel)) {
        accumulation_add(p->accumulation, NULL);
        accumulation_show(p->accumulation, NULL, r->passes.lo);
    } else {
        denoiser_filter(r->denoiser, half, r->passes.lo);
    }
}

static void forget(struct relighter *r)
{
    accumulation_destroy(r->accumulation);
    r->accumulation = NULL;
}

/* Together with other processes, in r->points. */
static enum err run_dealt(struct relighter *r, const struct environment *e, const struct image_passes *passes,
                          struct relight_stats *stats, struct pass_costs *costs)
{
    const double start = clock_seconds();

    r->points = r->passes.lo;
    const enum err result = r->team->points(r->team->context, r, e, passes, r->passes.lo, stats);
    costs->direct_s = clock_seconds() - start;
    return result;
}

/* The light of shade points, r->points. */
static enum err run_points(struct relighter *r, const struct environment *e, const struct image_passes *passes,
                           struct relight_stats *stats, struct pass_costs *costs)
{
    const bool split = passes->denoiser != NULL;
    struct image_passes halves[2];
    const double start = clock_seconds();
    enum err result;

    if (passes->glides) {
        accumulation_glide(passes->accumulation, r->passes.lo);
        r->points = r->passes.lo;
        return ERR_OK;
    }
    for (int k = 0; k < 2 && split; k++)
        passes_half(passes, k, &halves[k]);
    r->points = r->passes.lo;
    result = split ? run_direct_halves(r, e, halves, stats) : run_lit(r, e, passes, r->passes.lo, stats);
    const double lit = clock_seconds();
    for (int k = 0; k < (split ? 2 : 1) && !result; k++)
        result = run_eye_paths(r, e, split ? &halves[k] : passes, split ? denoiser_half(r->denoiser, k) : r->passes.lo,
                               stats);
    const double seen = clock_seconds();
    if (split && !result)
        filter_halves(r, passes);
    else if (passes->accumulation && !result && !is_cancelled(passes->cached->direct.cancel) &&
             accumulation_leave(passes->accumulation, r->passes.lo) == 0)
        forget(r);
    costs->direct_s = lit - start;
    costs->eye_s = seen - lit;
    costs->filter_s = split ? clock_seconds() - seen : 0.0;
    return result;
}

static enum err run_passes(struct relighter *r, const struct environment *e, const struct image_passes *passes,
                           float *rgb, struct relight_stats *stats, struct pass_costs *costs)
{
    const bool dealt = r->team && relighter_can_deal(r, passes);

    *costs = (struct pass_costs){ .eye_s = 0.0 };
    enum err result = r->passes.backplate ? backplate_begin(r->passes.backplate, e, passes->background) : ERR_OK;
    if (!result)
        result = dealt ? run_dealt(r, e, passes, stats, costs) : run_points(r, e, passes, stats, costs);
    if (r->half && !dealt && !result) /* else every process has rounded its part */
        light_round(r->passes.lo, points_bytes(r) / sizeof(float));
    const double seen = clock_seconds();
    if (!result && passes->stored_behind)
        relight_caustics_behind(&r->caustics, e, r->passes.lo, stats);
    costs->eye_s += clock_seconds() - seen;
    if (result)
        return result;
    const double lit = clock_seconds();
    if (passes->beside)
        result = beside_run(passes->beside, &r->passes, &r->caustics, e, passes, stats);
    const double start = clock_seconds();
    resolve(r, e, passes->background, rgb);
    const double resolved = clock_seconds();
    if (passes->beside && !result)
        result = beside_finish(passes->beside, r->passes.backplate, e, rgb);
    if (!result)
        result = run_light_tracer(r, e, passes, rgb, stats, costs);
    costs->pixels_s = resolved - start;
    stats->shade_ms = 1e3 * costs->direct_s;
    stats->eye_ms = 1e3 * costs->eye_s;
    stats->filter_ms = 1e3 * costs->filter_s;
    stats->resolve_ms = 1e3 * costs->pixels_s;
    stats->light_ms = 1e3 * (clock_seconds() - resolved + start - lit);
    return result;
}

enum err relighter_run_passes(struct relighter *r, const struct environment *e, const struct image_passes *passes,
                              float *rgb, struct relight_stats *stats, struct pass_costs *costs)
{
    precedence_begin(&r->cache.urgent);
    const enum err result = run_passes(r, e, passes, rgb, stats, costs);
    precedence_end(&r->cache.urgent);
    return result;
}

static struct denoiser *denoiser_of(struct relighter *r)
{
    if (!r->denoiser)
        r->denoiser = denoiser_create(r->set->gbuffer, &r->set->view, r->kernels ? r->kernels->level : NULL);
    return r->denoiser;
}

enum err relighter_denoiser(struct relighter *r, const struct relight_desc *desc, struct denoiser **out)
{
    *out = desc->denoise ? denoiser_of(r) : NULL;
    return *out || !desc->denoise ? ERR_OK : ERR_NOMEM;
}

/* Until a cache makes images; of a still sky, until what is displayed has become the cache's light. */
static enum err add_accumulation(struct relighter *r, const struct relight_desc *desc, bool still,
                                 struct image_passes *passes)
{
    if (!desc->remember || !(passes->cached ? r->accumulation && still : desc->denoise)) {
        forget(r);
        return ERR_OK;
    }
    if (denoiser_of(r) && !r->accumulation)
        r->accumulation = accumulation_create(r->set->gbuffer, r->denoiser);
    if (!r->accumulation)
        return ERR_NOMEM;
    accumulation_begin(r->accumulation, desc->classes, still && (desc->glide || passes->cached));
    passes->accumulation = r->accumulation;
    passes->glides = !passes->cached && accumulation_glides(r->accumulation) > 0;
    if (passes->denoiser) /* with random numbers of its own */
        passes->direct.pass = passes->eye[0].pass = passes->eye[1].pass = accumulation_turn(r->accumulation);
    return ERR_OK;
}

/* Light that the points' history does not contain: it has its own history while images are live. */
static enum err add_beside(struct relighter *r, const struct environment *e, const struct relight_desc *desc,
                           const struct plan *plan, bool still, struct image_passes *passes)
{
    if (!beside_wanted(r->set, desc)) {
        beside_destroy(r->beside);
        r->beside = NULL;
        return ERR_OK;
    }
    if (denoiser_of(r) && !r->beside)
        r->beside = beside_create(r->set, r->denoiser);
    if (!r->beside)
        return ERR_NOMEM;
    beside_describe(r->beside, e, desc, plan, still, passes);
    const uint32_t later = relight_plan_later(desc, plan);
    return later ? relight_caustics_begin(&r->caustics, r->set, desc, later) : ERR_OK;
}

static enum err run_with_progress(struct relighter *r, const struct environment *e, struct progress *line,
                                  struct image_passes *p, float *rgb, struct relight_stats *stats)
{
    struct progress_part part;
    struct pass_costs costs;

    progress_part_begin(&part, line, passes_work(r->set, p));
    p->direct.progress = &part;
    for (int k = 0; k < 2; k++)
        p->eye[k].progress = p->light[k].progress = &part;
    const enum err result = relighter_run_passes(r, e, p, rgb, stats, &costs);
    progress_part_end(&part);
    return result;
}

static bool sky_is_still(struct relighter *r, const struct environment *e)
{
    const uint64_t before = r->sky;
    r->sky = environment_digest(e);
    return r->sky == before;
}

enum err relighter_describe(struct relighter *r, const struct environment *e, const struct relight_desc *desc,
                            struct image_passes *passes, struct relight_stats *stats)
{
    *stats = (struct relight_stats){ 0 };
    enum err result = relighter_prepare(r, desc, false, &stats->cache_ms);
    if (result)
        return result;
    relight_plan(r->set, r->cache.indirect.indirect, e, desc, relight_caustics_serve(&r->caustics), &stats->plan);
    relight_plan_passes(r->set, r->cache.indirect.indirect, r->passes.scratch, desc, &stats->plan, passes);
    result = relighter_denoiser(r, desc, &passes->denoiser);
    stats->still = desc->remember && sky_is_still(r, e);
    if (!result)
        result = add_accumulation(r, desc, stats->still, passes);
    if (!result)
        result = add_beside(r, e, desc, &stats->plan, stats->still, passes);
    if (!result && passes->denoiser)
        halve(passes);
    return result;
}

void relighter_hold_ground(struct relighter *r, bool hold)
{
    if (r->passes.backplate)
        backplate_hold(r->passes.backplate, hold);
}

enum err relighter_run(struct relighter *r, const struct environment *e, const struct relight_desc *desc, float *rgb,
                       struct relight_stats *stats)
{
    struct image_passes passes;

    if (method_is_reference(desc->direct.method)) {
        *stats = (struct relight_stats){ 0 };
        const double start = clock_seconds();
        const enum err failed = reference_run(r->set, e, desc, rgb, stats);
        stats->shade_ms = 1e3 * (clock_seconds() - start);
        if (!failed)
            relighter_state_error(r, e, desc, false, rgb, stats);
        return failed;
    }
    enum err result = relighter_describe(r, e, desc, &passes, stats);
    if (!result)
        result = run_with_progress(r, e, desc->progress, &passes, rgb, stats);
    if (!result)
        relighter_state_error(r, e, desc, false, rgb, stats);
    stats->glides = r->accumulation ? accumulation_glides(r->accumulation) : 0;
    return result;
}

/* ---- Parts of an image (part.h) ---- */

enum err relighter_run_part(struct relighter *r, const struct environment *e, const struct image_passes *passes,
                            const struct light_part *part, float *lo, struct relight_stats *stats)
{
    struct image_passes own = *passes;
    struct packet_list lists[3];
    enum err result = relighter_number_packets(r) ? ERR_OK : ERR_NOMEM;

    if (result)
        return result;
    lists[2] = (struct packet_list){ r->packets + part->first, part->end - part->first };
    own.direct.only = &lists[2];
    for (int k = 0; k < 2; k++) {
        lists[k] = own.eye[k].only ? light_part_list(own.eye[k].only, part) : lists[2];
        own.eye[k].only = &lists[k];
        if (lists[k].count == 0)
            own.eye[k].paths = 0;
    }
    if (own.cached)
        result = relight_cache_shade(&r->cache, r->passes.direct[PASS_IMAGE], r->set, e, own.cached, part, lo, stats);
    else if (own.direct.samples > 0 && part->end > part->first)
        result = run_direct(r, e, &own, lo, stats);
    else
        memset(lo + (size_t)part->first * 3 * PACKET, 0, lists[2].count * 3 * PACKET * sizeof(float));
    return result ? result : run_eye_paths(r, e, &own, lo, stats);
}

struct passes *relighter_passes(struct relighter *r)
{
    return passes_measure(&r->passes) ? NULL : &r->passes;
}

enum err relighter_keep_backplate(struct relighter *r)
{
    return backplate_keep(r->passes.backplate);
}

void relighter_split(const struct relighter *r, const struct environment *e, const float *rgb, float *rgba)
{
    backplate_split(r->passes.backplate, e, rgb, rgba);
}
