/* Renders frames that all ranks of a job light together. */
#include "programs/render/render.h"

/* The next frame, decoded while other ranks light this one. */
static bool look_ahead(void *context, const struct environment **e, const struct relight_desc **request)
{
    struct render *r = context;
    struct render_ahead *a = &r->ahead;

    a->result = source_next(r->source, &a->frame, &a->why);
    a->taken = true;
    a->decoded = !a->result && a->frame.kind != FRAME_NONE && !render_is_kept(r, &a->frame);
    if (!a->decoded)
        return false;
    render_decode(a->environment, &a->frame, &a->decoding);
    if (a->decoding.result)
        return false;
    a->light = r->desc.setup.light;
    a->request = render_request(r, &a->frame, &a->light);
    decide(&r->decider, &a->request);
    *e = a->environment;
    *request = &a->request.light;
    return true;
}

enum err render_split_take(struct render *r, struct reason *why)
{
    struct render_ahead *a = &r->ahead;
    struct environment *const environment = r->environment;
    const struct frame frame = r->frame;

    a->taken = false;
    r->frame = a->frame;
    a->frame = frame;
    r->decoded = a->decoded;
    if (r->decoded) {
        r->environment = a->environment;
        a->environment = environment;
        r->decoding = a->decoding;
    }
    if (a->result)
        *why = a->why;
    return a->result;
}

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
                    "--split-frames cannot be used with a ground, whose points share light: without --split-frames, "
                    "each rank renders its own frames");
    const bool ahead =
        ranks_index(r->desc.ranks) == 0 && source_count(r->source) > 0; /* else a frame may be long in coming */
    r->ahead.environment = ahead ? environment_create(&s->environment) : NULL;
    if (!e && ahead && !r->ahead.environment)
        e = err_say(why, ERR_NOMEM, "no memory for a sky");
    e = ranks_agree(r->desc.ranks, e, why);
    if (!e)
        e = team_create(&desc, &r->team, why);
    if (!e && ahead)
        team_look_ahead(r->team, look_ahead, r);
    return e;
}
