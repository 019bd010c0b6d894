#include "relightd/daemon/shade.h"

#include "base/clock.h"
#include "base/mem.h"
#include "light/radiance/components.h"

#include <math.h>
#include <time.h>

#define POLL_MS 30       /* how soon controls are noticed while no frame comes */
#define PACE_MS 2        /* likewise while an image is not due yet */
#define AUDIT_SHARE 0.05 /* of an image's rays, to state its error, */
#define AUDIT_MOST 0.01  /* and of the processor time: 2 % are promised, and the process's clock counts all threads */
#define AGAIN_S 0.1      /* after a cancelled image: how long to wait for its frame with the new settings */

/* ---- One image ---- */

/* Combines the configuration with the settings. */
static struct relight_desc describe_light(struct shade_thread *t, const struct ingested *in, const struct settings *now,
                                          struct reason *why)
{
    const struct daemon_config *c = &t->shared->config;
    struct relight_desc desc = c->setup.light;

    desc.classes = now->classes;
    desc.direct.method = now->method;
    desc.direct.samples = now->samples;
    desc.direct.pass = c->setup.reseed ? in->environment->number : 0;
    desc.turn = in->ticket.lockstep ? in->environment->number : t->images; /* dropped frames do not count */
    desc.direct.cancel = in->ticket.lockstep ? t->shared->stop : &t->shared->watch.cancel;
    desc.direct.why = why;
    desc.audit = in->ticket.lockstep ? 0.0 : AUDIT_SHARE;
    desc.has_sun_day = in->has_sky || in->has_place;
    desc.sun_day = in->has_sky ? sky_day(&in->sky, in->environment->number) : in->place.sun_day;
    desc.sun_day.turn += in->environment->rotation;
    desc.audit_live = true;
    desc.audit_most = AUDIT_MOST;
    /* --cache-wait is for the method of the command line: no controller can make others wait for a cache. */
    desc.cache_background = (desc.cache_background || now->method != c->setup.initial.method ||
                             (t->shared->ranks && t->set != t->first_set)) &&
                            !in->ticket.lockstep;
    return desc;
}

static struct protocol_picture make_header(const struct daemon_config *c, const struct ingested *in, double queued_ms,
                                           const struct relight_stats *stats, uint32_t samples)
{
    return (struct protocol_picture){
        .frame = in->environment->number,
        .capture_us = in->environment->capture_us,
        .queued_us = (uint32_t)(1e3 * queued_ms),
        .decoded_us = (uint32_t)(1e3 * in->decode_ms),
        .shaded_us = (uint32_t)(1e3 * (stats->shade_ms + stats->eye_ms + stats->light_ms + stats->resolve_ms)),
        .width = c->setup.set_desc.width,
        .height = c->setup.set_desc.height,
        .samples = samples,
    };
}

/* Lockstep renders must be reproducible, so they always use the sample counts from the command line. Otherwise auto
 * gets a share of the interval, which leaves time for encoding and reading, since their threads slow this one down. */
static struct frame_request make_request(struct shade_thread *t, const struct ingested *in, const struct lighting *l)
{
    struct frame_request q = { .asked = &l->asked,
                               .background = true,
                               .no_cache = t->set->coarse, /* it would serve the complete view only */
                               .allow_bias = t->shared->config.setup.allow_bias };

    if (l->settings.method != METHOD_AUTO || l->settings.counted || in->ticket.lockstep)
        return q;
    q.target.seconds =
        decider_target_s(&t->decider, t->relighter, fmin(1.0 / l->settings.fps, t->shared->config.image_s));
    q.target.error = l->settings.error;
    return q;
}

/* Lights the frame into rgb. Lockstep frames use the initial settings and the first camera. */
static enum err light_frame(struct shade_thread *t, const struct ingested *in, float *rgb, struct lighting *l,
                            struct reason *why)
{
    struct shared *shared = t->shared;
    struct relighter *r = in->ticket.lockstep ? t->first_relighter : t->relighter;

    l->settings = in->ticket.lockstep ? shared->config.setup.initial : settings_now(&shared->settings);
    l->asked = describe_light(t, in, &l->settings, why);
    t->images += !in->ticket.lockstep;
    l->request = make_request(t, in, l);
    if (!in->ticket.lockstep)
        decider_begin(&t->decider, r, &l->request);
    if (l->request.target.seconds > 0.0)
        l->request.target.seconds =
            fmin(decider_target_s(&t->decider, r, fmin(1.0 / l->settings.fps, shared->config.image_s)),
                 shared->config.image_s);
    decide(&t->decider, &l->request);
    return decider_run(&t->decider, r, in->environment, &l->request, rgb, &l->stats, &l->pilot);
}

/* Fills in an image's change map, for those who subscribe to them. first: nothing before it counts. */
static void find_changes(struct shade_thread *t, struct shaded *out, const struct lighting *l, bool lockstep,
                         bool first)
{
    struct server_demand demand;

    shared_demand(t->shared, &demand);
    const bool asked = demand.formats >> PROTOCOL_CHANGES & 1 && !lockstep;
    if (!asked || first)
        t->changes.begun = false;
    out->has_changes = asked && !changes_take(&t->changes, t->relighter, &l->stats, out->rgb);
    if (out->has_changes)
        changes_paint(&t->changes, out->changes);
}

static void publish(struct shade_thread *t, int slot, const struct ingested *in, struct lighting *l, double queued_ms,
                    bool new_view)
{
    struct shared *shared = t->shared;
    struct shaded *out = &shared->images.slot[slot];
    const struct relight_desc *light = &l->request.light;
    const bool measured = l->request.by == DECIDED_BY_MEASURES;
    struct protocol_picture header =
        make_header(&shared->config, in, queued_ms, &l->stats, measured ? l->pilot.samples : light->direct.samples);

    header.flags |= l->again ? PROTOCOL_PICTURE_FINER : 0;
    out->header = header;
    out->ticket = l->again ? (struct server_ticket){ .id = 0 } : in->ticket;
    out->new_view = new_view;
    inspect_report_image(t, out);
    image_slots_publish(&shared->images, slot, shared->server); /* from here on the slot is the encode thread's */
    const double now_s = clock_seconds();
    status_image_shaded(&shared->status,
                        &(struct image_report){ in, header, light, &l->stats, measured ? &l->pilot : NULL,
                                                t->shaded_s > 0.0 ? now_s - t->shaded_s : 0.0, t->set->coarse });
    if (!measured && !light->denoise) /* what the filter takes, no setting asks for */
        cost_learn(&t->cost, (in->ticket.lockstep ? t->first_set : t->set)->facts.points, light, &l->stats);
    if (!in->ticket.lockstep)
        atomic_store(&shared->settings.proven, l->settings.light_version);
    decider_learn(&t->decider, t->relighter, &l->request, &l->stats, &l->pilot);
    const double since_s = t->shaded_s > 0.0 ? now_s - t->shaded_s : 0.0;
    refine_open(t, &(struct shown_image){ in, out, *light, header, now_s, since_s });
    t->shaded_s = now_s;
}

/* again: an image of this frame was shown before, and its producer was told. */
static enum err shade_frame(struct shade_thread *t, const struct ingested *in, bool new_view, bool again,
                            struct reason *why)
{
    struct shared *shared = t->shared;
    const int slot = handoff_begin(&shared->images.handoff);
    const double queued_ms = again ? 0.0 : (double)(clock_ms() - in->ready_ms);
    struct lighting l = { .again = again };

    t->last = NULL; /* this may be its slot, and its frame is gone */
    image_begin(t, in->ticket.lockstep);
    const enum err e = light_frame(t, in, shared->images.slot[slot].rgb, &l, why);
    const bool cut = image_end(t);
    t->display_version = l.settings.display_version;
    if (e == ERR_UNSUPPORTED || e == ERR_RANGE) { /* this layout or this size: the image before stays */
        server_frame_fate(shared->server, &in->ticket, SERVER_REFUSED, why->text);
        status_frame_unusable(&shared->status, why->text);
        return ERR_OK;
    }
    if (e)
        return err_say(why, e, "%s: no memory for the light samples", in->environment->name);
    t->cut_new_view = cut && new_view;
    if (!atomic_load(t->shared->stop) && !cut) { /* else the image is incomplete */
        lamps_take_sky(t, shared->images.slot[slot].rgb);
        lamps_add(t, in->ticket.lockstep, l.settings.lamps, shared->images.slot[slot].rgb);
        find_changes(t, &shared->images.slot[slot], &l, in->ticket.lockstep, new_view);
        publish(t, slot, in, &l, queued_ms, new_view);
    }
    return ERR_OK;
}

/* ---- The loop ---- */

/* Seconds between images. Without viewers, one image per second keeps the last one current; a recorder waits for
 * every frame, so its frames are made as fast as possible. */
static double interval_s(struct shade_thread *t)
{
    struct server_demand demand;

    shared_demand(t->shared, &demand);
    if (demand.recorder)
        return 0.0;
    const double asked_s = demand.viewers ? 1.0 / settings_now(&t->shared->settings).fps : 1.0;
    return fmax(asked_s, decider_interval_s(&t->decider));
}

/* Applies requests of controllers and signals. After a change of camera the current frame is lit again, unless it
 * belongs to a lockstep sequence. */
static enum err apply_controls(struct shade_thread *t, struct reason *why)
{
    struct shared *shared = t->shared;

    if (atomic_exchange(shared->reload, false))
        daemon_config_reload(&shared->readings, &shared->settings, shared->server);
    settings_take_control(&shared->settings);
    if (atomic_exchange(&shared->settings.views_changed, false))
        status_set_cameras(&shared->status, &shared->settings, t->set->camera);
    if (camera_follow_settings(t) && t->held != HANDOFF_NONE) {
        const struct ingested *in = &shared->frames.slot[t->held];
        const enum err e = in->ticket.lockstep ? ERR_OK : shade_frame(t, in, true, false, why);
        if (e)
            return e;
    }
    if (atomic_exchange(&shared->repeat_requested, false) ||
        settings_now(&shared->settings).display_version != t->display_version || lamps_have_news(t))
        refine_republish(t);
    return ERR_OK;
}

bool shade_thread_next(void *thread, const struct environment **e, const struct relight_desc **request)
{
    struct shade_thread *t = thread;
    struct frame_slots *frames = &t->shared->frames;
    struct lighting *l = &t->next;

    if (t->relighter != t->first_relighter || t->held == HANDOFF_NONE || t->early != HANDOFF_NONE ||
        frames->slot[t->held].ticket.lockstep || clock_seconds() < t->begun_s + interval_s(t))
        return false;
    t->early = handoff_take_early(&frames->handoff);
    if (t->early == HANDOFF_NONE || frames->slot[t->early].ticket.lockstep)
        return false;
    const struct ingested *in = &frames->slot[t->early];
    l->settings = settings_now(&t->shared->settings);
    l->asked = describe_light(t, in, &l->settings, NULL);
    l->request = make_request(t, in, l);
    if (l->request.target.seconds > 0.0 || l->request.target.error > 0.0) /* by what this image will have taken */
        return false;
    decide(&t->decider, &l->request);
    *e = in->environment;
    *request = &l->request.light;
    return true;
}

/* Takes the newest frame, releases the previous one and lights the new one. due_s: when this image was due. */
static enum err shade_next(struct shade_thread *t, double due_s, double now_s, struct reason *why)
{
    struct frame_slots *frames = &t->shared->frames;

    t->refine.open = false;
    if (t->cut_s > 0.0)
        server_frame_fate(t->shared->server, &frames->slot[t->held].ticket, SERVER_SUPERSEDED, NULL);
    if (t->held != HANDOFF_NONE)
        handoff_release(&frames->handoff, t->held);
    t->held = t->early != HANDOFF_NONE ? t->early : handoff_take(&frames->handoff, 0);
    t->early = HANDOFF_NONE;
    if (t->held == HANDOFF_NONE) /* closed */
        return ERR_OK;
    /* Keep to the grid of the requested rate, unless it was missed by more than one image. */
    t->begun_s = now_s - due_s < interval_s(t) ? due_s : now_s;
    return shade_frame(t, &frames->slot[t->held], t->cut_new_view, false, why);
}

/* The frame stands still. While auto's cache is being computed, lighting it again gives the images that a moving sky
 * would have, which improve faster than by passes. */
static enum err improve(struct shade_thread *t, double now_s, struct reason *why)
{
    if (!t->decider.cache.begun || t->decider.cache.share >= 1.0)
        return refine_pass(t, why);
    t->begun_s = now_s;
    return shade_frame(t, &t->shared->frames.slot[t->held], false, true, why);
}

enum err shade_thread_turn(struct shade_thread *t, struct reason *why)
{
    struct shared *shared = t->shared;

    server_beat(shared->server);
    atomic_store(shared->new_work, false); /* what came before is handled below; what comes later ends a pass */
    const enum err e = apply_controls(t, why);
    if (e)
        return e;
    inspect_result(t);
    if (camera_is_completed(t)) {
        nanosleep(&(struct timespec){ .tv_nsec = PACE_MS * 1000000L }, NULL);
        return ERR_OK;
    }
    const double due_s = t->begun_s + interval_s(t), now_s = clock_seconds();
    if (now_s < due_s) {
        nanosleep(&(struct timespec){ .tv_nsec = PACE_MS * 1000000L }, NULL);
        return ERR_OK;
    }
    const bool refine = refine_is_due(t);
    if (t->early != HANDOFF_NONE || handoff_wait_newer(&shared->frames.handoff, refine ? 0 : POLL_MS))
        return shade_next(t, due_s, now_s, why);
    if (t->cut_s > 0.0) /* a cancelled image, whose frame ingest has neither published again nor replaced meanwhile */
        return now_s - t->cut_s < AGAIN_S ? ERR_OK
                                          : shade_frame(t, &shared->frames.slot[t->held], t->cut_new_view, false, why);
    return refine && !atomic_load(t->shared->stop) ? improve(t, now_s, why) : ERR_OK;
}

enum err shade_thread_run(struct shade_thread *t, struct reason *why)
{
    enum err e = ERR_OK;

    while (!e && !atomic_load(t->shared->stop))
        e = shade_thread_turn(t, why);
    return e;
}

/* ---- Begin and end ---- */

/* What METHOD_COMPONENTS adds up, from now on in the configuration. */
static enum err read_parts(struct shade_thread *t, struct reason *why)
{
    struct setup *s = &t->shared->config.setup;
    const struct parts_desc desc = { s->parts, s->set_desc.width, s->set_desc.height, s->light.cache_bytes };
    const enum err e = s->initial.method == METHOD_COMPONENTS ? parts_create(&desc, &t->parts, why) : ERR_OK;

    if (e || !t->parts)
        return e;
    t->whole = parts_whole(t->parts);
    s->light.whole = &t->whole;
    return ERR_OK;
}

/* Whether the first image may show a coarse view, also if a cache waits for the complete one, which may take far longer
 * to compute than the first image. Not where images must be reproducible or wait for something else. */
static bool may_be_coarse(const struct shared *shared)
{
    const struct daemon_config *c = &shared->config;
    const struct setup *s = &c->setup;

    return s->initial.method == METHOD_AUTO && !s->initial.counted && s->light.cache_background && !c->push &&
           !shared->ranks && c->part_floats != PART_HALF && s->light.caustics != PLAN_STORED;
}

enum err shade_thread_create(struct shared *shared, struct shade_thread **out, struct reason *why)
{
    const struct daemon_config *c = &shared->config;
    struct prepared_scene_desc desc = c->setup.set_desc;
    struct shade_thread *t = mem_alloc(1, sizeof(*t));

    *out = NULL;
    if (!t)
        return err_say(why, ERR_NOMEM, "out of memory");
    t->shared = shared;
    t->held = t->early = HANDOFF_NONE;
    t->created_s = clock_seconds();
    desc.soon = may_be_coarse(shared);
    enum err e = read_parts(t, why);
    if (!e)
        e = set_create(&desc, &t->first_set, why);
    if (e)
        goto failed;
    setup_report_unused(&c->setup, t->first_set);
    t->set = t->first_set;
    t->coarse_view = t->set->coarse;
    t->first_relighter = t->relighter = relighter_create(t->set, c->setup.kernels);
    if (!t->relighter || !lamps_create_canvas(t)) {
        e = err_say(why, ERR_NOMEM, "no memory for images of %ux%u", c->setup.set_desc.width, c->setup.set_desc.height);
        goto failed;
    }
    *out = t;
    return ERR_OK;
failed:
    shade_thread_destroy(t);
    return e;
}

double shade_thread_estimate(void *t, const struct settings *s)
{
    return image_seconds(t, ((struct shade_thread *)t)->set, s);
}

enum err shade_thread_prepare(struct shade_thread *t, struct reason *why)
{
    struct relight_desc light = t->shared->config.setup.light;
    double ms;

    if ((light.direct.method == METHOD_CACHED && !light.cache_background) || light.caustics == PLAN_STORED)
        status_set_source(&t->shared->status, SERVER_WAITING, "light transport is being computed");
    light.direct.cancel = t->shared->stop;
    light.direct.why = why;
    return relighter_prepare(t->relighter, &light, t->shared->config.setup.set_desc.progress, &ms);
}

void shade_thread_destroy(struct shade_thread *t)
{
    if (!t)
        return;
    decider_finish(&t->decider);
    refiner_destroy(t->refine.refiner);
    inspect_finish(t);
    changes_finish(&t->changes);
    lamps_finish(t);
    camera_finish(t);
    parts_destroy(t->parts);
    mem_free(t);
}
