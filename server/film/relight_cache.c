#include "relight_cache.h"

#include "cache_place.h"
#include "clock.h"
#include "log.h"
#include "progress.h"
#include "rng.h"
#include "transport_file.h"

#include <stdio.h>
#include <string.h>

void relight_cache_finish(struct relight_cache *c)
{
    relight_bounce_finish(&c->bounce);
    transport_destroy(c->transport);
    *c = (struct relight_cache){ .transport = NULL };
}

static bool is_for(const struct relight_cache *c, const struct relight_desc *desc)
{
    return (c->transport || c->refused) && c->no_visibility == desc->direct.no_visibility &&
           c->max_bytes == desc->cache_bytes;
}

/* What is at work on one cache. */
struct work {
    struct relight_cache *cache;
    const struct set *set;
    const struct kernels *kernels;
    struct transport_desc desc;
    struct cache_places places;
    struct digest key; /* where there are places */
};

/* ---- Files ---- */

/* Out of one file. What is not as it should be, or of something else, is said and passed over. */
static enum err load_from(struct work *w, const char *path)
{
    struct relight_cache *c = w->cache;
    struct cache_reader *r;
    struct reason why;

    enum err e = cache_reader_open(path, &r, &why);
    if (!e && !r)
        return ERR_OK;
    if (!e)
        e = transport_load(r, &w->key, w->set->gbuffer, w->set->rays, w->kernels, &w->desc, &c->transport, &why);
    cache_reader_close(r);
    if (e == ERR_RANGE || e == ERR_NOMEM) {
        c->why = why;
        return e;
    }
    if (e)
        log_warning("%s; light transport is not taken from it", why.text);
    c->loaded = !e;
    return ERR_OK;
}

static enum err load(struct work *w)
{
    enum err e = ERR_OK;

    for (int k = 0; k < w->places.count && !e && !w->cache->transport; k++)
        e = load_from(w, w->places.path[k]);
    return e;
}

/* In the first place that can be written. */
static void save(const struct work *w)
{
    struct reason why = { "" };

    for (int k = 0; k < w->places.count; k++) {
        struct cache_writer *file = cache_writer_create();
        enum err e = file ? cache_place_prepare(&w->places, k, &why) : err_say(&why, ERR_NOMEM, "no memory");
        if (!e) {
            transport_save(w->cache->transport, &w->key, file);
            e = cache_writer_store(file, w->places.path[k], &why);
        }
        cache_writer_destroy(file);
        if (!e) {
            log_info("light transport: kept in %s", w->places.path[k]);
            return;
        }
    }
    if (w->places.count > 0)
        log_warning("light transport is not kept for the next run: %s", why.text);
}

/* ---- Making ---- */

static void work_init(struct work *w, struct relight_cache *c, const struct set *set, const struct kernels *kernels,
                      const struct relight_desc *desc)
{
    *w = (struct work){ .cache = c, .set = set, .kernels = kernels };
    w->desc = (struct transport_desc){ .max_bytes = desc->cache_bytes,
                                       .seed = rng_mix(desc->direct.seed, 0x6361636865u),
                                       .no_visibility = desc->direct.no_visibility,
                                       .cancel = desc->direct.cancel };
    cache_places_find(set, desc->cache_file, &w->places);
    if (w->places.count > 0)
        w->key = transport_key(set->gbuffer, set->scene, &w->desc);
    c->no_visibility = desc->direct.no_visibility;
    c->max_bytes = desc->cache_bytes;
}

static enum err compute(struct work *w, bool progress)
{
    struct progress line;

    log_info("%s: computing light transport for --method cached; the first frame waits for it", w->set->name);
    progress_begin(&line, "computing light transport", transport_steps(w->set->gbuffer), progress ? stderr : NULL);
    w->desc.progress = &line;
    const enum err e =
        transport_create(w->set->gbuffer, w->set->rays, w->kernels, &w->desc, &w->cache->transport, &w->cache->why);
    progress_end(&line);
    return e;
}

enum err relight_cache_make(struct relight_cache *c, const struct set *set, const struct kernels *kernels,
                            const struct relight_desc *desc, bool progress, double *ms)
{
    struct work w;

    *ms = 0.0;
    if (is_for(c, desc))
        return c->refused ? err_say(desc->direct.why, ERR_RANGE, "%s", c->why.text) : ERR_OK;
    relight_cache_finish(c);
    const double start = clock_seconds();
    work_init(&w, c, set, kernels, desc);
    enum err e = load(&w);
    if (!e && !c->transport)
        e = compute(&w, progress);
    *ms = 1e3 * (clock_seconds() - start);
    if (e) {
        c->refused = e == ERR_RANGE;
        return err_say(desc->direct.why, e, "%s", c->why.text);
    }
    if (c->transport) {
        const struct transport_stats *s = transport_stats(c->transport);
        log_info("light transport: %s%.1f s, %.0f MB; %u of %u packets have lobes too narrow for it and are sampled",
                 c->loaded ? "loaded in " : "", 1e-3 * *ms, 1e-6 * (double)s->bytes, s->left, s->left + s->packets);
        if (!c->loaded)
            save(&w);
    }
    return ERR_OK;
}

enum err relight_cache_shade(struct relight_cache *c, struct direct *direct, const struct set *set,
                             const struct environment *e, const struct relight_desc *desc, float *lo,
                             struct relight_stats *stats)
{
    const struct transport_frame frame = { desc->direct.samples, desc->direct.seed, desc->direct.pass,
                                           desc->direct.cancel };
    const size_t floats = (size_t)set->gbuffer->packet_count * 3 * PACKET;

    stats->bias = "cached: a sky of 1536 cells, compressed; penumbrae that few rays miss";
    if (!c->transport) { /* cancelled */
        memset(lo, 0, floats * sizeof(float));
        return ERR_OK;
    }
    const struct packet_list *left = transport_left(c->transport);
    enum err result = ERR_OK;
    if (left->count > 0) {
        struct direct_desc rest = desc->direct;
        rest.method = METHOD_AUTO;
        rest.only = left;
        result = direct_shade(direct, set->gbuffer, set->rays, e, &rest, lo, &stats->direct);
    }
    if (!result)
        result = transport_shade(c->transport, e, &frame, lo, &stats->cache_frame);
    stats->cache = *transport_stats(c->transport);
    stats->cache_loaded = c->loaded;
    stats->direct.rays += stats->cache_frame.rays;
    return result;
}
