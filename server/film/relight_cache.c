#include "relight_cache.h"

#include "clock.h"
#include "log.h"
#include "progress.h"
#include "rng.h"

#include <stdio.h>
#include <string.h>

void relight_cache_finish(struct relight_cache *c)
{
    transport_destroy(c->transport);
    *c = (struct relight_cache){ .transport = NULL };
}

static bool is_for(const struct relight_cache *c, const struct relight_desc *desc)
{
    return (c->transport || c->refused) && c->no_visibility == desc->direct.no_visibility &&
           c->max_bytes == desc->cache_bytes;
}

static enum err make(struct relight_cache *c, const struct set *set, const struct kernels *kernels,
                     const struct relight_desc *desc, struct progress *line)
{
    const struct transport_desc t = {
        .max_bytes = desc->cache_bytes,
        .seed = rng_mix(desc->direct.seed, 0x6361636865u),
        .no_visibility = desc->direct.no_visibility,
        .progress = line,
        .cancel = desc->direct.cancel,
    };

    c->no_visibility = desc->direct.no_visibility;
    c->max_bytes = desc->cache_bytes;
    return transport_create(set->gbuffer, set->rays, kernels, &t, &c->transport, &c->why);
}

enum err relight_cache_make(struct relight_cache *c, const struct set *set, const struct kernels *kernels,
                            const struct relight_desc *desc, bool progress, double *ms)
{
    struct progress line;

    *ms = 0.0;
    if (is_for(c, desc))
        return c->refused ? err_say(desc->direct.why, ERR_RANGE, "%s", c->why.text) : ERR_OK;
    relight_cache_finish(c);
    log_info("%s: computing light transport for --method cached; the first frame waits for it", set->name);
    progress_begin(&line, "computing light transport", transport_steps(set->gbuffer), progress ? stderr : NULL);
    const double start = clock_seconds();
    const enum err e = make(c, set, kernels, desc, &line);
    *ms = 1e3 * (clock_seconds() - start);
    progress_end(&line);
    if (e) {
        c->refused = e == ERR_RANGE;
        return err_say(desc->direct.why, e, "%s", c->why.text);
    }
    if (c->transport) {
        const struct transport_stats *s = transport_stats(c->transport);
        log_info("light transport: %.1f s, %.0f MB; %u of %u packets have lobes too narrow for it and are sampled",
                 1e-3 * *ms, 1e-6 * (double)s->bytes, s->left, s->left + s->packets);
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
    stats->direct.rays += stats->cache_frame.rays;
    return result;
}
