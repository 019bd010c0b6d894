/* While no frame arrives, the shade thread refines the last image (light/frame/refine.h). Refinement does not affect
 * live streams: passes start only after an idle time, and any new work ends the current pass. */
#include "relightd/daemon/shade.h"

#include "base/clock.h"
#include "base/log.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

#define QUIET_LEAST_S 0.25  /* from an image to the first pass: twice the time between images, */
#define QUIET_MOST_S 1.0    /* within these limits */
#define PUBLISH_S 0.4       /* at least, between refined images; */
#define PUBLISH_GROWTH 1.25 /* each has this many times the passes of the one before, */
#define FIRST_PASSES 4      /* and the first this many */
#define LOG_S 600.0         /* between lines about converged images */

void refine_open(struct shade_thread *t, const struct shown_image *shown)
{
    struct refinement *r = &t->refine;

    r->shown = *shown;
    r->shown.light.direct.cancel = t->shared->new_work;
    r->shown.light.direct.why = NULL;
    r->known = !shown->in->ticket.lockstep;
    r->open = t->shared->config.converge.error > 0.0 && r->known && !method_is_reference(shown->light.direct.method);
    r->begun = false;
}

void refine_forget(struct shade_thread *t)
{
    t->refine.known = t->refine.open = t->refine.begun = false;
}

bool refine_is_due(struct shade_thread *t)
{
    const struct refinement *r = &t->refine;
    struct server_demand demand;

    if (!r->open || atomic_load(&t->shared->reading) || lamps_come_first(t))
        return false;
    const bool again = r->shown.header.flags & PROTOCOL_PICTURE_FINER; /* it has been quiet before */
    const double quiet_s = fmin(fmax(2.0 * r->shown.interval_s, QUIET_LEAST_S), QUIET_MOST_S);
    if (!again && clock_seconds() - r->shown.shown_s < quiet_s)
        return false;
    shared_demand(t->shared, &demand);
    return demand.viewers > 0;
}

static bool begin(struct shade_thread *t)
{
    struct refinement *r = &t->refine;

    if (!r->refiner)
        r->refiner = refiner_create(t->set, t->shared->config.setup.kernels);
    if (!r->refiner) {
        log_warning("no memory to refine a still image");
        r->open = false;
        return false;
    }
    refiner_begin(r->refiner, lamps_sky(t) ? lamps_sky(t) : r->shown.latest->rgb);
    r->begun = true;
    r->pass_s = r->published_s = 0.0;
    r->published_passes = 0;
    return true;
}

/* Publishes the image of the passes, or, without passes, the last published one again. */
static void publish_image(struct shade_thread *t, uint64_t passes)
{
    struct refinement *r = &t->refine;
    struct shown_image *shown = &r->shown;
    const int slot = handoff_begin(&t->shared->images.handoff);
    struct shaded *out = &t->shared->images.slot[slot];
    const float *from = lamps_sky(t) ? lamps_sky(t) : shown->latest->rgb;

    if (passes > 0)
        refiner_image(r->refiner, out->rgb);
    else if (from != out->rgb)
        memcpy(out->rgb, from, 3 * sizeof(float) * shown->header.width * shown->header.height);
    lamps_add(t, false, settings_now(&t->shared->settings).lamps, out->rgb);
    out->header = shown->header;
    out->header.flags |= PROTOCOL_PICTURE_FINER;
    if (passes > 0) {
        out->header.shaded_us = (uint32_t)fmin(1e6 * r->pass_s, UINT32_MAX);
        out->header.samples = (uint32_t)fmin((double)passes * shown->light.direct.samples, UINT32_MAX);
    }
    out->ticket = (struct server_ticket){ .id = 0 };
    out->new_view = out->has_changes = false;
    shown->latest = out; /* the slots rotate */
    inspect_report_image(t, out);
    image_slots_publish(&t->shared->images, slot, t->shared->server);
}

void refine_republish(struct shade_thread *t)
{
    const struct refinement *r = &t->refine;

    if (!r->known)
        return;
    t->display_version = settings_now(&t->shared->settings).display_version;
    publish_image(t, r->begun ? r->published_passes : 0);
}

static void log_converged(struct refinement *r, const struct refiner_stats *stats)
{
    const double now_s = clock_seconds();

    if (r->logged_s > 0.0 && now_s - r->logged_s < LOG_S)
        return;
    r->logged_s = now_s;
    log_info("frame %" PRIu64 " stands still: relMSE %.1e after %" PRIu64 " unbiased passes in %.1f s",
             r->shown.header.frame, stats->error, stats->passes, r->pass_s);
}

/* Estimates the error after a pass; publishes at intervals and when the image has converged. */
static void evaluate(struct shade_thread *t)
{
    struct refinement *r = &t->refine;
    struct refiner_stats stats;
    struct refiner_wish wish = t->shared->config.converge;

    wish.error = fmax(wish.error, settings_now(&t->shared->settings).error); /* no better than the user requested */
    refiner_look(r->refiner, &wish, &stats);
    if (stats.converged ||
        (stats.passes >= FIRST_PASSES && (double)stats.passes >= PUBLISH_GROWTH * (double)r->published_passes &&
         clock_seconds() - r->published_s >= PUBLISH_S)) {
        status_image_refined(&t->shared->status, &stats);
        publish_image(t, stats.passes);
        r->published_passes = stats.passes;
        r->published_s = clock_seconds();
    }
    if (stats.converged) {
        log_converged(r, &stats);
        r->open = false;
    }
}

enum err refine_pass(struct shade_thread *t, struct reason *why)
{
    struct refinement *r = &t->refine;

    if (!r->begun && !begin(t))
        return ERR_OK;
    const double start = clock_seconds();
    const enum err e = refiner_pass(r->refiner, r->shown.in->environment, &r->shown.light);
    if (e)
        return err_say(why, e, "no memory to refine a still image");
    r->pass_s += clock_seconds() - start;
    if (!atomic_load(t->shared->new_work))
        evaluate(t);
    return ERR_OK;
}
