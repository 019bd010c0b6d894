/* Frames that all ranks of a job light together. */
#include "render/render_parts.h"

#include "base/log.h"

#include <inttypes.h>

enum err render_split_begin(struct render *r, struct reason *why)
{
    const struct setup *s = &r->desc.setup;
    const struct team_desc desc = { .ranks = r->desc.ranks,
                                    .relighter = r->relighter,
                                    .environment = &s->environment,
                                    .cache_file = s->light.cache_file,
                                    .cache_dir = s->light.cache_dir };
    enum err e = ERR_OK;

    if (r->set->scene->ground.radius > 0.0f)
        e = err_say(why, ERR_USAGE,
                    "--split-frames does not go with a ground, whose light is not each point's own: "
                    "leave it out, and each rank renders frames of its own");
    return e ? e : team_create(&desc, &r->team, why);
}

enum err render_split_serve(struct render *r, struct reason *why)
{
    return team_serve(r->team, why);
}

void render_split_end(struct render *r)
{
    if (!r->team)
        return;
    const struct team_stats s = *team_stats(r->team);
    team_destroy(r->team);
    r->team = NULL;
    if (ranks_index(r->desc.ranks) == 0 && s.dealt > 0)
        log_info("%" PRIu64 " pictures by %u ranks: %.1f KB to each rank and %.2f MB from all of them per picture; "
                 "%.2f s for rank 0's parts, %.2f s of waiting for others; G-buffer and caches: %.1f MB on rank 0, at "
                 "most %.1f MB on another",
                 s.dealt, ranks_count(r->desc.ranks), 1e-3 * (double)s.sent, 1e-6 * (double)s.received, s.part_s,
                 s.wait_s, 1e-6 * (double)s.memory, 1e-6 * (double)s.memory_most);
}
