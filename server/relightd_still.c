/* server/relightd_still.c */
/* While no frame comes, the shade thread makes the last picture better (film/still.h). A stream of frames never sees
 * any of it: passes begin only after a quiet time, and the first sign of something new ends the one under way. */
#include "relightd.h"

#include "clock.h"
#include "log.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#define QUIET_LEAST_S 0.25 /* after a picture, before it is made better; twice the time between pictures, */
#define QUIET_MOST_S 1.0   /* but no more than this */
#define PACE_S 0.4         /* between better pictures, */
#define GROWTH 1.25        /* which have so many times the passes of the one before */
#define FIRST_PASSES 4     /* of the first of them */
#define LOG_S 600.0

void daemon_still_open(struct daemon *d, const struct still_frame *frame)
{
    d->still_frame = *frame;
    d->still_frame.light.direct.cancel = d->stirred;
    d->still_frame.light.direct.why = NULL;
    d->still_known = !frame->in->ticket.lockstep;
    d->still_open = d->converge.error > 0.0 && d->still_known;
    d->still_begun = false;
}

void daemon_still_forget(struct daemon *d)
{
    d->still_known = d->still_open = d->still_begun = false;
}

void daemon_still_close(struct daemon *d)
{
    d->still_open = false;
}

bool daemon_still_is_due(struct daemon *d)
{
    const struct still_frame *f = &d->still_frame;
    struct server_demand demand;

    if (!d->still_open || atomic_load(&d->reading))
        return false;
    const double quiet_s = fmin(fmax(2.0 * f->interval_s, QUIET_LEAST_S), QUIET_MOST_S);
    if (clock_seconds() - f->shown_s < quiet_s)
        return false;
    server_demand(d->server, &demand);
    return demand.viewers > 0;
}

static bool begin(struct daemon *d)
{
    if (!d->still)
        d->still = still_create(d->set, d->kernels);
    if (!d->still) {
        log_warning("no memory to make a picture better that stands still");
        d->still_open = false;
        return false;
    }
    still_begin(d->still, d->still_frame.first->rgb);
    d->still_begun = true;
    d->still_s = d->still_told_s = 0.0;
    d->still_told = 0;
    return true;
}

/* The standing picture as it was shown last, or as the passes have made it, with so many of them in it. */
static void hand_on(struct daemon *d, bool by_passes, uint64_t passes)
{
    struct still_frame *f = &d->still_frame;
    const int slot = handoff_begin(&d->pictures);
    struct shaded *out = &d->shaded[slot];

    if (by_passes)
        still_picture(d->still, out->rgb);
    else if (out != f->first)
        memcpy(out->rgb, f->first->rgb, 3 * sizeof(float) * f->header.width * f->header.height);
    out->header = f->header;
    out->header.flags |= PROTOCOL_PICTURE_FINER;
    if (passes > 0) {
        out->header.shaded_us = (uint32_t)fmin(1e6 * d->still_s, UINT32_MAX);
        out->header.samples = (uint32_t)fmin((double)passes * f->light.direct.samples, UINT32_MAX);
    }
    out->ticket = (struct server_ticket){ .id = 0 };
    out->anew = false;
    f->first = out; /* the slots take turns */
    daemon_probe_picture(d, out);
    const int dropped = handoff_publish(&d->pictures, slot);
    if (dropped != HANDOFF_NONE)
        server_frame_fate(d->server, &d->shaded[dropped].ticket, SERVER_SUPERSEDED, NULL);
}

static void publish(struct daemon *d, const struct still_stats *stats)
{
    daemon_tell_finer(d, stats);
    hand_on(d, true, stats->passes);
    d->still_told = stats->passes;
    d->still_told_s = clock_seconds();
}

void daemon_still_show(struct daemon *d)
{
    if (!d->still_known)
        return;
    d->looks = daemon_settings(d).looks;
    hand_on(d, d->still_begun && d->still_told > 0, d->still_begun ? d->still_told : 0);
}

static void tell_end(struct daemon *d, const struct still_stats *stats)
{
    const double now_s = clock_seconds();

    if (d->still_logged_s > 0.0 && now_s - d->still_logged_s < LOG_S)
        return;
    d->still_logged_s = now_s;
    log_info("frame %" PRIu64 " stands still: relMSE %.1e after %" PRIu64 " unbiased passes in %.1f s",
             d->still_frame.header.frame, stats->error, stats->passes, d->still_s);
}

/* Looked at as often as it may be told. */
static void look(struct daemon *d)
{
    struct still_stats stats;

    struct still_wish wish = d->converge;

    wish.error = fmax(wish.error, daemon_settings(d).error); /* who asks for no better pictures gets none */
    still_look(d->still, &wish, &stats);
    if (stats.converged || (stats.passes >= FIRST_PASSES && (double)stats.passes >= GROWTH * (double)d->still_told &&
                            clock_seconds() - d->still_told_s >= PACE_S))
        publish(d, &stats);
    if (stats.converged) {
        tell_end(d, &stats);
        d->still_open = false;
    }
}

enum err daemon_still_pass(struct daemon *d, struct reason *why)
{
    if (!d->still_begun && !begin(d))
        return ERR_OK;
    const double start = clock_seconds();
    const enum err e = still_pass(d->still, d->still_frame.in->environment, &d->still_frame.light);
    if (e)
        return err_say(why, e, "no memory to make a picture better that stands still");
    d->still_s += clock_seconds() - start;
    if (!atomic_load(d->stirred))
        look(d);
    return ERR_OK;
}
