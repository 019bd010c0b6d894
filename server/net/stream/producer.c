#include "net/stream/internal.h"

#include "base/log.h"
#include "image/codec/exr_policy.h"

#include <stdio.h>
#include <string.h>

/* Whether a new producer may replace this one: it makes the same sequence (a reconnect), or this one is silent. */
static bool may_replace(const struct viewer *old, const struct sequence *wanted, int64_t now_us)
{
    return (wanted && old->sequence == wanted) || now_us - old->heard_us > STREAM_SILENT_US;
}

static void replace(struct viewer *old)
{
    struct fault fault;

    producer_leave(old);
    fault_say(&fault, FAULT_SUPERSEDED, "4.1.7", "another producer has taken over");
    viewer_send_error(old, &fault);
}

void producer_hello(struct viewer *v, const struct message *m, struct welcome *w, struct fault *fault)
{
    struct server *s = v->server;
    const int64_t now = viewer_now_us();
    struct sequence *q = NULL;

    if (m->hello.lockstep) {
        q = ingest_sequence(s, m->hello.sequence, v->guest->visitor, now);
        if (!q) {
            fault_say(fault, FAULT_BUSY, "4.1.5", "all %d sequences are in use", INGEST_SEQUENCES);
            return;
        }
    }
    if (s->producer && !may_replace(s->producer, q, now)) {
        fault_say(fault, FAULT_BUSY, "4.1.7", "another producer is connected");
        return;
    }
    if (s->producer)
        replace(s->producer);
    s->producer = v;
    v->producing = true;
    v->sequence = q;
    v->assembly.limit = s->max_frame_bytes;
    if (q)
        q->producer = v;
    ingest_attach(s, v->id, q);
    v->credit = !q ? INGEST_CREDIT : ingest_may_grant(s, q) ? 1 : 0;
    w->producer = true;
    w->has_after = q && q->has_accepted; /* this thread alone accepts: no lock */
    w->after = q ? q->accepted : 0;
    w->credit = v->credit;
    w->frame_bytes = s->max_frame_bytes;
    log_debug("%s: a producer, %s%s", v->peer, q ? "lockstep, sequence " : "live", q ? q->name : "");
}

void producer_leave(struct viewer *v)
{
    struct server *s = v->server;

    if (v->assembly.under_way)
        atomic_fetch_add(&s->counts.frames_cut, 1);
    assembly_finish(&v->assembly);
    lws_sul_cancel(&v->grant);
    if (!v->producing)
        return;
    v->producing = false;
    s->producer = NULL;
    if (v->sequence) {
        v->sequence->producer = NULL;
        v->sequence->touched_us = viewer_now_us();
        v->sequence = NULL;
    }
    ingest_detach(s, v->id);
}

/* A malformed frame closes the connection, because the start of the next one cannot be found. */
static void give_up(struct viewer *v, const struct fault *fault)
{
    atomic_fetch_add(&v->server->counts.frames_cut, 1);
    v->assembly.under_way = false;
    viewer_send_error(v, fault);
    producer_leave(v);
}

/* Formats that are not accepted from the network. */
static enum fault_code inspect(const struct assembly *a, struct fault *fault)
{
    const struct protocol_environment *h = &a->header;
    const uint8_t *bytes = a->payload.bytes;
    struct reason why = { "" };
    char name[40];

    fault->code = FAULT_NONE;
    snprintf(name, sizeof(name), "frame %llu", (unsigned long long)h->frame);
    if (h->encoding == PROTOCOL_RAW_HALF || h->encoding == PROTOCOL_RAW_FLOAT)
        return FAULT_NONE;
    if (h->flags & PROTOCOL_BOTTOM_FIRST && h->layout != PROTOCOL_LAYOUT_AUTO && h->layout != PROTOCOL_LATLONG)
        return fault_say(fault, FAULT_BAD_FRAME, "7.10", "%s: of files only a lat-long may be bottom first", name);
    if (h->encoding == PROTOCOL_FILE_EXR) {
        if (exr_policy_check(bytes, h->payload, name, &why))
            fault_say(fault, FAULT_BAD_FRAME, "7.10", "%s", why.text);
    } else if (h->payload < 2 || memcmp(bytes, "#?", 2) != 0) {
        fault_say(fault, FAULT_BAD_FRAME, "7.10", "%s: not a Radiance file", name);
    }
    return fault->code;
}

static void deliver(struct viewer *v)
{
    struct fault fault;
    const bool refused = inspect(&v->assembly, &fault) != FAULT_NONE;

    v->assembly.whole = false;
    ingest_deliver(v->server, &v->assembly, v->id, v->peer, v->sequence, refused ? &fault : NULL);
    producers_send(v->server);
}

void producer_receive(struct viewer *v, const uint8_t *in, size_t length, size_t coming, bool last)
{
    struct fault fault;

    atomic_fetch_add(&v->server->counts.frame_bytes, length);
    if (!v->assembly.under_way) {
        if (v->credit == 0) {
            fault_say(&fault, FAULT_NO_CREDIT, "5.7", "a frame was sent without credit for it");
            give_up(v, &fault);
            return;
        }
        v->credit--;
        v->frame_us = viewer_now_us();
        if (!v->assembly.payload.bytes)
            ingest_spare(v->server, &v->assembly.payload);
    }
    if (assembly_add(&v->assembly, in, length, coming, last, &fault))
        give_up(v, &fault);
    else if (v->assembly.whole)
        deliver(v);
}

void producer_tick(struct viewer *v, int64_t now_us)
{
    struct fault fault;

    if (!v->assembly.under_way || now_us - v->frame_us <= (int64_t)v->server->frame_ms * 1000)
        return;
    fault_say(&fault, FAULT_TOO_SLOW, "7.9", "a frame was not complete after %g s", v->server->frame_ms / 1000.0);
    give_up(v, &fault);
}

static void grant_later(lws_sorted_usec_list_t *sul)
{
    producers_send(lws_container_of(sul, struct viewer, grant)->server);
}

/* Grants the producer the credit that is due, at limited rate. */
static void grant(struct viewer *v)
{
    struct server *s = v->server;
    const int64_t wait = v->granted_us + STREAM_GRANT_US - viewer_now_us();
    uint32_t frames;

    if (!v->sequence && wait > 0) {
        lws_sul_schedule(s->context, 0, &v->grant, grant_later, wait);
        return;
    }
    if (v->sequence)
        frames = v->credit == 0 && !v->assembly.under_way && ingest_may_grant(s, v->sequence) ? 1 : 0;
    else
        frames = ingest_returned(s);
    if (frames == 0)
        return;
    v->granted_us = viewer_now_us();
    v->credit += frames;
    viewer_queue(v, message_credit(frames));
}

void producers_send(struct server *s)
{
    struct note notes[INGEST_NOTES];
    const unsigned count = ingest_notes(s, notes);

    for (unsigned i = 0; i < count; i++) {
        const struct note *n = &notes[i];
        struct viewer *v = s->producer;
        /* The fate of a lockstep frame goes to the present producer of that sequence. */
        if (v && (n->sequence ? n->sequence == v->sequence : n->producer == v->id))
            viewer_queue(v, message_fate(n->number, n->fate, n->picture, &n->fault));
    }
    if (s->producer && !s->producer->close_code)
        grant(s->producer);
}
