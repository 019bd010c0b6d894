#include "light/frame/relight_cache.h"

#include "light/frame/frame_plan.h"
#include "base/clock.h"
#include "base/log.h"
#include "base/progress.h"
#include "base/rng.h"
#include "light/cache/cache_share.h"
#include "light/cache/memory.h"

#include <stdio.h>

void relight_indirect_finish(struct relight_indirect *b)
{
    indirect_destroy(b->indirect);
    *b = (struct relight_indirect){ .indirect = NULL };
}

struct indirect_desc relight_indirect_describe(const struct prepared_scene *set, const struct relight_desc *desc,
                                               const struct transport *direct)
{
    return (struct indirect_desc){
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

bool relight_indirect_wanted(const struct prepared_scene *set, const struct relight_desc *desc)
{
    struct plan plan;

    if (desc->direct.method != METHOD_CACHED || !(desc->classes & PATH_DIRECT) ||
        !(desc->classes & PATH_INDIRECT_LIT) || desc->indirect != PLAN_AUTO)
        return false;
    plan_make(&set->facts, desc, false, &plan);
    return plan.indirect == PLAN_EYE;
}

static void say(const struct relight_indirect *b, double ms)
{
    const struct indirect_stats *s = indirect_stats(b->indirect);

    if (!b->loaded) /* the line about direct light names the file */
        log_info("indirect light: computed in %.1f s, %.0f MB", 1e-3 * ms, 1e-6 * (double)s->bytes);
}

static enum err compute(const struct indirect_desc *desc, const struct kernels *kernels, bool progress,
                        struct indirect_cache **out, struct reason *why)
{
    struct indirect_desc d = *desc;
    struct progress line;

    progress_begin(&line, "computing indirect light", indirect_steps(desc->gbuffer), progress ? stderr : NULL);
    d.progress = &line;
    const enum err e = indirect_create(&d, kernels, out, why);
    progress_end(&line);
    return e;
}

enum err relight_indirect_make(struct relight_indirect *b, const struct transport *direct,
                               const struct prepared_scene *set, const struct kernels *kernels,
                               const struct relight_desc *desc, struct relight_keep *keep, bool progress, double *ms)
{
    struct reason why;

    if (!direct || b->indirect || b->refused || !relight_indirect_wanted(set, desc) ||
        (keep->share && desc->cache_background)) /* the others had no order to compute it */
        return ERR_OK;
    struct indirect_desc d = relight_indirect_describe(set, desc, direct);
    const double start = clock_seconds();
    d.share = keep->share;
    enum err e = relight_keep_load_indirect(keep, kernels, &d, &b->indirect, &why);
    e = relight_keep_agree(keep, e, b->indirect != NULL, &b->loaded, &why);
    if (b->indirect && !b->loaded) {
        indirect_destroy(b->indirect);
        b->indirect = NULL;
    }
    if (!e && !b->indirect)
        e = compute(&d, kernels, progress, &b->indirect, &why);
    *ms += 1e3 * (clock_seconds() - start);
    b->refused = e == ERR_RANGE;
    if (b->refused)
        log_warning("%s: %s; eye paths are traced for it in every frame", set->name, why.text);
    if (b->indirect && cache_share_takes_all(d.share))
        say(b, 1e3 * (clock_seconds() - start));
    if (b->indirect && !b->loaded)
        relight_keep_save(keep, direct, b->indirect, &d);
    return e && !b->refused ? err_say(desc->direct.why, e, "%s", why.text) : ERR_OK;
}

const struct transport_indirect *relight_indirect_take(const struct relight_indirect *b, struct relight_stats *stats)
{
    stats->indirect = *indirect_stats(b->indirect);
    stats->indirect_loaded = b->loaded;
    stats->bias = "cached: a sky of 1536 cells, compressed; the sun by directions 0.2 degrees apart; indirect light by "
                  "records that are even within, of a sky of 1536 overlapping cells with its sun";
    return indirect_of_frame(b->indirect);
}
