#include "light/frame/decide.h"

#include "base/log.h"

#include <math.h>

#define SMOOTH 0.2      /* share of the newest time in a running mean, */
#define SMOOTH_LESS 0.5 /* and of one that is less: the first image by a cache asks for most of what the sun needs */
#define FIRST_SAMPLES 8 /* of a denoised image, */
#define FIRST_OF_ALL 4  /* of the very first one, which no audit delays, */
#define FIRST_PATHS 2   /* and its eye paths */
#define BUILDING_SHARE 0.35 /* of the time, for images while the cache is being computed, */
#define BUILDING_S 2.0      /* with at most this time from one to the next, */
#define AT_ONCE 2           /* after so many images */
#define IMAGE_SHARE 0.9     /* of the time between two images that a measured image may use, */
#define CACHE_SHARE 0.5     /* while a cache is computed beside: it costs quality, not rate */
#define SAMPLES 64          /* N_s of the cache's frames, from which their eye paths and particles follow, */
#define SAMPLES_ROUGH 32    /* and while it is computed, when its own error is larger */

void decider_finish(struct decider *d)
{
    pilot_destroy(d->pilot);
    *d = (struct decider){ .pilot = NULL };
}

/* Direct light by METHOD_AUTO, with shadows and the default sampling settings. */
static bool cache_may_serve(const struct relight_desc *light)
{
    const struct direct_desc *d = &light->direct;

    return d->method == METHOD_AUTO && (light->classes & PATH_DIRECT || light->classes == 0) && d->cells <= 1 &&
           !d->sun && d->compensate == COMPENSATE_OFF && !d->no_visibility;
}

static struct relight_desc by_cache(const struct relight_desc *light)
{
    struct relight_desc d = *light;

    d.direct.method = METHOD_CACHED;
    d.direct.samples = SAMPLES;
    return d;
}

/* By a time or an error. */
static bool is_measured(const struct frame_request *request)
{
    return request->target.seconds > 0.0 || request->target.error > 0.0;
}

static struct cost_facts facts_of(const struct relighter *r, const struct relight_desc *light)
{
    return (struct cost_facts){
        .indirect = light->classes & PATH_INDIRECT_LIT && light->indirect == PLAN_AUTO,
        .samples = light->direct.samples,
        .points = relighter_set(r)->gbuffer->point_count,
    };
}

/* Until the cache exists coarsely, if indirect light is requested: a filtered image with few samples is closer to the
 * truth than one with many samples but no indirect light. */
static bool is_first(const struct decider *d, const struct frame_request *request)
{
    return d->cache.hurried && !d->cache.ready && !d->cache.refused && request->background && is_measured(request) &&
           request->asked->classes & PATH_INDIRECT_LIT && cache_may_serve(request->asked);
}

static struct relight_desc denoised(const struct decider *d, const struct relight_desc *light)
{
    struct relight_desc out = *light;

    out.denoise = out.remember = out.glide = true;
    out.direct.samples = d->cache.images == 0 ? FIRST_OF_ALL : FIRST_SAMPLES;
    out.eye_paths = light->eye_paths ? light->eye_paths : FIRST_PATHS;
    out.audit = d->cache.images == 0 ? 0.0 : light->audit;
    return out;
}

void decide(const struct decider *d, struct frame_request *request)
{
    request->light = *request->asked;
    if (request->asked->direct.method != METHOD_AUTO) {
        request->by = d->cache.ready ? DECIDED_BY_CACHE : DECIDED_BY_REQUEST; /* decider_prepare has named it */
        request->why = d->cache.ready ? d->cache.last.why : "the method was named";
    } else if (!is_measured(request)) {
        request->by = DECIDED_BY_RULE;
        request->why = "sample counts were given";
    } else if (d->cache.ready && cache_may_serve(request->asked)) {
        request->by = DECIDED_BY_CACHE;
        request->why = d->cache.last.why;
        request->light = by_cache(request->asked);
        if (d->cache.share < 1.0)
            request->light.direct.samples = SAMPLES_ROUGH;
        request->light.cache_background |= request->background;
        request->light.remember = request->background;
    } else if (is_first(d, request)) {
        request->by = DECIDED_BY_RULE;
        request->why = "few samples, denoised, until the cache is ready";
        request->light = denoised(d, request->asked);
    } else {
        request->by = DECIDED_BY_MEASURES;
        request->why = "a time or error limit was given";
    }
}

enum err decider_run(struct decider *d, struct relighter *r, const struct environment *e,
                     const struct frame_request *request, float *rgb, struct relight_stats *stats,
                     struct pilot_stats *measured)
{
    enum err result;

    *measured = (struct pilot_stats){ 0 };
    if (request->by != DECIDED_BY_MEASURES) {
        result = relighter_run(r, e, &request->light, rgb, stats);
    } else {
        if (!d->pilot)
            d->pilot = pilot_create(r, NULL);
        result = d->pilot ? pilot_run(d->pilot, e, &request->light, &request->target, rgb, stats, measured) : ERR_NOMEM;
    }
    if (!result && d->cache.begun && !d->cache.ready) /* it is computed while images do not use it yet */
        stats->cache_share = d->cache.share;
    return result;
}

enum err decider_prepare(struct decider *d, struct relighter *r, double allow_bias, bool progress,
                         struct relight_desc *light, double *ms)
{
    struct cost_facts f = facts_of(r, light);
    struct relight_desc cached = by_cache(light);
    struct cost_verdict *answer = &d->cache.last;
    struct reason why = { "" };

    f.allowed = allow_bias;
    if (cache_may_serve(light))
        cost_by_counts(&f, answer);
    if (!answer->yes)
        return relighter_prepare(r, light, progress, ms);
    log_info("auto: frames use the cache of light transport, which pays off after %.0f", ceil(answer->break_even));
    cached.direct.samples = light->direct.samples;
    cached.direct.why = &why;
    const enum err e = relighter_prepare(r, &cached, progress, ms);
    cached.direct.why = light->direct.why;
    if (e == ERR_RANGE) {
        log_info("auto: without it: %s", why.text);
        answer->yes = false;
        answer->why = "it would take too much memory";
        return relighter_prepare(r, light, progress, ms);
    }
    *light = cached;
    d->cache.begun = d->cache.ready = !e;
    return e ? err_say(light->direct.why, e, "%s", why.text[0] ? why.text : err_text(e)) : ERR_OK;
}

bool decider_is_computing(const struct decider *d, struct relighter *r)
{
    return d->cache.begun && relighter_follow(r) < 1.0;
}

double decider_interval_s(const struct decider *d)
{
    const bool denoised = d->cache.hurried && d->cache.images >= AT_ONCE && d->cache.glide == 0;

    if (!d->cache.begun || d->cache.share >= 1.0 || !(d->cache.ready || denoised))
        return 0.0;
    return fmin(d->cache.image_s / BUILDING_SHARE, d->cache.image_s + BUILDING_S);
}

double decider_target_s(const struct decider *d, struct relighter *r, double interval_s)
{
    return (decider_is_computing(d, r) ? CACHE_SHARE : IMAGE_SHARE) * interval_s;
}

/* Of an image by the cache, or a denoised one with samples. */
static void note_image(struct decider *d, const struct relight_stats *stats)
{
    const double s = 1e-3 * (stats->shade_ms + stats->eye_ms + stats->light_ms + stats->filter_ms + stats->resolve_ms);

    const double step = d->cache.image_s == 0.0 ? 1.0 : s < d->cache.image_s ? SMOOTH_LESS : SMOOTH;

    d->cache.image_s += step * (s - d->cache.image_s);
}

/* Black skies and cancelled frames trace nothing, so they are not measured. */
static void note_frame(struct decider *d, const struct relight_stats *stats, const struct pilot_stats *measured)
{
    if (stats->direct.rays > 0) {
        const double frame_s = measured->seconds - measured->pilot_seconds,
                     step = d->cache.measured_frames ? SMOOTH : 1.0;
        const double sample_s = 1e-3 * stats->shade_ms / (double)stats->direct.rays;
        d->cache.sample_s += step * (sample_s - d->cache.sample_s);
        d->cache.frame_s += step * (frame_s - d->cache.frame_s);
        d->cache.measured_frames++;
    }
    d->cache.spent_s += measured->seconds;
}

/* Has the relighter load the cache (if_kept) or compute it. */
static void get_cache(struct decider *d, struct relighter *r, const struct frame_request *request, bool if_kept)
{
    struct relight_desc cached = by_cache(request->asked);
    struct reason why = { "" };
    double ms;

    cached.cache_if_kept = if_kept;
    cached.cache_background = cached.remember = request->background;
    cached.direct.why = &why;
    const enum err e = relighter_prepare(r, &cached, true, &ms);
    const double share = relighter_follow(r);
    if (e)
        log_warning("%s; auto continues without it", why.text[0] ? why.text : err_text(e));
    d->cache.share = share;
    d->cache.refused = e || (!if_kept && share == 0.0 && !request->background);
    d->cache.begun = !d->cache.refused && (share > 0.0 || !if_kept);
    d->cache.ready = share >= 1.0;
}

/* From when on the cache makes images: once they are as good as those before. Under a moving sky these are the
 * denoised ones of that sky; under a still one their history is better than a rough cache. */
static double enough_share(const struct decider *d, bool background, bool indirect, bool whole)
{
    if (!background || !(indirect || d->cache.error > COST_BIAS_COARSE))
        return 1.0;
    return !indirect ? RELIGHT_COARSE : whole ? RELIGHT_WHOLE : RELIGHT_DIRECT;
}

static void follow_cache(struct decider *d, struct relighter *r, const struct frame_request *request, bool still)
{
    const struct relight_desc *light = request->asked;
    const atomic_bool *cancel = light->direct.cancel;
    const double enough =
        enough_share(d, request->background, facts_of(r, light).indirect, still || relighter_awaits_whole(r));

    d->cache.share = relighter_follow(r);
    d->cache.ready = d->cache.share >= enough && !(cancel && atomic_load(cancel));
    if (!d->cache.ready)
        return;
    log_info("auto: the cache of light transport is used from here on");
    d->cache.image_s = 0.0; /* its images cost less */
}

/* By the clock: loads or computes the cache if that pays off. */
static void ask_for_cache(struct decider *d, struct relighter *r, const struct frame_request *request)
{
    struct cost_facts f = facts_of(r, request->asked);

    f.frames = request->frames_left;
    f.allowed = request->allow_bias;
    f.error = d->cache.error;
    f.sample_s = d->cache.sample_s;
    f.frame_s = d->cache.frame_s;
    f.spent_s = d->cache.spent_s;
    f.made = d->cache.measured_frames;
    cost_by_clock(&f, &d->cache.last);
    if (f.made > 0 && cost_suits_cache(&f) && !d->cache.looked_for) {
        d->cache.looked_for = true;
        get_cache(d, r, request, true);
        if (d->cache.begun) {
            log_info("auto: the cache of light transport is loaded from its file");
            d->cache.last.why = "a file has it";
        }
    }
    if (d->cache.begun || d->cache.refused || !d->cache.last.yes)
        return;
    log_info("auto: computing the cache of light transport: %s; about %.0f s, which pays off after %.0f frames",
             d->cache.last.why, d->cache.last.build_s, ceil(d->cache.last.break_even));
    get_cache(d, r, request, false);
}

void decider_begin(struct decider *d, struct relighter *r, const struct frame_request *request)
{
    struct cost_facts f = facts_of(r, request->asked);

    f.allowed = request->allow_bias;
    f.error = request->target.error > 0.0 ? request->target.error : INFINITY;
    if (d->cache.begun || d->cache.hurried || d->cache.refused || !request->background ||
        request->asked->direct.method != METHOD_AUTO || !is_measured(request) || !cache_may_serve(request->asked) ||
        !cost_suits_cache(&f))
        return;
    d->cache.looked_for = true;
    d->cache.hurried = f.indirect;
    d->cache.last = (struct cost_verdict){ .yes = true, .why = "--allow-bias permits its bias" };
    get_cache(d, r, request, f.indirect); /* to compute it can wait for the first image */
}

void decider_learn(struct decider *d, struct relighter *r, const struct frame_request *request,
                   const struct relight_stats *stats, const struct pilot_stats *measured)
{
    if (request->by == DECIDED_BY_CACHE && stats->cache_refused) {
        d->cache.ready = d->cache.begun = false;
        d->cache.refused = true;
    } else if (request->by == DECIDED_BY_CACHE) {
        note_image(d, stats);
        d->cache.share = stats->cache_share;
    }
    if (request->by == DECIDED_BY_RULE && is_first(d, request)) {
        if (d->cache.glide == 0)
            note_image(d, stats);
        d->cache.glide = stats->glides;
        d->cache.images++;
        if (d->cache.begun)
            follow_cache(d, r, request, stats->still);
        else if (!request->no_cache)
            get_cache(d, r, request, false);
        return;
    }
    if (request->by != DECIDED_BY_MEASURES || request->no_cache || !cache_may_serve(request->asked))
        return;
    d->cache.error = request->target.error > 0.0 ? request->target.error : measured->error;
    if (d->cache.begun) {
        follow_cache(d, r, request, stats->still);
    } else if (!d->cache.refused) {
        note_frame(d, stats, measured);
        ask_for_cache(d, r, request);
    }
}
