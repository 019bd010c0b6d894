#include "light/frame/relight.h"

#include "base/clock.h"
#include "base/mem.h"
#include "base/progress.h"
#include "light/denoise/denoise.h"
#include "light/frame/beside.h"
#include "light/frame/relighter.h"
#include "light/resolve/resolve.h"

#define HALF_LEAST 8 /* of direct light alone without a history: with fewer, the filter loses at equal time */

struct relighter *relighter_create(const struct prepared_scene *set, const struct kernels *kernels)
{
    struct relighter *r = mem_alloc(1, sizeof(*r));
    if (!r)
        return NULL;
    r->set = set;
    r->kernels = kernels;
    const bool all = passes_init(&r->passes, set, kernels);
    if (!all) {
        relighter_destroy(r);
        return NULL;
    }
    return r;
}

void relighter_forget(struct relighter *r)
{
    accumulation_destroy(r->accumulation);
    r->accumulation = NULL;
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

enum err relighter_prepare(struct relighter *r, const struct relight_desc *desc, bool progress, double *ms)
{
    struct frame_plan plan;

    *ms = 0.0;
    frame_plan_make(r->set, r->cache.indirect.indirect, r->passes.scratch, NULL, desc, false, &plan);
    const uint32_t stored = beside_wanted(r->set, desc) ? 0 : relight_plan_classes(&plan.light, PLAN_STORED);
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
    const uint32_t behind = relight_plan_awaited(r->set, desc, &plan.light);
    if (!e && behind)
        e = relight_caustics_make_behind(&r->caustics, r->set, desc, behind, plan.light.eye_paths, ms);
    return e;
}

double relighter_follow(struct relighter *r)
{
    return relight_cache_follow(&r->cache);
}

bool relighter_awaits_whole(const struct relighter *r)
{
    return r->cache.building && relight_builder_awaits_whole(r->cache.builder);
}

static struct denoiser *denoiser_of(struct relighter *r)
{
    if (!r->denoiser)
        r->denoiser = denoiser_create(r->set->gbuffer, &r->set->view, r->kernels ? r->kernels->level : NULL);
    return r->denoiser;
}

enum err relighter_add_filter(struct relighter *r, struct frame_plan *plan)
{
    if (!denoiser_of(r))
        return ERR_NOMEM;
    frame_plan_add(plan, PASS_FILTER, 0);
    return ERR_OK;
}

/* With random numbers of its own. */
static void renumber(struct frame_plan *plan, uint64_t turn)
{
    for (uint32_t k = 0; k < plan->count; k++) {
        struct pass *s = &plan->pass[k];
        if (s->kind == PASS_DIRECT)
            s->direct.pass = turn;
        else if (s->kind == PASS_EYE)
            s->eye.pass = turn;
    }
}

/* Until a cache makes images; of a still sky, until what is displayed has become the complete cache's light. */
static enum err add_accumulation(struct relighter *r, const struct relight_desc *desc, bool still,
                                 struct frame_plan *plan)
{
    const bool cached = frame_plan_has(plan, PASS_CACHED);
    const bool glides = still && (r->accumulation || !relight_cache_is_settled(&r->cache));

    if (!desc->remember || !(cached ? glides : desc->denoise)) {
        relighter_forget(r);
        return ERR_OK;
    }
    if (denoiser_of(r) && !r->accumulation)
        r->accumulation = accumulation_create(r->set->gbuffer, r->denoiser);
    if (!r->accumulation)
        return ERR_NOMEM;
    accumulation_begin(r->accumulation, desc->classes, still && (desc->glide || cached) ? ACCUMULATION_GLIDE : 0);
    if (desc->denoise) {
        renumber(plan, accumulation_turn(r->accumulation));
        frame_plan_find(plan, PASS_FILTER)->kind = PASS_ACCUMULATE;
    }
    if (cached && !desc->denoise)
        frame_plan_add(plan, PASS_LEAVE, 0);
    return ERR_OK;
}

/* Nothing is sampled. */
static void glide(struct frame_plan *plan)
{
    for (int kind = PASS_DIRECT; kind <= PASS_ACCUMULATE; kind++)
        frame_plan_drop(plan, (enum pass_kind)kind);
    frame_plan_add(plan, PASS_GLIDE, 0);
}

/* Light that the points' accumulation does not contain: it has its own while images are live. */
static enum err add_beside(struct relighter *r, const struct environment *e, const struct relight_desc *desc,
                           const struct relight_stats *stats, bool glides, struct frame_plan *plan)
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
    beside_describe(r->beside, e, desc, stats, relight_cache_behind(&r->cache) != NULL, glides, plan);
    const uint32_t later = relight_plan_later(desc, &stats->plan);
    const enum err result = later ? relight_caustics_begin(&r->caustics, r->set, desc, later) : ERR_OK;
    if (!result && r->cache.builder)
        relight_builder_take_caustics(r->cache.builder, &r->caustics);
    return result;
}

/* Counts of one of two halves. */
static void halve(struct frame_plan *plan)
{
    const bool alone = !frame_plan_has(plan, PASS_ACCUMULATE) && !frame_plan_has(plan, PASS_EYE);
    const uint32_t least = alone ? HALF_LEAST : 0;

    for (uint32_t k = 0; k < plan->count; k++) {
        struct pass *s = &plan->pass[k];
        const uint32_t half = s->kind == PASS_DIRECT ? (s->direct.samples + 1) / 2 : 0;
        if (half > 0)
            s->direct.samples = half > least ? half : least;
        else if (s->kind == PASS_EYE)
            s->eye.paths = (s->eye.paths + 1) / 2;
    }
}

static enum err run_with_progress(struct relighter *r, const struct environment *e, struct progress *line,
                                  struct frame_plan *plan, float *rgb, struct relight_stats *stats)
{
    struct progress_part part;

    progress_part_begin(&part, line, frame_plan_work(r->set, plan));
    for (uint32_t k = 0; k < plan->count; k++) {
        struct pass *s = &plan->pass[k];
        if (s->kind == PASS_DIRECT)
            s->direct.progress = &part;
        else if (s->kind == PASS_EYE)
            s->eye.progress = &part;
        else if (s->kind == PASS_PARTICLES)
            s->light.progress = &part;
    }
    const enum err result = relighter_run_plan(r, e, plan, rgb, stats);
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
                            struct frame_plan *plan, struct relight_stats *stats)
{
    *stats = (struct relight_stats){ 0 };
    enum err result = relighter_prepare(r, desc, false, &stats->cache_ms);
    if (result)
        return result;
    frame_plan_make(r->set, r->cache.indirect.indirect, r->passes.scratch, e, desc,
                    relight_caustics_serve(&r->caustics), plan);
    stats->plan = plan->light;
    if (desc->denoise)
        result = relighter_add_filter(r, plan);
    stats->still = desc->remember && sky_is_still(r, e);
    if (!result)
        result = add_accumulation(r, desc, stats->still, plan);
    const bool cached = frame_plan_has(plan, PASS_CACHED);
    const bool glides = !cached && r->accumulation && accumulation_glides(r->accumulation) > 0;
    if (!result)
        result = add_beside(r, e, desc, stats, glides, plan);
    if (!result && glides)
        glide(plan);
    else if (!result && frame_plan_is_filtered(plan))
        halve(plan);
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
    struct frame_plan plan;

    if (method_is_reference(desc->direct.method)) {
        *stats = (struct relight_stats){ 0 };
        const double start = clock_seconds();
        const enum err failed = reference_run(r->set, e, desc, rgb, stats);
        stats->shade_ms = 1e3 * (clock_seconds() - start);
        if (!failed)
            relighter_state_error(r, e, desc, false, rgb, stats);
        return failed;
    }
    enum err result = relighter_describe(r, e, desc, &plan, stats);
    if (!result)
        result = run_with_progress(r, e, desc->progress, &plan, rgb, stats);
    if (!result)
        relighter_state_error(r, e, desc, false, rgb, stats);
    stats->glides = r->accumulation ? accumulation_glides(r->accumulation) : 0;
    return result;
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
