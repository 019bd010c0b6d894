#include "net/stream/internal.h"

#include "base/clock.h"
#include "base/log.h"

#include <assert.h>
#include <stdio.h>
#include <string.h>

void viewer_request_write(struct viewer *v)
{
    if (!v->waiting) {
        v->waiting = true;
        v->moved_us = viewer_now_us();
    }
    lws_callback_on_writable(v->wsi);
}

void viewer_close(struct viewer *v, uint16_t code, const char *text)
{
    if (v->close_code)
        return;
    v->close_code = code;
    snprintf(v->close_text, sizeof(v->close_text), "%s", text);
    viewer_request_write(v);
}

static void queue(struct viewer *v, char *text)
{
    assert(v->outbox_count <= STREAM_OUTBOX);
    if (text)
        v->outbox[v->outbox_count++] = text;
    viewer_request_write(v);
}

void viewer_send_error(struct viewer *v, const struct fault *fault)
{
    atomic_fetch_add(&v->server->counts.errors, 1);
    atomic_fetch_add(&v->server->metrics.faults[fault->code], 1);
    log_debug("%s: %s (clause %s): %s", v->peer, fault_name(fault->code), fault->clause, fault->text);
    if (!fault_close_code(fault)) {
        viewer_queue(v, message_error(fault));
    } else {
        char text[FAULT_REASON];
        if (!v->close_code) /* in the place kept for it */
            queue(v, message_error(fault));
        viewer_close(v, fault_close_code(fault), fault_reason(fault, text));
    }
}

void viewer_queue(struct viewer *v, char *text)
{
    struct fault fault;

    if (v->close_code) { /* nothing follows a fatal error */
        message_free(text);
    } else if (text && v->outbox_count >= STREAM_OUTBOX) {
        message_free(text);
        fault_say(&fault, FAULT_TOO_FAST, "2.5", "too many answers wait unread");
        viewer_send_error(v, &fault);
    } else if (text) {
        queue(v, text);
    }
}

struct sent_image *viewer_next_image(struct viewer *v)
{
    struct server *s = v->server;
    struct sent_image *p = NULL;

    if (v->recorder) { /* gets its sequence's images only, one at a time */
        p = v->sequence ? ingest_kept(s, v->sequence) : NULL;
        if (p && image_header(p)->sequence <= v->begun) {
            image_unref(p);
            p = NULL;
        }
        return p;
    }
    pthread_mutex_lock(&s->lock);
    struct sent_image *next = v->kind >= STREAM_TRACKS ? chain_next(s, v) : s->latest[v->kind];
    if (next && image_header(next)->sequence > v->begun)
        p = image_ref(next);
    pthread_mutex_unlock(&s->lock);
    return p;
}

static void pace_over(lws_sorted_usec_list_t *sul)
{
    struct viewer *v = lws_container_of(sul, struct viewer, pace);

    viewer_request_write(v);
}

/* Whether the viewer has credit and a next image. Without one, an H.264 viewer requests a keyframe. */
static bool has_image(struct viewer *v)
{
    const bool video = v->wish.subscribe.format == PROTOCOL_H264;

    if (v->unacked_count >= (video ? PROTOCOL_CREDIT_H264 : PROTOCOL_CREDIT))
        return false;
    struct sent_image *p = viewer_next_image(v);
    bool may = p != NULL;
    if (video) {
        pthread_mutex_lock(&v->server->lock);
        may = p && chain_may_begin(v->server, v, p);
        if (!p)
            chain_ask(v->server, v);
        pthread_mutex_unlock(&v->server->lock);
    }
    image_unref(p);
    return may;
}

bool viewer_may_begin(struct viewer *v)
{
    if (v->current || v->close_code || !v->subscribed || v->wish.subscribe.paused || !has_image(v))
        return false;
    const int64_t wait = v->due_us - viewer_now_us();
    if (wait > 0)
        lws_sul_schedule(v->server->context, 0, &v->pace, pace_over, wait);
    return wait <= 0;
}

static void begin_image(struct viewer *v)
{
    struct sent_image *p = viewer_next_image(v);

    if (!p)
        return;
    const struct protocol_picture *header = image_header(p);
    /* No image of an H.264 chain can be left out; its track has the rate. */
    const double rate = header->format == PROTOCOL_H264 ? 0.0 : v->wish.subscribe.max_rate;
    if (v->begun > 0 && !v->recorder) { /* a recorder's numbers have gaps for images of others */
        const uint64_t skipped = header->sequence - v->begun - 1;
        v->skipped += skipped;
        atomic_fetch_add(&v->server->counts.skipped, skipped);
        atomic_fetch_add(rate > 0.0 ? &v->server->metrics.skipped_rate : &v->server->metrics.skipped_slow, skipped);
    }
    v->due_us = viewer_due(v->due_us, viewer_now_us(), rate);
    v->begun = header->sequence;
    v->chained = true;
    v->repeated = image_placed_us(p) < v->since_us;
    v->unacked[v->unacked_count].sequence = header->sequence;
    v->unacked[v->unacked_count++].placed_us = image_placed_us(p);
    v->current = p;
    v->offset = 0;
}

int64_t viewer_due(int64_t due_us, int64_t now_us, double rate)
{
    if (!(rate > 0.0))
        return due_us;
    const int64_t interval = (int64_t)(1e6 / rate);
    return (due_us > now_us - interval ? due_us : now_us) + interval;
}

static int send_fragment(struct viewer *v)
{
    size_t size;
    const uint8_t *message = image_message(v->current, &size);
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
            server_observe(v->server, SERVER_SENT, 1e-6 * (double)(viewer_now_us() - image_placed_us(v->current)));
        atomic_fetch_add(&v->server->metrics.sent[metrics_kind(image_kind(v->current))], 1);
        image_unref(v->current);
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

static int send_made(struct viewer *v, char *text)
{
    const int result = text ? send_text(v, text) : 0;

    message_free(text);
    return result;
}

static int send_outbox(struct viewer *v)
{
    char *text = v->outbox[0];

    v->outbox_count--;
    memmove(v->outbox, v->outbox + 1, v->outbox_count * sizeof(v->outbox[0]));
    return send_made(v, text);
}

static int send_status(struct viewer *v)
{
    struct server *s = v->server;

    v->status_due = false;
    pthread_mutex_lock(&s->lock);
    if (!s->status)
        s->status = message_status_shared(&s->figures, s->controls);
    char *text = s->status ? message_status(s->status, clock_wall_us(), s->demand.viewers, v->sent, v->skipped) : NULL;
    pthread_mutex_unlock(&s->lock);
    return send_made(v, text);
}

static int send_close(struct viewer *v)
{
    lws_close_reason(v->wsi, (enum lws_close_status)v->close_code, (unsigned char *)v->close_text,
                     strlen(v->close_text));
    return -1;
}

/* The text message that is due first, if any; messages to this viewer alone come before the status. */
static bool text_is_due(const struct viewer *v)
{
    return v->outbox_count > 0 || v->status_due || control_due(v) || inspect_due(v);
}

static int send_due_text(struct viewer *v)
{
    if (v->outbox_count > 0)
        return send_outbox(v);
    if (v->status_due)
        return send_status(v);
    return send_made(v, control_due(v) ? control_text(v) : inspect_text(v));
}

static int send_image(struct viewer *v)
{
    if (viewer_may_begin(v))
        begin_image(v);
    return v->current ? send_fragment(v) : 0;
}

/* libwebsockets wants one write per call. Between the fragments of an image only a close frame may go. */
int viewer_write(struct viewer *v)
{
    v->waiting = false;
    if (v->close_code && (v->current || v->outbox_count == 0))
        return send_close(v);
    const int result = !v->current && text_is_due(v) ? send_due_text(v) : send_image(v);
    if (result == 0 && (v->current || text_is_due(v) || v->close_code || viewer_may_begin(v)))
        viewer_request_write(v);
    return result;
}
