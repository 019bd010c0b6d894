#include "relightd/daemon/ingest.h"

#include "base/clock.h"
#include "base/log.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#define MARGIN_MS 2          /* a frame is ready this long before it is wanted */
#define UNWATCHED_MS 1000    /* between frames of a computed sky that nobody watches */
#define WATCH_POLL_MS 20     /* how soon a new viewer is noticed meanwhile */
#define PAUSE_POLL_MS 30     /* how soon a request is noticed while no frame is due */
#define NAP_MS 50            /* likewise while waiting for the next frame */
#define FAILURE_FIRST_MS 100 /* wait after a bad frame; doubles up to FAILURE_MOST_MS */
#define FAILURE_MOST_MS 1000

/* The position in the source and its pace. */
struct pull {
    struct ingest_thread *t;
    struct shared *shared;
    struct reason *why;
    struct frame frame;        /* the current one; kind FRAME_NONE before the first */
    const struct frame *shown; /* it, or one between two */
    struct frame coming;       /* buffer for the next */
    uint64_t count;            /* frames requested */
    uint64_t version;          /* light_version with which the current frame was read */
    int64_t next_ms;           /* when the next frame is due, if the source has a rate */
    int64_t failure_ms;        /* how long to wait after a bad frame */
    uint64_t used;             /* of these, those that gave an image */
    bool failed, ended, reported_end, paused;
    struct reason silence; /* what was reported when `lost` was set */
    bool lost;             /* a live stream is not connected, which was reported */
    bool moved;            /* the next frame was requested by step or seek: read it although paused */
};

/* Frames per second: --rate, else the source's own; 0: as fast as they are lit. */
static double rate_of(const struct pull *p)
{
    return p->shared->config.rate > 0.0 ? p->shared->config.rate : source_rate(p->t->source);
}

static void relight(struct pull *p)
{
    ingest_relight(p->t, p->shown, settings_now(&p->shared->settings).light_version, &p->version, p->why);
}

/* Steps and seeks as controllers asked since the last call. */
static void apply_source_request(struct pull *p)
{
    const struct source_request r = settings_take_source_request(&p->shared->settings);
    struct source *source = p->t->source;

    if (r.has_hour && source_sky(source))
        p->moved |= source_set_hour(source, r.hour + source_sky(source)->speed_hours * (double)r.step);
    else if (r.has_hour || r.has_day)
        p->moved |= source_set_moment(source, r.has_day ? r.day : 0, r.has_hour ? r.hour : -1.0);
    else if (r.has_seek)
        p->moved |= source_seek(source, r.seek);
    else if (r.step != 0)
        p->moved |= source_step(source, r.step);
}

/* Handles pause, requests and the end of the source. Returns true when the next frame should be read; otherwise
 * relights the current frame if the settings changed, and sleeps briefly. */
static bool wants_frame(struct pull *p)
{
    struct status_board *status = &p->shared->status;
    const bool paused = settings_now(&p->shared->settings).paused;

    apply_source_request(p);
    if (!p->ended && paused != p->paused && p->count > 0)
        status_set_source(status, paused ? SERVER_PAUSED : SERVER_LIVE, "");
    p->paused = paused;
    if (p->moved || (!p->ended && !paused))
        return true;
    relight(p);
    if (p->ended && !p->reported_end && !p->failed && status_all_frames_done(status)) {
        status_set_source(status, SERVER_ENDED, p->count == 1 ? "it is one image" : "the last frame was shown");
        p->reported_end = true;
    }
    ingest_sleep_ms(PAUSE_POLL_MS);
    return false;
}

/* Whether to end the wait for the next frame early. */
static bool is_interrupted(struct pull *p)
{
    return shared_is_stopping(p->shared) || atomic_load(&p->shared->settings.request_waiting) ||
           settings_now(&p->shared->settings).paused;
}

/* Sleeps in short naps, so that requests are answered at once. */
static void sleep_until_ms(struct pull *p, int64_t when_ms)
{
    for (int64_t left = when_ms - clock_ms(); left > 0 && !is_interrupted(p); left = when_ms - clock_ms()) {
        ingest_sleep_ms(left < NAP_MS ? left : NAP_MS);
        if (rate_of(p) > 0.0 && !p->failed)
            relight(p);
    }
}

/* Without a rate, reads the next frame just before shading of the current one ends: earlier it would only become
 * outdated. The other ranks of a job begin with it before that, so that it must be there. */
static void wait_until_wanted(struct pull *p)
{
    while (!handoff_wait_taken(&p->shared->frames.handoff, 100) && !is_interrupted(p))
        continue;
    if (!p->shared->ranks)
        sleep_until_ms(p, clock_ms() + (int64_t)status_shading_excess_ms(&p->shared->status) - MARGIN_MS);
}

/* Skips frames of a computed sky while there are no viewers: after a second, or when a viewer connects, the next frame
 * is the current one. Files are never skipped, because their frames are counted. */
static void pause_while_unwatched(struct pull *p)
{
    const int64_t each_ms = (int64_t)(1e3 / p->shared->config.rate), until_ms = p->next_ms + UNWATCHED_MS - each_ms;

    if (source_kind(p->t->source) != SOURCE_SKY || source_count(p->t->source) > 0 || ingest_is_watched(p->t))
        return;
    while (clock_ms() < until_ms && !ingest_is_watched(p->t) && !is_interrupted(p))
        sleep_until_ms(p, clock_ms() + WATCH_POLL_MS);
    const int64_t passed = (clock_ms() - p->next_ms) / each_ms;
    if (passed > 0 && !is_interrupted(p) && source_step(p->t->source, 1 + passed))
        p->next_ms += passed * each_ms;
}

/* No new frame: tells viewers if the reason is a lost live stream. */
static void report_silence(struct pull *p)
{
    struct reason state;
    char text[sizeof(state.text) + 32];

    if (p->paused || source_is_connected(p->t->source, &state))
        return;
    if (p->lost && strcmp(state.text, p->silence.text) == 0)
        return;
    p->lost = true;
    p->silence = state;
    snprintf(text, sizeof(text), "%s%s", state.text, p->count > 0 ? "; the last sky stays" : "");
    status_set_source(&p->shared->status, SERVER_WAITING, text);
}

/* A source without a good frame must not spin. */
static void wait_after_failure(struct pull *p)
{
    const double rate = rate_of(p);

    p->failure_ms = p->failure_ms ? 2 * p->failure_ms : FAILURE_FIRST_MS;
    p->failure_ms = p->failure_ms < FAILURE_MOST_MS ? p->failure_ms : FAILURE_MOST_MS;
    sleep_until_ms(p, clock_ms() + (rate > 0.0 ? (int64_t)(1e3 / rate) : p->failure_ms));
}

static void pace(struct pull *p)
{
    const int64_t now = clock_ms();

    if (p->failed && source_kind(p->t->source) == SOURCE_WATCH)
        return; /* files end, and then the folder waits for the next: a good one must not wait for bad ones */
    if (p->failed) {
        wait_after_failure(p);
        return;
    }
    p->failure_ms = 0;
    if (rate_of(p) > 0.0) {
        p->next_ms += (int64_t)(1e3 / rate_of(p));
        p->next_ms = p->next_ms > now ? p->next_ms : now;
        sleep_until_ms(p, p->next_ms);
        pause_while_unwatched(p);
    } else {
        wait_until_wanted(p);
    }
}

/* A web server that was waited for may bring a video that can be moved in. */
static void take_kind(struct pull *p)
{
    struct settings_store *settings = &p->shared->settings;

    if ((int)source_kind(p->t->source) == atomic_load(&settings->source_kind))
        return;
    atomic_store(&settings->source_kind, source_kind(p->t->source));
    atomic_store(&settings->source_length, source_count(p->t->source));
    status_set_kind(&p->shared->status, p->shared);
}

/* Publishes the frame that was read, or reports why there is none. */
static void take_frame(struct pull *p, enum err read)
{
    static const struct server_ticket none = { 0 };
    struct status_board *status = &p->shared->status;
    const uint64_t length = source_count(p->t->source), version = settings_now(&p->shared->settings).light_version;
    enum err e = read;

    if (!e) {
        const struct frame before = p->frame;

        p->frame = p->coming;
        p->coming = before;
        e = glide_take(p->t, &p->frame, &p->shown, p->why);
        if (!e)
            e = ingest_frame(p->t, p->shown, &none, p->why);
    }
    p->version = version;
    p->count++;
    p->used += !e;
    if (p->count == 1) {
        /* After the first frame, which was read while the scene was loading. */
        ingest_wait_prepared(p->t);
        relight(p);
        p->next_ms = clock_ms();
    }
    if (e && p->used == 0 && p->count == length)
        log_error("none of the %" PRIu64 " frames of --source %s can be used: there is no image until one can", length,
                  p->shared->config.setup.source_desc.spec);
    if (e) /* log each bad file in the first pass only */
        status_frame_unreadable(status, p->why->text, length == 0 || p->count <= length);
    else if (p->failed || p->count == 1 || p->reported_end || p->lost)
        status_set_source(status, p->paused ? SERVER_PAUSED : SERVER_LIVE, "");
    p->failed = e != ERR_OK;
    p->lost = false;
    p->ended = !e && length == 1 && !p->shared->config.setup.reseed; /* a single image need not be read again */
    p->reported_end = false;
}

/* Nothing new in a watched folder or from a live stream. */
static void go_on_without(struct pull *p)
{
    static const struct server_ticket none = { 0 };
    const struct frame *between = p->paused ? NULL : glide_step(p->t);

    ingest_wait_prepared(p->t);
    report_silence(p);
    if (between && !ingest_frame(p->t, between, &none, p->why))
        p->shown = between;
    relight(p);
}

void ingest_from_source(struct ingest_thread *t, struct reason *why)
{
    struct shared *shared = t->shared;
    struct pull p = { .t = t, .shared = shared, .why = why, .next_ms = clock_ms() };

    p.version = settings_now(&shared->settings).light_version;
    p.shown = &p.frame;
    while (!shared_is_stopping(shared)) {
        if (!wants_frame(&p))
            continue;
        source_set_wait(t->source, glide_wait_ms(t, SOURCE_WAIT_MS));
        const enum err e = source_next(t->source, &p.coming, why);
        const bool moved = p.moved;
        p.moved = false;
        take_kind(&p);
        if (e == ERR_END) {
            p.ended = true;
            continue;
        }
        if (!e && p.coming.kind == FRAME_NONE) {
            go_on_without(&p);
            continue;
        }
        take_frame(&p, e);
        if (!p.ended && !(moved && p.paused))
            pace(&p);
    }
    frame_finish(&p.frame);
    frame_finish(&p.coming);
}
