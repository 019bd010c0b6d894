#include "light/frame/relight_bounce.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/progress.h"
#include "base/rng.h"
#include "light/cache/cache_share.h"
#include "light/cache/memory.h"

#include <stdio.h>

void relight_bounce_finish(struct relight_bounce *b)
{
    bounce_destroy(b->bounce);
    bounce_destroy(b->before);
    *b = (struct relight_bounce){ .bounce = NULL };
}

void relight_bounce_replace(struct relight_bounce *b, struct bounce *next, bool at_once)
{
    bounce_destroy(b->before);
    b->before = b->bounce;
    b->bounce = next;
    b->weight = 0;
    b->changed = true;
    relight_bounce_advance(b, at_once);
}

void relight_bounce_advance(struct relight_bounce *b, bool to_end)
{
    b->changed |= b->before != NULL;
    if (b->before && !to_end && ++b->weight < RELIGHT_BOUNCE_FADE)
        return;
    bounce_destroy(b->before);
    b->before = NULL;
}

struct bounce_desc relight_bounce_describe(const struct set *set, const struct relight_desc *desc,
                                           const struct transport *direct)
{
    return (struct bounce_desc){
        .scene = set->scene,
        .rays = set->rays,
        .gbuffer = set->gbuffer,
        .direct = direct,
        .eye = { (float)set->view.origin[0], (float)set->view.origin[1], (float)set->view.origin[2] },
        .max_bytes = cache_memory_rest(desc->cache_bytes, transport_stats(direct)->bytes),
        .seed = rng_mix(desc->direct.seed, 0x626f756e6365u),
        .cancel = desc->direct.cancel,
    };
}

bool relight_bounce_wanted(const struct set *set, const struct relight_desc *desc)
{
    const struct plan_wish wish = { .indirect = desc->classes & PATH_INDIRECT,
                                    .indirect_by = desc->indirect,
                                    .samples = desc->direct.samples };
    struct plan plan;

    if (desc->direct.method != METHOD_CACHED || !(desc->classes & PATH_DIRECT) ||
        !(desc->classes & PATH_INDIRECT_LIT) || desc->indirect != PLAN_AUTO)
        return false;
    plan_make(&set->facts, &wish, &plan);
    return plan.indirect == PLAN_EYE;
}

static void say(const struct relight_bounce *b, double ms)
{
    const struct bounce_stats *s = bounce_stats(b->bounce);

    if (!b->loaded) /* the line about direct light names the file */
        log_info("interreflection: %.1f s, %.0f MB; %u records, %u coefficients, %u bounces", 1e-3 * ms,
                 1e-6 * (double)s->bytes, s->records, s->basis, s->bounces);
}

static enum err compute(const struct bounce_desc *desc, const struct kernels *kernels, bool progress,
                        struct bounce **out, struct reason *why)
{
    struct bounce_desc d = *desc;
    struct progress line;

    progress_begin(&line, "computing interreflection", bounce_steps(desc->gbuffer), progress ? stderr : NULL);
    d.progress = &line;
    const enum err e = bounce_create(&d, kernels, out, why);
    progress_end(&line);
    return e;
}

enum err relight_bounce_make(struct relight_bounce *b, const struct transport *direct, const struct set *set,
                             const struct kernels *kernels, const struct relight_desc *desc, struct relight_keep *keep,
                             bool progress, double *ms)
{
    struct reason why;

    if (!direct || b->bounce || b->refused || !relight_bounce_wanted(set, desc) ||
        (keep->share && desc->cache_background)) /* the others had no order to compute it */
        return ERR_OK;
    struct bounce_desc d = relight_bounce_describe(set, desc, direct);
    const double start = clock_seconds();
    d.share = keep->share;
    enum err e = relight_keep_load_bounce(keep, kernels, &d, &b->bounce, &why);
    e = relight_keep_agree(keep, e, b->bounce != NULL, &b->loaded, &why);
    if (b->bounce && !b->loaded) {
        bounce_destroy(b->bounce);
        b->bounce = NULL;
    }
    if (!e && !b->bounce)
        e = compute(&d, kernels, progress, &b->bounce, &why);
    *ms += 1e3 * (clock_seconds() - start);
    b->refused = e == ERR_RANGE;
    if (b->refused)
        log_warning("%s: %s; eye paths are traced for it in every frame", set->name, why.text);
    if (b->bounce && cache_share_takes_all(d.share))
        say(b, 1e3 * (clock_seconds() - start));
    if (b->bounce && !b->loaded)
        relight_keep_save(keep, direct, b->bounce, &d);
    return e && !b->refused ? err_say(desc->direct.why, e, "%s", why.text) : ERR_OK;
}

const struct transport_indirect *relight_bounce_take(struct relight_bounce *b, const struct environment *e,
                                                     const struct relight_desc *desc, float *lo,
                                                     struct relight_stats *stats)
{
    const float weight = b->before ? (float)b->weight / RELIGHT_BOUNCE_FADE : 1.0f;

    if (lo)
        bounce_shade_part(b->bounce, e, weight, desc->direct.cancel, lo);
    if (lo && b->before)
        bounce_shade_part(b->before, e, 1.0f - weight, desc->direct.cancel, lo);
    stats->bounce = *bounce_stats(b->bounce);
    stats->bounce_loaded = b->loaded;
    stats->bias = "cached: a sky of 1536 cells, compressed; penumbrae that few rays miss; interreflection by records "
                  "that are even within, of a sky of 1536 overlapping cells with its sun";
    return lo ? NULL : bounce_indirect(b->bounce);
}
