/* server/relightd_ingest.c */
/* The ingest thread: frames of the source or of a producer, decoded and with their sampling tables, one after another
 * as the source's pace has it; and what controllers ask of time: to hold, to step, to go to another place. */
#include "relightd.h"

#include "clock.h"
#include "log.h"
#include "mem.h"

#include <omp.h>
#include <time.h>

#define MARGIN_MS 2    /* a frame is ready by so much before it is wanted: what it would wait longer, it ages */
#define UNSEEN_MS 1000 /* between frames of a computed sky that nobody sees: as between pictures then */
#define LOOK_MS 20     /* between two looks whether somebody has come */

static void nap_ms(int64_t ms)
{
    nanosleep(&(struct timespec){ .tv_nsec = (long)ms * 1000000 }, NULL);
}

/* ---- Producers' files ---- */

enum err daemon_decoder_begin(struct daemon *d, const atomic_bool *stop, struct reason *why)
{
    if (!d->push)
        return ERR_OK;
    if (d->no_sandbox) {
        log_warning(
            "--no-sandbox: files that producers send are decoded in this process; whoever can send one that its "
            "decoders do not survive ends it, or takes it over");
        return ERR_OK;
    }
    d->decoder_desc.stop = stop;
    const enum err e = decoder_create(&d->decoder_desc, &d->decoder, why);
    if (!e && !decoder_is_confined(d->decoder))
        log_warning("this kernel grants no seccomp: the process that decodes producers' files is limited in memory and "
                    "files, but not in what it may ask of the system");
    return e;
}

void daemon_decoder_end(struct daemon *d)
{
    decoder_destroy(d->decoder);
    d->decoder = NULL;
}

static void tell_decoder(struct daemon *d)
{
    struct decoder_counts c;

    if (!d->decoder)
        return;
    decoder_counts(d->decoder, &c);
    server_set_decoder(d->server, &(struct server_decoder){ true, decoder_is_confined(d->decoder), c.files, c.died,
                                                            c.hung, c.lied, c.waited, c.starts });
}

/* ---- Any source ---- */

/* Where in the source the frame stood, for those who are told. */
static void note_place(struct daemon *d, struct ingested *in)
{
    in->position = d->source ? source_position(d->source) : 0;
    in->has_sky = d->source && source_sky(d->source);
    if (in->has_sky)
        in->sky = *source_sky(d->source);
}

/* What a slot that is seldom used has kept of a far larger frame than those of late. */
static void forget_idle(struct daemon *d, int slot)
{
    const struct recent *recent = &d->ingested[slot].environment->image.recent;

    for (int i = 0; i < HANDOFF_SLOTS; i++) {
        struct environment *e = d->ingested[i].environment;
        if (i != slot && handoff_is_idle(&d->frames, i) &&
            recent_is_outgrown(recent, e->image.capacity * sizeof(*e->image.rgb)))
            environment_forget(e);
    }
}

static enum err ingest_frame(struct daemon *d, const struct frame *f, const struct server_ticket *ticket,
                             struct reason *why)
{
    const int slot = handoff_begin(&d->frames);
    struct ingested *in = &d->ingested[slot];
    const struct settings now = ticket->lockstep ? d->said : daemon_settings(d);
    const struct image_decoder decoder = { decoder_decode, d->decoder };
    const struct environment_desc desc = { .layout = d->layout,
                                           .decoder = d->decoder ? &decoder : NULL,
                                           .rotation_degrees = now.rotation_degrees,
                                           .scale_stops = now.scale_stops,
                                           .importance = d->importance,
                                           .most_side = d->most_side,
                                           .lean = now.method == METHOD_CACHED };
    const double start = clock_seconds();

    atomic_store(&d->reading, true); /* all processors for what is new */
    atomic_store(d->stirred, true);
    environment_set(in->environment, &desc);
    const enum err e = environment_update(in->environment, f, why);
    in->environment->decoder = NULL; /* it ends with this block */
    atomic_store(&d->reading, false);
    tell_decoder(d);
    if (e)
        return e;
    environment_warn_clipped(in->environment, &d->warned_clipped);
    in->ticket = *ticket;
    in->decode_ms = 1e3 * (clock_seconds() - start);
    note_place(d, in);
    forget_idle(d, slot);
    in->ready_ms = clock_ms();
    const struct image_faults faults = in->environment->image.faults; /* the slot is the reader's once published */
    const int dropped = handoff_publish(&d->frames, slot);
    atomic_store(d->stirred, true);
    if (dropped != HANDOFF_NONE)
        server_frame_fate(d->server, &d->ingested[dropped].ticket, SERVER_SUPERSEDED, NULL);
    daemon_tell_received(d, &faults, dropped != HANDOFF_NONE);
    return ERR_OK;
}

/* What viewers are told while no frame comes. */
static enum server_source tell_silence(struct daemon *d, enum server_source told)
{
    struct server_demand demand;

    server_demand(d->server, &demand);
    const enum server_source now = demand.ended ? SERVER_ENDED : demand.producer ? told : SERVER_WAITING;
    if (told == SERVER_LIVE && now != told) {
        if (demand.ended)
            daemon_tell_source(d, now, "the producer has sent all its frames");
        else
            daemon_tell_gone(d);
        return now;
    }
    return told;
}

/* Changed settings are applied to the frame that stands, once. */
static void relight_standing(struct daemon *d, const struct frame *f, uint64_t version, uint64_t *seen,
                             struct reason *why)
{
    static const struct server_ticket none = { 0 };

    if (version != *seen && f->kind != FRAME_NONE && ingest_frame(d, f, &none, why))
        daemon_tell_refused(d, why->text, true);
    *seen = version;
}

/* Frames from the outside: each one's fate is told to its producer. */
static void ingest_pushed(struct daemon *d, struct frame *f, struct reason *why)
{
    struct server_ticket ticket = { 0 };
    enum server_source told = SERVER_WAITING;
    uint64_t version = 0;

    while (!daemon_is_stopping(d)) {
        const struct settings now = daemon_settings(d);
        if (!ticket.lockstep)
            relight_standing(d, f, now.version, &version, why);
        if (now.paused) {
            nap_ms(30);
            continue;
        }
        if (!server_take_frame(d->server, f, &ticket, 100)) {
            told = tell_silence(d, told);
            continue;
        }
        version = now.version;
        if (ingest_frame(d, f, &ticket, why)) {
            server_frame_fate(d->server, &ticket, SERVER_REFUSED, why->text);
            daemon_tell_refused(d, why->text, true);
            told = SERVER_FAILED;
        } else if (told != SERVER_LIVE) {
            daemon_tell_source(d, SERVER_LIVE, "");
            told = SERVER_LIVE;
        }
    }
}

/* What the ingest thread remembers of a source between its frames. */
struct pull {
    struct frame frame;  /* the one that stands; kind FRAME_NONE before the first */
    struct frame coming; /* where the next one is read into */
    uint64_t count;      /* frames asked for */
    uint64_t version;    /* of the settings, as the frame that stands was read with */
    int64_t next_ms;     /* when the next frame is due, if the source has a pace */
    int64_t failure_ms;  /* how long to wait after a frame that could not be used: doubles up to a second */
    bool failed, ended, told_end, paused;
    bool moved; /* the next frame was asked for by itself: it is read though the source is held */
};

/* What controllers have asked for of the source's place since the last look. */
static void take_moves(struct daemon *d, struct pull *p)
{
    const struct moves m = daemon_take_moves(d);
    bool moved = false;

    if (m.has_hour && source_sky(d->source))
        moved = source_set_hour(d->source, m.hour + source_sky(d->source)->speed_hours * (double)m.step);
    else if (m.has_seek)
        moved = source_seek(d->source, m.seek);
    else if (m.step != 0)
        moved = source_step(d->source, m.step);
    p->moved |= moved;
}

/* Without a next frame, changed settings are applied to the one that stands. True when there may be a next one. */
static bool hold(struct daemon *d, struct pull *p, struct reason *why)
{
    const struct settings now = daemon_settings(d);

    take_moves(d, p);
    if (!p->ended && now.paused != p->paused && p->count > 0)
        daemon_tell_source(d, now.paused ? SERVER_PAUSED : SERVER_LIVE, "");
    p->paused = now.paused;
    if (p->moved || (!p->ended && !now.paused))
        return true;
    relight_standing(d, &p->frame, now.version, &p->version, why);
    if (p->ended && !p->told_end && !p->failed && daemon_all_shown(d)) {
        daemon_tell_source(d, SERVER_ENDED, p->count == 1 ? "it is one picture" : "the last frame was shown");
        p->told_end = true;
    }
    nap_ms(30);
    return false;
}

/* Whether the wait for the next frame is over before its time. */
static bool is_disturbed(struct daemon *d)
{
    return daemon_is_stopping(d) || daemon_moves_wait(d) || daemon_settings(d).paused;
}

/* In short naps, so that whoever asks for something is answered at once. */
static void sleep_until_ms(struct daemon *d, struct pull *p, int64_t when_ms, struct reason *why)
{
    for (int64_t left = when_ms - clock_ms(); left > 0 && !is_disturbed(d); left = when_ms - clock_ms()) {
        nap_ms(left < 50 ? left : 50);
        if (d->rate > 0.0 && !p->failed)
            relight_standing(d, &p->frame, daemon_settings(d).version, &p->version, why);
    }
}

/* A source that sets no pace gives its next frame just before the shading of this one ends: earlier, it would only grow
 * old while it waits. */
static void wait_until_wanted(struct daemon *d, struct pull *p, struct reason *why)
{
    while (!handoff_wait_taken(&d->frames, 100) && !is_disturbed(d))
        continue;
    sleep_until_ms(d, p, clock_ms() + (int64_t)daemon_slack_ms(d) - MARGIN_MS, why);
}

static bool is_seen(struct daemon *d)
{
    struct server_demand demand;

    server_demand(d->server, &demand);
    return demand.viewers > 0 || demand.recorder;
}

/* Frames of a sky that nobody sees need not be computed: after a second, or once somebody comes, the next one is that
 * of then, as though those between had been. Files are read all the same, for who counts them. */
static void rest_unseen(struct daemon *d, struct pull *p, struct reason *why)
{
    const int64_t each_ms = (int64_t)(1e3 / d->rate), until_ms = p->next_ms + UNSEEN_MS - each_ms;

    if (d->kind != SOURCE_SKY || d->length > 0 || is_seen(d))
        return;
    while (clock_ms() < until_ms && !is_seen(d) && !is_disturbed(d))
        sleep_until_ms(d, p, clock_ms() + LOOK_MS, why);
    const int64_t passed = (clock_ms() - p->next_ms) / each_ms;
    if (passed > 0 && !is_disturbed(d) && source_step(d->source, 1 + passed))
        p->next_ms += passed * each_ms;
}

static void pace(struct daemon *d, struct pull *p, struct reason *why)
{
    const int64_t now = clock_ms();

    if (p->failed) { /* a source without a good frame must not turn at full speed */
        p->failure_ms = p->failure_ms ? 2 * p->failure_ms : 100;
        p->failure_ms = p->failure_ms < 1000 ? p->failure_ms : 1000;
        sleep_until_ms(d, p, now + (d->rate > 0.0 ? (int64_t)(1e3 / d->rate) : p->failure_ms), why);
        return;
    }
    p->failure_ms = 0;
    if (d->rate > 0.0) {
        p->next_ms += (int64_t)(1e3 / d->rate);
        p->next_ms = p->next_ms > now ? p->next_ms : now;
        sleep_until_ms(d, p, p->next_ms, why);
        rest_unseen(d, p, why);
    } else {
        wait_until_wanted(d, p, why);
    }
}

/* What was read becomes the frame that stands. */
static void stand(struct pull *p)
{
    const struct frame before = p->frame;

    p->frame = p->coming;
    p->coming = before;
}

static void take_frame(struct daemon *d, struct pull *p, enum err read, struct reason *why)
{
    static const struct server_ticket none = { 0 };
    const uint64_t in_a_pass = source_count(d->source), version = daemon_settings(d).version;
    enum err e = read;

    if (!e) {
        stand(p);
        e = ingest_frame(d, &p->frame, &none, why);
    }
    p->count++;
    if (e) /* what every pass would say again is said in the first */
        daemon_tell_refused(d, why->text, in_a_pass == 0 || p->count <= in_a_pass);
    else if (p->failed || p->count == 1 || p->told_end)
        daemon_tell_source(d, p->paused ? SERVER_PAUSED : SERVER_LIVE, "");
    p->failed = e != ERR_OK;
    p->ended = !e && in_a_pass == 1 && !d->reseed; /* one picture need not be read again */
    p->told_end = false;
    p->version = version;
}

static void ingest_source(struct daemon *d, struct reason *why)
{
    struct pull p = { .next_ms = clock_ms(), .version = daemon_settings(d).version };

    while (!daemon_is_stopping(d)) {
        if (!hold(d, &p, why))
            continue;
        const enum err e = source_next(d->source, &p.coming, why);
        const bool moved = p.moved;
        p.moved = false;
        if (e == ERR_END) {
            p.ended = true;
            continue;
        }
        if (!e && p.coming.kind == FRAME_NONE) { /* nothing new in a watched folder */
            relight_standing(d, &p.frame, daemon_settings(d).version, &p.version, why);
            continue;
        }
        take_frame(d, &p, e, why);
        if (!p.ended && !(moved && p.paused))
            pace(d, &p, why);
    }
    frame_finish(&p.frame);
    frame_finish(&p.coming);
}

void *daemon_ingest_main(void *arg)
{
    struct daemon *d = arg;
    struct frame f = { 0 };
    struct reason why = { "" };

    omp_set_num_threads(1); /* the other processor is shading */
    if (d->push)
        ingest_pushed(d, &f, &why);
    else
        ingest_source(d, &why);
    frame_finish(&f);
    return NULL;
}
