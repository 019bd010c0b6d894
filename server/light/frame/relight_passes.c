#include "light/frame/frame_plan.h"

#include "base/cancel.h"
#include "base/clock.h"
#include "base/mem.h"
#include "base/rng.h"
#include "light/cache/cache_share.h"
#include "light/denoise/denoise.h"
#include "light/frame/beside.h"
#include "light/frame/part.h"
#include "light/frame/relighter.h"
#include "light/resolve/resolve.h"

#include <string.h>

/* At most, of points that are lit by other means for some seconds: the frames take time from what ends that. */
#define UNBUILT_SAMPLES 4

bool passes_init(struct passes *s, const struct prepared_scene *set, const struct kernels *kernels)
{
    *s = (struct passes){
        .set = set,
        .kernels = kernels,
        .direct = { direct_create(kernels) },
        .light = light_tracer_create(set->scene, set->rays, &set->view),
        .resolver = resolver_create(set->gbuffer),
        .scratch = scratch_create(),
        .lo = mem_alloc(set->gbuffer->packet_count, 3 * PACKET * sizeof(float)),
    };
    const bool ground = set->scene->ground.radius > 0.0f;
    s->backplate = ground ? backplate_create(set->scene, set->gbuffer, &set->view) : NULL;
    return s->direct[0] && s->light && s->resolver && s->scratch && s->lo && (s->backplate || !ground);
}

void passes_finish(struct passes *s)
{
    for (int k = 0; k < TABLES_COUNT; k++)
        direct_destroy(s->direct[k]);
    for (int k = 0; k < 4; k++)
        mem_free(s->half[k / 2][k % 2]);
    light_tracer_destroy(s->light);
    resolver_destroy(s->resolver);
    backplate_destroy(s->backplate);
    scratch_destroy(s->scratch);
    mem_free(s->lo);
    *s = (struct passes){ .set = NULL };
}

enum err passes_measure(struct passes *s)
{
    const size_t pixels = (size_t)s->set->gbuffer->width * s->set->gbuffer->height * (s->backplate ? 2 : 1);
    bool all = s->direct[TABLES_PILOT] || (s->direct[TABLES_PILOT] = direct_create(s->kernels));

    for (int k = 0; k < 4; k++) {
        float **half = &s->half[k / 2][k % 2];
        all = (*half || (*half = mem_alloc(pixels, 3 * sizeof(float)))) && all;
    }
    return all ? ERR_OK : ERR_NOMEM;
}

enum err passes_direct(struct passes *s, int tables, const struct environment *e, const struct direct_desc *desc,
                       float *lo, struct direct_stats *stats, double *seconds)
{
    const double start = clock_seconds();
    const enum err result = direct_shade(s->direct[tables], s->set->gbuffer, s->set->rays, e, desc, lo, stats);

    *seconds = clock_seconds() - start;
    return result;
}

enum err passes_eye(struct passes *s, const struct environment *e, const struct eye_paths_desc *desc, float *lo,
                    struct eye_paths_stats *stats, double *seconds)
{
    struct eye_paths_desc own = *desc;
    const double start = clock_seconds();

    own.scratch = s->scratch;
    for (uint32_t k = 0; k < desc->only->count; k++)
        memset(lo + (size_t)desc->only->index[k] * 3 * PACKET, 0, 3 * PACKET * sizeof(float));
    const enum err result = eye_paths_shade(s->set->scene, s->set->rays, s->set->gbuffer, e, &own, lo, stats);
    *seconds = clock_seconds() - start;
    return result;
}

enum err passes_halves(struct passes *s, const struct environment *e, const struct light_tracer_desc *desc,
                       float *const half[2], struct light_tracer_stats *stats, double *seconds)
{
    const size_t values = (size_t)s->set->gbuffer->width * s->set->gbuffer->height * 3;
    const size_t bytes = values * (s->backplate ? 2 : 1) * sizeof(float);
    struct light_tracer_desc own = *desc;
    const double start = clock_seconds();
    enum err result = ERR_OK;

    *stats = (struct light_tracer_stats){ 0 };
    own.particles = desc->particles / 2;
    own.pass = 0;
    for (uint64_t k = 0; k < 2 && !result; k++) {
        struct light_tracer_stats one = { 0 };
        memset(half[k], 0, bytes);
        own.seed = rng_mix(desc->seed, 2 * desc->pass + k);
        own.ground = s->backplate ? half[k] + values : NULL;
        result = light_tracer_run(s->light, e, &own, half[k], &one);
        light_tracer_stats_add(stats, &one);
    }
    *seconds = clock_seconds() - start;
    return result;
}

/* ---- One function for each kind ---- */

static size_t points_bytes(const struct relighter *r)
{
    return (size_t)r->set->gbuffer->packet_count * 3 * PACKET * sizeof(float);
}

/* A run of a plan. */
struct frame_run {
    struct relighter *r;
    const struct environment *e;
    const struct frame_plan *plan;
    const struct light_part *part; /* NULL: the whole image */
    float *lo, *rgb;               /* the image's points, and its pixels */
    float *splats, *own_splats;    /* what PASS_SPLATS adds; NULL: nothing yet. Allocated for this run, or NULL */
    struct relight_stats *stats;
};

static float *points_of(const struct frame_run *f, const struct pass *s)
{
    return s->half < 0 ? f->lo : denoiser_half(f->r->denoiser, s->half);
}

static void clear_points(const struct frame_run *f, float *lo)
{
    const size_t first = f->part ? f->part->first : 0, end = f->part ? f->part->end : f->r->set->gbuffer->packet_count;

    memset(lo + first * 3 * PACKET, 0, (end - first) * 3 * PACKET * sizeof(float));
}

static enum err run_glide(struct frame_run *f, struct pass *s)
{
    (void)s;
    accumulation_glide(f->r->accumulation, f->lo);
    return ERR_OK;
}

/* Unshadowed direct light on the ground, with the samples of `by`, removes most of its noise, if that is not done. */
static enum err steady_ground(struct frame_run *f, const struct direct_desc *by, float *lit)
{
    struct passes *p = &f->r->passes;
    struct direct_desc bare = *by;
    struct direct_stats stats;
    double seconds;

    bare.only = backplate_packets(p->backplate);
    if (bare.only->count == 0 || backplate_is_held(p->backplate) || direct_is_corrected(by))
        return ERR_OK;
    float *lo = backplate_unshadowed(p->backplate);
    if (!lo)
        return ERR_NOMEM;
    bare.no_visibility = bare.keep = true;
    bare.log = NULL;
    const enum err result = passes_direct(p, TABLES_IMAGE, f->e, &bare, lo, &stats, &seconds);
    if (!result && !is_cancelled(by->cancel))
        backplate_steady(p->backplate, lit);
    return result;
}

static enum err run_direct(struct frame_run *f, struct pass *s)
{
    const struct direct_stats first = f->stats->direct;
    float *lo = points_of(f, s);

    if (s->direct.samples == 0) {
        clear_points(f, lo);
        return ERR_OK;
    }
    enum err result = passes_direct(&f->r->passes, TABLES_IMAGE, f->e, &s->direct, lo, &f->stats->direct, &s->seconds);
    s->rays = f->stats->direct.rays;
    if (s->half == 1)
        direct_stats_add(&f->stats->direct, &first);
    if (!result && f->r->passes.backplate)
        result = steady_ground(f, &s->direct, lo);
    return result;
}

/* Direct light that the cache lacks, by the rule of auto. only: NULL: all packets. */
static enum err sample_direct(struct frame_run *f, const struct direct_desc *by, const struct packet_list *only,
                              uint32_t samples, float *lo)
{
    struct direct_desc d = *by;
    struct direct_stats one;
    double seconds;

    d.method = METHOD_AUTO;
    d.only = only;
    d.samples = samples;
    const enum err result = passes_direct(&f->r->passes, TABLES_IMAGE, f->e, &d, lo, &one, &seconds);
    direct_stats_add(&one, &f->stats->direct);
    f->stats->direct = one;
    return result;
}

/* part: only these packets, of a complete cache; NULL: all. */
static struct transport_frame cached_frame(const struct relight_desc *desc, const struct light_part *part)
{
    struct transport_frame out = { .cancel = desc->direct.cancel, .unsplit = desc->unsplit };

    if (part) {
        const bool empty = part->first >= part->end; /* behind all packets: end 0 means all of them */
        out.first = empty ? UINT32_MAX : part->first;
        out.end = empty ? UINT32_MAX : part->end;
        out.narrow = part->narrow;
        out.sky_taken = part->sky_taken;
    }
    return out;
}

static enum err light_by_cache(struct frame_run *f, const struct relight_desc *desc, float *lo)
{
    struct relight_cache *c = &f->r->cache;
    struct relight_stats *stats = f->stats;
    struct transport_frame frame = cached_frame(desc, f->part);
    const uint32_t samples = desc->direct.samples;
    enum err result = ERR_OK;

    stats->cache_share = relight_cache_follow(c);
    stats->cache_refused = c->refused;
    if (c->refused)
        return sample_direct(f, &desc->direct, NULL, samples, lo);
    stats->bias =
        "cached: a sky of 1536 cells, compressed; the sun by directions 0.2 degrees apart"; /* or what indirect light
                                                                                               says */
    if (!c->transport) {                                                                    /* cancelled */
        memset(lo, 0, points_bytes(f->r));
        return ERR_OK;
    }
    if (!f->part && c->keep.share && c->keep.share->end > 0)
        return err_say(desc->direct.why, ERR_UNSUPPORTED,
                       "this image needs the whole cache, but each rank has only a part: start it without mpirun");
    if (!c->building)
        transport_gather(c->transport);
    const struct packet_list *unbuilt = transport_unbuilt(c->transport);
    if (unbuilt->count > 0)
        result = sample_direct(f, &desc->direct, unbuilt, samples < UNBUILT_SAMPLES ? samples : UNBUILT_SAMPLES, lo);
    if (stats->plan.indirect == PLAN_CACHE && c->indirect.indirect)
        frame.indirect = relight_indirect_take(&c->indirect, stats);
    if (!result)
        result = transport_shade(c->transport, f->e, &frame, lo, &stats->cache_frame);
    if (!result && desc->has_sun_day && c->builder && relight_cache_is_settled(c))
        relight_builder_aim(c->builder, c->transport, &desc->sun_day);
    stats->cache = *transport_stats(c->transport);
    stats->cache_loaded = c->loaded;
    stats->direct.rays += stats->cache_frame.rays;
    return result;
}

/* The cache's light has no noise and is the same in both halves. */
static enum err run_cached(struct frame_run *f, struct pass *s)
{
    if (s->half == 1) {
        memcpy(points_of(f, s), denoiser_half(f->r->denoiser, 0), points_bytes(f->r));
        return ERR_OK;
    }
    return light_by_cache(f, s->request, points_of(f, s));
}

static enum err run_eye_paths(struct frame_run *f, struct pass *s)
{
    const struct prepared_scene *set = f->r->set;
    struct eye_paths_stats one = { 0 };
    const enum err result =
        s->eye.paths == 0 ? ERR_OK
                          : eye_paths_shade(set->scene, set->rays, set->gbuffer, f->e, &s->eye, points_of(f, s), &one);

    s->rays = one.rays;
    f->stats->eye.paths += one.paths;
    f->stats->eye.rays += one.rays;
    return result;
}

static enum err run_filter(struct frame_run *f, struct pass *s)
{
    struct denoiser *d = f->r->denoiser;
    const float *const half[2] = { denoiser_half(d, 0), denoiser_half(d, 1) };
    (void)s;

    denoiser_filter(d, half, f->lo);
    return ERR_OK;
}

static enum err run_accumulate(struct frame_run *f, struct pass *s)
{
    struct accumulation *a = f->r->accumulation;

    if (is_cancelled(f->plan->cancel))
        return run_filter(f, s);
    accumulation_add(a, NULL, NULL);
    accumulation_show(a, f->lo);
    return ERR_OK;
}

static enum err run_leave(struct frame_run *f, struct pass *s)
{
    const bool last = relight_cache_is_settled(&f->r->cache);
    (void)s;

    if (!is_cancelled(f->plan->cancel) && accumulation_leave(f->r->accumulation, last, f->lo) == 0 && last)
        relighter_forget(f->r);
    return ERR_OK;
}

static enum err run_behind(struct frame_run *f, struct pass *s)
{
    (void)s;
    relight_caustics_behind(&f->r->caustics, f->e, f->lo, f->stats);
    return ERR_OK;
}

static enum err run_beside(struct frame_run *f, struct pass *s)
{
    if (!relighter_number_packets(f->r))
        return ERR_NOMEM;
    const struct packet_list all = { f->r->packets, f->r->set->gbuffer->packet_count };
    struct eye_paths_desc eye = s->eye;
    eye.only = &all;
    return beside_run(f->r->beside, &f->r->passes, &f->r->caustics, f->e, &eye, relight_cache_behind(&f->r->cache),
                      f->stats);
}

static enum err run_resolve(struct frame_run *f, struct pass *s)
{
    struct passes *p = &f->r->passes;
    (void)s;

    if (p->backplate)
        backplate_show(p->backplate, f->e, f->lo);
    resolver_pixels(p->resolver, f->lo, f->plan->background ? f->e : NULL, f->rgb);
    if (p->backplate)
        backplate_restore(p->backplate, f->lo);
    return ERR_OK;
}

static enum err run_rest(struct frame_run *f, struct pass *s)
{
    (void)s;
    return beside_finish(f->r->beside, f->r->passes.backplate, f->e, f->rgb);
}

/* Whether stored paths and particles are filtered, too. */
static bool spreads(const struct frame_plan *p)
{
    return frame_plan_is_filtered(p) || frame_plan_has(p, PASS_GLIDE);
}

static size_t values_of(const struct frame_run *f)
{
    return 3 * (size_t)f->r->set->gbuffer->width * f->r->set->gbuffer->height;
}

/* Where stored paths and particles go: with a ground to its own image, and the ground's behind it; to be filtered, to
 * one apart; else to the image. NULL: out of memory. */
static float *splats_of(struct frame_run *f)
{
    struct backplate *b = f->r->passes.backplate;

    if (!f->splats && b)
        f->splats = backplate_splats(b);
    else if (!f->splats && spreads(f->plan))
        f->splats = f->own_splats = mem_alloc(values_of(f), sizeof(float));
    return b || spreads(f->plan) ? f->splats : f->rgb;
}

static enum err run_stored(struct frame_run *f, struct pass *s)
{
    float *to = splats_of(f);

    return to ? relight_caustics_run(&f->r->caustics, f->r->passes.light, f->e, s->request, to, f->stats) : ERR_NOMEM;
}

/* In two halves whose mean is added. */
static enum err run_halves(struct frame_run *f, struct pass *s, float *rgb, struct light_tracer_stats *one)
{
    struct passes *p = &f->r->passes;
    float *const *half = p->half[s->light.classes & PATH_INDIRECT_LIT ? 1 : 0];
    const size_t values = p->backplate ? 2 * values_of(f) : values_of(f);
    double seconds;
    const enum err result = passes_halves(p, f->e, &s->light, half, one, &seconds);

#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < values; i++)
        rgb[i] += 0.5f * (half[0][i] + half[1][i]);
    return result;
}

static enum err run_particles(struct frame_run *f, struct pass *s)
{
    struct light_tracer_desc own = s->light;
    struct light_tracer_stats one = { 0 };
    float *to = splats_of(f);

    if (!to)
        return ERR_NOMEM;
    own.ground = f->r->passes.backplate ? to + values_of(f) : NULL;
    const enum err result =
        s->halves ? run_halves(f, s, to, &one) : light_tracer_run(f->r->passes.light, f->e, &own, to, &one);
    s->rays = one.rays;
    light_tracer_stats_add(&f->stats->light, &one);
    return result;
}

static enum err run_splats(struct frame_run *f, struct pass *s)
{
    struct backplate *b = f->r->passes.backplate;
    const struct gbuffer *g = f->r->set->gbuffer;
    enum err result = ERR_OK;
    (void)s;

    if (!f->splats)
        return ERR_OK;
    for (size_t k = 0; k < (b ? 2 : 1) && spreads(f->plan) && !result; k++)
        result = splats_spread(f->splats + k * values_of(f), g->width, g->height);
    if (b && !result)
        backplate_add_splats(b, f->e, f->rgb);
    for (size_t i = 0; i < values_of(f) && !b && !result; i++)
        f->rgb[i] += f->splats[i];
    return result;
}

static enum err (*const run_pass[PASS_KINDS])(struct frame_run *, struct pass *) = {
    [PASS_GLIDE] = run_glide,         [PASS_DIRECT] = run_direct, [PASS_CACHED] = run_cached,
    [PASS_EYE] = run_eye_paths,       [PASS_FILTER] = run_filter, [PASS_ACCUMULATE] = run_accumulate,
    [PASS_LEAVE] = run_leave,         [PASS_BEHIND] = run_behind, [PASS_BESIDE] = run_beside,
    [PASS_RESOLVE] = run_resolve,     [PASS_REST] = run_rest,     [PASS_STORED] = run_stored,
    [PASS_PARTICLES] = run_particles, [PASS_SPLATS] = run_splats,
};

/* Where the time of a pass is reported. */
static double *time_of(struct relight_stats *stats, enum pass_kind kind)
{
    switch (kind) {
    case PASS_GLIDE:
    case PASS_DIRECT:
    case PASS_CACHED: return &stats->shade_ms;
    case PASS_EYE:
    case PASS_BEHIND: return &stats->eye_ms;
    case PASS_FILTER:
    case PASS_ACCUMULATE:
    case PASS_LEAVE: return &stats->filter_ms;
    case PASS_RESOLVE: return &stats->resolve_ms;
    default: return &stats->light_ms;
    }
}

/* The passes of the kinds from `first` to `last`. */
static enum err run_range(struct frame_run *f, struct frame_plan *plan, enum pass_kind first, enum pass_kind last)
{
    enum err result = ERR_OK;

    for (uint32_t k = 0; k < plan->count && !result; k++) {
        struct pass *s = &plan->pass[k];
        if (s->kind < first || s->kind > last)
            continue;
        const double start = clock_seconds();
        result = run_pass[s->kind](f, s);
        s->seconds = clock_seconds() - start;
        *time_of(f->stats, s->kind) += 1e3 * s->seconds;
    }
    return result;
}

/* The light of shade points, together with other processes. */
static enum err run_dealt(struct frame_run *f)
{
    const double start = clock_seconds(), eye_ms = f->stats->eye_ms;
    const enum err result = f->r->team->points(f->r->team->context, f->r, f->e, f->plan, f->lo, f->stats);

    f->stats->shade_ms = 1e3 * (clock_seconds() - start); /* of all kinds of them */
    f->stats->eye_ms = eye_ms;
    return result;
}

static enum err run_all(struct frame_run *f, struct frame_plan *plan)
{
    struct relighter *r = f->r;
    const bool dealt = r->team && relighter_can_deal(r, plan);
    enum err result = r->passes.backplate ? backplate_begin(r->passes.backplate, f->e, plan->background) : ERR_OK;

    if (!result)
        result = dealt ? run_dealt(f) : run_range(f, plan, PASS_GLIDE, PASS_LEAVE);
    if (r->half && !dealt && !result) /* else every process has rounded its part */
        light_round(f->lo, points_bytes(r) / sizeof(float));
    return result ? result : run_range(f, plan, PASS_BEHIND, PASS_SPLATS);
}

enum err relighter_run_plan(struct relighter *r, const struct environment *e, struct frame_plan *plan, float *rgb,
                            struct relight_stats *stats)
{
    struct frame_run f = { .r = r, .e = e, .plan = plan, .lo = r->passes.lo, .rgb = rgb, .stats = stats };

    if (frame_plan_is_filtered(plan))
        frame_plan_split(plan);
    precedence_begin(&r->cache.urgent);
    const enum err result = run_all(&f, plan);
    precedence_end(&r->cache.urgent);
    mem_free(f.own_splats);
    return result;
}

/* ---- Parts of an image (part.h) ---- */

enum err relighter_run_part(struct relighter *r, const struct environment *e, const struct frame_plan *plan,
                            const struct light_part *part, float *lo, struct relight_stats *stats)
{
    struct frame_plan own = *plan;
    struct packet_list lists[PASSES_MAX];
    struct frame_run f = { .r = r, .e = e, .plan = &own, .part = part, .lo = lo, .stats = stats };

    if (!relighter_number_packets(r))
        return ERR_NOMEM;
    const struct packet_list all = { r->packets + part->first, part->end - part->first };
    for (uint32_t k = 0; k < own.count; k++) {
        struct pass *s = &own.pass[k];
        lists[k] = s->kind == PASS_EYE && s->eye.only ? light_part_list(s->eye.only, part) : all;
        if (s->kind == PASS_DIRECT)
            s->direct.only = &lists[k];
        if (s->kind == PASS_DIRECT && all.count == 0)
            s->direct.samples = 0;
        if (s->kind != PASS_EYE)
            continue;
        s->eye.only = &lists[k];
        if (lists[k].count == 0)
            s->eye.paths = 0;
    }
    return run_range(&f, &own, PASS_DIRECT, PASS_EYE);
}
