#include "light/frame/relight_cache.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/progress.h"
#include "base/rng.h"
#include "light/cache/cache_share.h"
#include "light/cache_direct/live.h"
#include "light/frame/beside.h"

#include <stdio.h>
#include <time.h>

#define FIRST_S 1.0 /* for the second image, right after the first, before the builder's work */

void relight_cache_finish(struct relight_cache *c)
{
    const bool lives = c->builder && relight_builder_live(c->builder); /* then the transport goes with it */

    precedence_end(&c->urgent);
    relight_builder_destroy(c->builder); /* which may be reading c->bounce */
    relight_indirect_finish(&c->indirect);
    if (!lives)
        transport_destroy(c->transport);
    *c = (struct relight_cache){ .share = c->share };
}

static bool is_for(const struct relight_cache *c, const struct relight_desc *desc)
{
    return (c->transport || c->refused) && c->no_visibility == desc->direct.no_visibility &&
           c->max_bytes == desc->cache_bytes;
}

static struct transport_desc transport_of(const struct relight_desc *desc)
{
    return (struct transport_desc){ .max_bytes = desc->cache_bytes,
                                    .seed = rng_mix(desc->direct.seed, 0x6361636865u),
                                    .no_visibility = desc->direct.no_visibility,
                                    .cancel = desc->direct.cancel };
}

/* Why there is none, which each request reports again. */
static enum err refuse(struct relight_cache *c, enum err e, const struct reason *why)
{
    const bool no_visibility = c->no_visibility;
    const uint64_t max_bytes = c->max_bytes;
    const struct reason kept = *why;

    relight_cache_finish(c);
    c->no_visibility = no_visibility;
    c->max_bytes = max_bytes;
    c->why = kept;
    c->refused = e == ERR_RANGE;
    return e;
}

/* ---- In the foreground ---- */

static enum err compute(struct relight_cache *c, const struct prepared_scene *set, const struct kernels *kernels,
                        struct transport_desc *desc, bool progress, struct reason *why)
{
    struct progress line;

    log_info("%s: computing light transport for --method cached; the first frame waits for it", set->name);
    progress_begin(&line, "computing light transport", transport_steps(set->gbuffer), progress ? stderr : NULL);
    desc->progress = &line;
    const enum err e = transport_create(set->gbuffer, set->rays, kernels, desc, &c->transport, why);
    progress_end(&line);
    return e;
}

static void tell(const struct relight_cache *c, double ms)
{
    const struct transport_stats *s = transport_stats(c->transport);

    if (c->loaded)
        log_info("light transport: loaded in %.1f s from %s, %.0f MB", 1e-3 * ms, c->keep.place.path,
                 1e-6 * (double)s->bytes);
    else
        log_info("light transport: computed in %.1f s, %.0f MB", 1e-3 * ms, 1e-6 * (double)s->bytes);
}

/* ---- In the background ---- */

/* The builder's progress at this frame. */
static enum err follow(struct relight_cache *c, struct reason *why)
{
    struct transport_live *live = relight_builder_live(c->builder);
    enum err e = ERR_OK;

    const bool done = c->building && relight_builder_is_done(c->builder, &e, &c->indirect, why);
    struct indirect_cache *next = relight_builder_take(c->builder);
    if (next) {
        indirect_destroy(c->indirect.indirect);
        c->indirect.indirect = next;
    }
    if (done && c->indirect.refused) {
        relight_indirect_finish(&c->indirect);
        c->indirect.refused = true;
    }
    c->building &= !done;
    if (e) {
        e = refuse(c, e, why);
        c->refused = true; /* too little memory as well */
        return e;
    }
    if (live)
        transport_live_advance(live);
    return ERR_OK;
}

/* Waits for a result, or for cancellation. */
static enum err wait_for_builder(struct relight_cache *c, const atomic_bool *cancel, struct reason *why)
{
    enum err e = ERR_OK;

    while (!e && c->building && !(cancel && atomic_load(cancel))) {
        nanosleep(&(struct timespec){ .tv_nsec = 5000000 }, NULL);
        e = follow(c, why);
    }
    return e;
}

/* Computes direct light unless it was loaded, and indirect light if needed. */
static enum err begin(struct relight_cache *c, const struct relight_builder_desc *desc, struct reason *why)
{
    const enum err e = relight_builder_create(desc, &c->builder, why);

    if (e)
        return e;
    if (!c->transport)
        c->transport = transport_live_cache(relight_builder_live(c->builder));
    if (desc->light->cache_if_kept) /* for this image: reading takes less time than an image by other means */
        relight_builder_await_files(c->builder);
    /* else it only asks ahead for the sun */
    c->building =
        !desc->loaded || relight_indirect_wanted(desc->set, desc->light) || beside_wanted(desc->set, desc->light);
    return ERR_OK;
}

/* ---- */

enum err relight_cache_begin(const struct relight_cache *c, const struct prepared_scene *set,
                             const struct relight_desc *desc)
{
    const struct relight_indirect *b = &c->indirect;
    const bool lacks =
        !is_for(c, desc) || (c->transport && !b->indirect && !b->refused && relight_indirect_wanted(set, desc));

    return lacks && !desc->cache_background && c->share && c->share->begin
               ? c->share->begin(c->share->begin_context, desc)
               : ERR_OK;
}

enum err relight_cache_keep(struct relight_cache *c)
{
    const struct cache_share *s = c->keep.share;

    if (!c->transport || !s || s->index > 0 || c->kept)
        return ERR_OK;
    c->kept = c->keep.unwritable = true;
    return relight_cache_narrow(c);
}

enum err relight_cache_narrow(struct relight_cache *c)
{
    transport_keep(c->transport, c->keep.share);
    return c->indirect.indirect ? indirect_keep(c->indirect.indirect, c->transport, c->keep.share) : ERR_OK;
}

static enum err load_or_make(struct relight_cache *c, const struct prepared_scene *set, const struct kernels *kernels,
                             const struct relight_desc *desc, bool progress, double *ms, struct reason *why)
{
    struct transport_desc t = transport_of(desc);

    precedence_init(&c->urgent, FIRST_S);
    t.urgent = &c->urgent;
    c->no_visibility = desc->direct.no_visibility;
    c->max_bytes = desc->cache_bytes;
    const double start = clock_seconds();
    t.share = desc->cache_background ? NULL : c->share; /* the other processes cannot compute it in the background */
    relight_keep_init(&c->keep, set, kernels, desc, &t);
    enum err e = relight_keep_load(&c->keep, set, kernels, &t, &c->transport, why);
    e = relight_keep_agree(&c->keep, e, c->transport != NULL, &c->loaded, why);
    if (c->transport && !c->loaded) {
        transport_destroy(c->transport);
        c->transport = NULL;
    }
    if (!e && !c->transport && desc->cache_if_kept)
        return ERR_OK;
    if (!e && !c->transport && !desc->cache_background)
        e = compute(c, set, kernels, &t, progress, why);
    *ms = c->transport ? 1e3 * (clock_seconds() - start) : 0.0;
    if (!e && c->transport && cache_share_takes_all(t.share)) {
        tell(c, *ms);
        if (!c->loaded)
            relight_keep_save(&c->keep, c->transport, NULL, NULL);
    }
    const struct relight_builder_desc rest = { set, kernels, desc, &t, &c->keep, c->transport };
    if (!e && desc->cache_background)
        e = begin(c, &rest, why);
    return e;
}

enum err relight_cache_make(struct relight_cache *c, const struct prepared_scene *set, const struct kernels *kernels,
                            const struct relight_desc *desc, bool progress, double *ms)
{
    struct reason why = { "" };
    enum err e = ERR_OK;

    *ms = 0.0;
    if (is_for(c, desc) && !c->refused) {
        const double start = clock_seconds();
        if (desc->cache_background || !c->builder)
            return ERR_OK;
        e = wait_for_builder(c, desc->direct.cancel, &why);
        *ms = 1e3 * (clock_seconds() - start);
    } else if (!is_for(c, desc)) {
        relight_cache_finish(c);
        e = load_or_make(c, set, kernels, desc, progress, ms, &why);
        if (e)
            e = refuse(c, e, &why);
    }
    if (!e && !c->refused)
        return ERR_OK;
    if (e == ERR_RANGE && desc->cache_background)
        log_warning("%s; auto samples the light instead", c->why.text);
    if (c->refused && desc->cache_background)
        return ERR_OK;
    return err_say(desc->direct.why, e ? e : ERR_RANGE, "%s", c->why.text);
}

double relight_cache_follow(struct relight_cache *c)
{
    struct reason why;

    if (c->builder && follow(c, &why))
        log_warning("%s; auto samples the light instead", c->why.text);
    if (c->refused || !c->transport)
        return 0.0;
    return c->building ? relight_builder_share(c->builder) : 1.0;
}

const struct eye_store *const *relight_cache_behind(const struct relight_cache *c)
{
    return c->builder ? relight_builder_behind(c->builder) : NULL;
}

bool relight_cache_is_settled(const struct relight_cache *c)
{
    return !c->building && c->transport && transport_is_settled(c->transport);
}
