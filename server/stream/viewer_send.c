#include "internal.h"

#include "clock.h"
#include "log.h"

#include <stdio.h>
#include <string.h>

void viewer_want(struct viewer *v)
{
    if (!v->waiting) {
        v->waiting = true;
        v->moved_us = viewer_now_us();
    }
    lws_callback_on_writable(v->wsi);
}

void viewer_part(struct viewer *v, uint16_t code, const char *text)
{
    if (v->close_code)
        return;
    v->close_code = code;
    snprintf(v->close_text, sizeof(v->close_text), "%s", text);
    viewer_want(v);
}

void viewer_complain(struct viewer *v, const struct fault *fault)
{
    atomic_fetch_add(&v->server->counts.errors, 1);
    atomic_fetch_add(&v->server->metrics.faults[fault->code], 1);
    log_debug("%s: %s (clause %s): %s", v->peer, fault_name(fault->code), fault->clause, fault->text);
    if (v->outbox_count < STREAM_OUTBOX)
        viewer_say(v, message_error(fault));
    if (fault_close_code(fault)) {
        char text[FAULT_REASON];
        viewer_part(v, fault_close_code(fault), fault_reason(fault, text));
    }
}

void viewer_say(struct viewer *v, char *text)
{
    struct fault fault;

    if (text && v->outbox_count == STREAM_OUTBOX) {
        message_free(text);
        fault_say(&fault, FAULT_TOO_FAST, "2.5", "answers wait and are not read");
        viewer_complain(v, &fault);
    } else if (text) {
        v->outbox[v->outbox_count++] = text;
        viewer_want(v);
    }
}

/* The newest picture of the viewer's format, as a new reference, if it has not begun to get it yet. */
struct picture *viewer_next_picture(struct viewer *v)
{
    struct server *s = v->server;
    struct picture *p = NULL;

    if (v->recorder) { /* all of its sequence and nothing else: there is one at a time */
        p = v->sequence ? ingest_kept(s, v->sequence) : NULL;
        if (p && picture_header(p)->sequence <= v->begun) {
            picture_unref(p);
            p = NULL;
        }
        return p;
    }
    pthread_mutex_lock(&s->lock);
    struct picture *next = v->kind >= STREAM_TRACKS ? chain_next(s, v) : s->latest[v->kind];
    if (next && picture_header(next)->sequence > v->begun)
        p = picture_ref(next);
    pthread_mutex_unlock(&s->lock);
    return p;
}

static void pace_over(lws_sorted_usec_list_t *sul)
{
    struct viewer *v = lws_container_of(sul, struct viewer, pace);

    viewer_want(v);
}

/* Whether the viewer has credit for the picture that it gets next. H.264 that has none to go on with asks for one. */
static bool has_picture(struct viewer *v)
{
    const bool video = v->wish.subscribe.format == PROTOCOL_H264;

    if (v->unacked_count >= (video ? PROTOCOL_CREDIT_H264 : PROTOCOL_CREDIT))
        return false;
    struct picture *p = viewer_next_picture(v);
    bool may = p != NULL;
    if (video) {
        pthread_mutex_lock(&v->server->lock);
        may = p && chain_may_begin(v->server, v, p);
        if (!p)
            chain_ask(v->server, v);
        pthread_mutex_unlock(&v->server->lock);
    }
    picture_unref(p);
    return may;
}

/* Whether a picture may begin now. Comes back by itself when only the viewer's rate stands against it. */
bool viewer_may_begin(struct viewer *v)
{
    if (v->current || v->close_code || !v->subscribed || v->wish.subscribe.paused || !has_picture(v))
        return false;
    const int64_t wait = v->due_us - viewer_now_us();
    if (wait > 0)
        lws_sul_schedule(v->server->context, 0, &v->pace, pace_over, wait);
    return wait <= 0;
}

static void begin_picture(struct viewer *v)
{
    struct picture *p = viewer_next_picture(v);

    if (!p)
        return;
    const struct protocol_picture *header = picture_header(p);
    /* Of a chain none can be left out; its track has the rate. */
    const double rate = header->format == PROTOCOL_H264 ? 0.0 : v->wish.subscribe.max_rate;
    if (v->begun > 0 && !v->recorder) { /* between those of a recorder are pictures that were never its own */
        const uint64_t skipped = header->sequence - v->begun - 1;
        v->skipped += skipped;
        atomic_fetch_add(&v->server->counts.skipped, skipped);
        atomic_fetch_add(rate > 0.0 ? &v->server->metrics.skipped_rate : &v->server->metrics.skipped_slow, skipped);
    }
    if (rate > 0.0) {
        /* Late by less than one interval is made up for, so that the average holds. */
        const int64_t interval = (int64_t)(1e6 / rate), now = viewer_now_us();
        v->due_us = (v->due_us > now - interval ? v->due_us : now) + interval;
    }
    v->begun = header->sequence;
    v->chained = true;
    v->repeated = picture_placed_us(p) < v->since_us;
    v->unacked[v->unacked_count].sequence = header->sequence;
    v->unacked[v->unacked_count++].placed_us = picture_placed_us(p);
    v->current = p;
    v->offset = 0;
}

static int send_fragment(struct viewer *v)
{
    size_t size;
    const uint8_t *message = picture_message(v->current, &size);
    const size_t left = size - v->offset, piece = left < STREAM_CHUNK ? left : STREAM_CHUNK;
    uint8_t *out = v->staging + LWS_PRE;

    memcpy(out, message + v->offset, piece);
    if (v->offset == 0 && v->repeated)
        out[PROTOCOL_PICTURE_FLAGS_AT] |= PROTOCOL_PICTURE_REPEAT;
    if (lws_write(v->wsi, out, piece, lws_write_ws_flags(LWS_WRITE_BINARY, v->offset == 0, piece == left)) < 0)
        return -1;
    v->offset += piece;
    atomic_fetch_add(&v->server->counts.bytes, piece);
    if (v->offset == size) {
        if (!v->repeated)
            server_observe(v->server, SERVER_SENT, 1e-6 * (double)(viewer_now_us() - picture_placed_us(v->current)));
        atomic_fetch_add(&v->server->metrics.sent[metrics_kind(picture_kind(v->current))], 1);
        picture_unref(v->current);
        v->current = NULL;
        v->sent++;
        atomic_fetch_add(&v->server->counts.sent, 1);
    }
    return 0;
}

static int send_text(struct viewer *v, const char *text)
{
    const size_t size = strlen(text);

    if (size > STREAM_CHUNK)
        return -1;
    memcpy(v->staging + LWS_PRE, text, size);
    return lws_write(v->wsi, v->staging + LWS_PRE, size, LWS_WRITE_TEXT) < 0 ? -1 : 0;
}

static int send_outbox(struct viewer *v)
{
    char *text = v->outbox[0];

    v->outbox_count--;
    memmove(v->outbox, v->outbox + 1, v->outbox_count * sizeof(v->outbox[0]));
    const int result = send_text(v, text);
    message_free(text);
    return result;
}

static int send_status(struct viewer *v)
{
    struct server *s = v->server;

    v->status_due = false;
    pthread_mutex_lock(&s->lock);
    char *text = message_status(s->status, clock_wall_us(), s->demand.viewers, v->sent, v->skipped);
    pthread_mutex_unlock(&s->lock);
    const int result = text ? send_text(v, text) : 0;
    message_free(text);
    return result;
}

static int send_control(struct viewer *v)
{
    char *text = control_text(v);
    const int result = text ? send_text(v, text) : 0;

    message_free(text);
    return result;
}

static int send_radiance(struct viewer *v)
{
    char *text = probe_text(v);
    const int result = text ? send_text(v, text) : 0;

    message_free(text);
    return result;
}

static int say_goodbye(struct viewer *v)
{
    lws_close_reason(v->wsi, (enum lws_close_status)v->close_code, (unsigned char *)v->close_text,
                     strlen(v->close_text));
    return -1;
}

/* One write per call, as lws wants it. Between the fragments of a picture only a close frame may go. */
int viewer_write(struct viewer *v)
{
    int result = 0;

    v->waiting = false;
    if (v->close_code && (v->current || v->outbox_count == 0))
        return say_goodbye(v);
    if (!v->current && v->outbox_count > 0) {
        result = send_outbox(v);
    } else if (!v->current && v->status_due) {
        result = send_status(v);
    } else if (!v->current && control_due(v)) {
        result = send_control(v);
    } else if (!v->current && probe_due(v)) {
        result = send_radiance(v);
    } else {
        if (viewer_may_begin(v))
            begin_picture(v);
        if (v->current)
            result = send_fragment(v);
    }
    if (result == 0 && (v->current || v->outbox_count > 0 || v->status_due || control_due(v) || probe_due(v) ||
                        v->close_code || viewer_may_begin(v)))
        viewer_want(v);
    return result;
}
