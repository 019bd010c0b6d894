#include "relightd/daemon/ingest.h"

#define TAKE_MS 100 /* at most, until new settings are noticed */
#define PAUSE_MS 30 /* likewise, while paused */

/* Without a frame to take: reports that the producer ended its stream or left. Returns the state reported. */
static enum server_source report_idle(struct ingest_thread *t, enum server_source reported)
{
    struct server_demand demand;

    server_demand(t->shared->server, &demand);
    if (!demand.producer || demand.ended)
        glide_end(t);
    if (reported != SERVER_LIVE || (demand.producer && !demand.ended))
        return reported;
    if (demand.ended)
        status_set_source(&t->shared->status, SERVER_ENDED, "the producer has sent all its frames");
    else
        status_producer_left(&t->shared->status);
    return demand.ended ? SERVER_ENDED : SERVER_WAITING;
}

/* A paused source takes no frames; producers and viewers are notified. any: a frame was taken before. Returns the state
 * reported. */
static enum server_source report_pause(struct ingest_thread *t, bool paused, bool any, enum server_source reported)
{
    struct status_board *status = &t->shared->status;

    if (paused == (reported == SERVER_PAUSED))
        return reported;
    if (paused)
        status_set_source(status, SERVER_PAUSED, "");
    else if (any)
        status_set_source(status, SERVER_LIVE, ""); /* and report_idle looks again whether it has ended */
    else
        status_set_source(status, SERVER_WAITING, "no producer has sent a frame yet");
    return paused ? SERVER_PAUSED : any ? SERVER_LIVE : SERVER_WAITING;
}

/* Each frame's producer is sent its fate. Returns the source's state after it. */
static enum server_source take(struct ingest_thread *t, const struct frame *f, const struct server_ticket *ticket,
                               const struct frame **shown, enum server_source reported, struct reason *why)
{
    struct shared *shared = t->shared;
    enum err e = ERR_OK;

    *shown = f;
    if (ticket->lockstep)
        glide_forget(t);
    else
        e = glide_take(t, f, shown, why);
    if (e || ingest_frame(t, *shown, ticket, why)) {
        server_frame_fate(shared->server, ticket, SERVER_REFUSED, why->text);
        status_frame_unreadable(&shared->status, why->text, true);
        return SERVER_FAILED;
    }
    if (reported == SERVER_PAUSED)
        return SERVER_PAUSED;
    if (reported != SERVER_LIVE)
        status_set_source(&shared->status, SERVER_LIVE, "");
    return SERVER_LIVE;
}

void ingest_from_producers(struct ingest_thread *t, struct reason *why)
{
    struct shared *shared = t->shared;
    static const struct server_ticket none = { 0 };
    struct frame f = { 0 };
    const struct frame *shown = &f; /* or one between two */
    struct server_ticket ticket = { 0 };
    enum server_source reported = SERVER_WAITING;
    uint64_t version = 0;
    bool any = false, lockstep = false; /* whether a frame was taken before, and the last one was in lockstep */

    ingest_wait_prepared(t);
    while (!shared_is_stopping(shared)) {
        const struct settings now = settings_now(&shared->settings);
        if (!lockstep || handoff_wait_taken(&shared->frames.handoff, 0)) /* new settings replace no lockstep frame */
            ingest_relight(t, shown, now.light_version, &version, why);
        reported = report_pause(t, now.paused, any, reported);
        /* A pause holds live frames only: lockstep sequences do not know of settings. */
        const int wait_ms = now.paused ? PAUSE_MS : glide_wait_ms(t, TAKE_MS);
        if (!server_take_frame(shared->server, &f, &ticket, !now.paused, wait_ms)) {
            const struct frame *between = now.paused || lockstep ? NULL : glide_step(t);
            if (between && !ingest_frame(t, between, &none, why))
                shown = between;
            reported = report_idle(t, reported);
            continue;
        }
        any = true;
        lockstep = ticket.lockstep;
        version = now.light_version;
        reported = take(t, &f, &ticket, &shown, reported, why);
        if (reported == SERVER_FAILED) { /* new settings do not make it better */
            f.kind = FRAME_NONE;
            shown = &f;
        }
    }
    frame_finish(&f);
}
