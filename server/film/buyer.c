#include "buyer.h"

#include "log.h"

#include <inttypes.h>
#include <math.h>

#define SMOOTH 0.2
#define SAMPLES 64 /* N_s of the cache's frames, for what is traced of the sun */

bool buyer_may(const struct relight_desc *light)
{
    const struct direct_desc *d = &light->direct;

    return d->method == METHOD_AUTO && (light->classes & PATH_DIRECT || light->classes == 0) && d->cells <= 1 &&
           !d->sun && d->compensate == COMPENSATE_OFF && d->interleave <= 1 && !d->no_visibility;
}

static struct buy_facts facts_of(const struct set *set, const struct relight_desc *light)
{
    return (struct buy_facts){
        .indirect = light->classes & PATH_INDIRECT_LIT && light->indirect == PLAN_AUTO,
        .samples = light->direct.samples,
        .points = set->gbuffer->point_count,
    };
}

struct relight_desc buyer_light(const struct relight_desc *light)
{
    struct relight_desc d = *light;

    d.direct.method = METHOD_CACHED;
    d.direct.samples = SAMPLES;
    d.cache_read_only = d.cache_file && !d.cache_file[0];
    return d;
}

enum err buyer_prepare(struct buyer *b, struct relighter *r, const struct set *set, uint64_t frames, bool progress,
                       struct relight_desc *light, double *ms)
{
    struct buy_facts f = facts_of(set, light);
    struct relight_desc cached = buyer_light(light);
    struct reason why = { "" };

    f.frames = frames;
    if (buyer_may(light))
        buy_by_counts(&f, &b->last);
    if (!b->last.yes)
        return relighter_prepare(r, light, progress, ms);
    log_info("auto: %" PRIu64 " frames by the cache of light transport, which pays after %.0f", frames,
             ceil(b->last.break_even));
    cached.direct.samples = light->direct.samples;
    cached.direct.why = &why;
    const enum err e = relighter_prepare(r, &cached, progress, ms);
    cached.direct.why = light->direct.why;
    if (e == ERR_RANGE) {
        log_info("auto: without it: %s", why.text);
        b->last.yes = false;
        b->last.why = "it would take too much memory";
        return relighter_prepare(r, light, progress, ms);
    }
    *light = cached;
    b->begun = b->ready = !e;
    return e ? err_say(light->direct.why, e, "%s", why.text[0] ? why.text : err_text(e)) : ERR_OK;
}

/* Black skies and cancelled frames trace nothing, and teach nothing. */
static void learn(struct buyer *b, const struct relight_stats *stats, const struct pilot_stats *pilot)
{
    if (stats->direct.rays > 0) {
        const double frame_s = pilot->seconds - pilot->pilot_seconds;
        const double sample_s = 1e-3 * stats->shade_ms / (double)stats->direct.rays;
        b->sample_s = b->made ? b->sample_s + SMOOTH * (sample_s - b->sample_s) : sample_s;
        b->frame_s = b->made ? b->frame_s + SMOOTH * (frame_s - b->frame_s) : frame_s;
        b->made++;
    }
    b->spent_s += pilot->seconds;
}

/* Loads or computes it: what the relighter then has of it. */
static void get(struct buyer *b, struct relighter *r, const struct relight_desc *light, bool if_kept, bool background)
{
    struct relight_desc d = buyer_light(light);
    struct reason why = { "" };
    double ms;

    d.cache_if_kept = if_kept;
    d.cache_background = background;
    d.direct.why = &why;
    const enum err e = relighter_prepare(r, &d, true, &ms);
    const double share = relighter_follow(r);
    if (e)
        log_warning("%s; auto goes on without it", why.text[0] ? why.text : err_text(e));
    b->refused = e || (!if_kept && share == 0.0 && !background);
    b->begun = !b->refused && (share > 0.0 || !if_kept);
    b->ready = share >= 1.0;
}

static void follow(struct buyer *b, struct relighter *r, const struct relight_desc *light, bool background)
{
    const atomic_bool *cancel = light->direct.cancel;
    const bool coarsely = background && !(light->classes & PATH_INDIRECT) && b->error > BUY_BIAS_COARSE;
    const double share = relighter_follow(r);

    b->ready = share >= (coarsely ? RELIGHT_COARSE : 1.0) && !(cancel && atomic_load(cancel));
    if (b->ready)
        log_info("auto: frames are made by the cache of light transport from here on");
}

void buyer_step(struct buyer *b, struct relighter *r, const struct set *set, const struct relight_desc *light,
                const struct relight_stats *stats, const struct pilot_stats *pilot, const struct buyer_wish *wish)
{
    struct buy_facts f = facts_of(set, light);
    struct buy kept;

    b->error = wish->error > 0.0 ? wish->error : pilot->error;
    if (b->begun) {
        follow(b, r, light, wish->background);
        return;
    }
    if (b->refused)
        return;
    learn(b, stats, pilot);
    f.frames = wish->left;
    f.error = b->error;
    f.sample_s = b->sample_s;
    f.frame_s = b->frame_s;
    f.spent_s = b->spent_s;
    f.made = b->made;
    buy_by_clock(&f, &b->last);
    f.kept = true;
    buy_by_clock(&f, &kept);
    if (kept.yes && !b->looked) {
        b->looked = true;
        get(b, r, light, true, wish->background);
        if (b->begun) {
            log_info("auto: the cache of light transport is taken from its file");
            b->last = kept;
        }
    }
    if (b->begun || b->refused || !b->last.yes)
        return;
    log_info("auto: computing the cache of light transport: %s; some %.0f s, which pay after %.0f frames", b->last.why,
             b->last.build_s, ceil(b->last.break_even));
    get(b, r, light, false, wish->background);
}

void buyer_watch(struct buyer *b, bool refused)
{
    if (!refused)
        return;
    b->ready = b->begun = false;
    b->refused = true;
}
