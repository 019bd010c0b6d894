#include "net/stream/internal.h"

#include "base/log.h"
#include "image/codec/decode.h"

#include <stdio.h>
#include <string.h>

/* Whether a new producer may replace this one: it makes the same sequence (a reconnect), or this one is silent. */
static bool may_replace(const struct websocket *old, const char *wanted, int64_t now_us)
{
    return (wanted && old->sequence && strcmp(old->sequence->name, wanted) == 0) ||
           now_us - old->heard_us > STREAM_SILENT_US;
}

static void replace(struct websocket *old)
{
    struct fault fault;

    producer_leave(old);
    fault_say(&fault, FAULT_SUPERSEDED, "4.1.7", "another producer has taken over");
    websocket_send_error(old, &fault);
}

void producer_hello(struct websocket *ws, const struct message *m, struct welcome *w, struct fault *fault)
{
    struct server *s = ws->server;
    const int64_t now = stream_now_us();
    struct sequence *q = NULL;

    /* A refused hello takes no name: another sequence would have to be forgotten for it. */
    if (s->producer && !may_replace(s->producer, m->hello.lockstep ? m->hello.sequence : NULL, now)) {
        fault_say(fault, FAULT_BUSY, "4.1.7", "another producer is connected");
        return;
    }
    if (m->hello.lockstep) {
        q = ingest_sequence(s, m->hello.sequence, ws->connection->client, now);
        if (!q) {
            fault_say(fault, FAULT_BUSY, "4.1.5", "all %d sequences are in use", INGEST_SEQUENCES);
            return;
        }
    }
    if (s->producer)
        replace(s->producer);
    s->producer = ws;
    ws->producing = true;
    ws->sequence = q;
    ws->assembly.limit = s->max_frame_bytes;
    if (q)
        q->producer = ws;
    ingest_attach(s, ws->id, q);
    ws->credit = !q ? INGEST_CREDIT : ingest_may_grant(s, q) ? 1 : 0;
    w->producer = true;
    w->has_after = q && q->has_accepted; /* this thread alone accepts: no lock */
    w->after = q ? q->accepted : 0;
    w->credit = ws->credit;
    w->frame_bytes = s->max_frame_bytes;
    log_debug("%s: a producer, %s%s", ws->peer, q ? "lockstep, sequence " : "live", q ? q->name : "");
}

void producer_leave(struct websocket *ws)
{
    struct server *s = ws->server;

    if (ws->assembly.under_way)
        atomic_fetch_add(&s->counts.frames_cut, 1);
    assembly_finish(&ws->assembly);
    lws_sul_cancel(&ws->grant);
    if (!ws->producing)
        return;
    ws->producing = false;
    s->producer = NULL;
    if (ws->sequence) {
        ws->sequence->producer = NULL;
        ws->sequence->touched_us = stream_now_us();
        ws->sequence = NULL;
    }
    ingest_detach(s, ws->id);
}

/* A malformed frame closes the connection, because the start of the next one cannot be found. */
static void give_up(struct websocket *ws, const struct fault *fault)
{
    atomic_fetch_add(&ws->server->counts.frames_cut, 1);
    ws->assembly.under_way = false;
    websocket_send_error(ws, fault);
    producer_leave(ws);
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

static void deliver(struct websocket *ws)
{
    struct fault fault;
    const bool refused = inspect(&ws->assembly, &fault) != FAULT_NONE;

    ws->assembly.whole = false;
    ingest_deliver(ws->server, &ws->assembly, ws->id, ws->peer, ws->sequence, refused ? &fault : NULL);
    producers_send(ws->server);
}

void producer_receive(struct websocket *ws, const uint8_t *in, size_t length, size_t coming, bool last)
{
    struct fault fault;

    atomic_fetch_add(&ws->server->counts.frame_bytes, length);
    if (!ws->assembly.under_way) {
        if (ws->credit == 0) {
            fault_say(&fault, FAULT_NO_CREDIT, "5.7", "a frame was sent without credit for it");
            give_up(ws, &fault);
            return;
        }
        ws->credit--;
        ws->frame_us = stream_now_us();
        if (!ws->assembly.payload.bytes)
            ingest_spare(ws->server, &ws->assembly.payload);
    }
    if (assembly_add(&ws->assembly, in, length, coming, last, &fault))
        give_up(ws, &fault);
    else if (ws->assembly.whole)
        deliver(ws);
}

void producer_tick(struct websocket *ws, int64_t now_us)
{
    struct fault fault;

    if (!ws->assembly.under_way || now_us - ws->frame_us <= (int64_t)ws->server->frame_ms * 1000)
        return;
    fault_say(&fault, FAULT_TOO_SLOW, "7.9", "a frame was not complete after %g s", ws->server->frame_ms / 1000.0);
    give_up(ws, &fault);
}

static void grant_later(lws_sorted_usec_list_t *sul)
{
    producers_send(lws_container_of(sul, struct websocket, grant)->server);
}

/* The credit to grant to the producer now, at limited rate. */
static uint32_t credit_due(struct websocket *ws)
{
    struct server *s = ws->server;
    const int64_t wait = ws->granted_us + STREAM_GRANT_US - stream_now_us();

    if (ws->sequence)
        return ws->credit == 0 && !ws->assembly.under_way && ingest_may_grant(s, ws->sequence) ? 1 : 0;
    if (wait <= 0)
        return ingest_returned(s);
    lws_sul_schedule(s->context, 0, &ws->grant, grant_later, wait);
    return 0;
}

void producers_send(struct server *s)
{
    struct note notes[INGEST_NOTES];
    struct websocket *ws = s->producer;
    /* Before the fates are taken: that of a frame which ends meanwhile must not come after its credit. */
    const uint32_t frames = ws && !ws->close_code ? credit_due(ws) : 0;
    const unsigned count = ingest_notes(s, notes);

    for (unsigned i = 0; i < count; i++) {
        const struct note *n = &notes[i];
        /* The fate of a lockstep frame goes to the present producer of that sequence. */
        if (ws && (n->sequence ? n->sequence == ws->sequence : n->producer == ws->id))
            websocket_queue(ws, message_fate(n->number, n->fate, n->picture, &n->fault));
    }
    if (frames == 0)
        return;
    ws->granted_us = stream_now_us();
    ws->credit += frames;
    websocket_queue(ws, message_credit(frames));
}
