#include "net/stream/internal.h"

#include "base/clock.h"
#include "base/log.h"

#include <assert.h>
#include <stdio.h>
#include <string.h>

void websocket_request_write(struct websocket *ws)
{
    if (!ws->waiting) {
        ws->waiting = true;
        ws->moved_us = stream_now_us();
    }
    lws_callback_on_writable(ws->wsi);
}

void websocket_close(struct websocket *ws, uint16_t code, const char *text)
{
    if (ws->close_code)
        return;
    ws->close_code = code;
    snprintf(ws->close_text, sizeof(ws->close_text), "%s", text);
    websocket_request_write(ws);
}

static void queue(struct websocket *ws, char *text)
{
    assert(ws->outbox_count <= STREAM_OUTBOX);
    if (text) {
        ws->outbox[ws->outbox_count++] = text;
        ws->outbox_bytes += strlen(text);
    }
    websocket_request_write(ws);
}

void websocket_send_error(struct websocket *ws, const struct fault *fault)
{
    atomic_fetch_add(&ws->server->counts.errors, 1);
    atomic_fetch_add(&ws->server->metrics.faults[fault->code], 1);
    log_debug("%s: %s (clause %s): %s", ws->peer, fault_name(fault->code), fault->clause, fault->text);
    if (!fault_close_code(fault)) {
        websocket_queue(ws, message_error(fault));
    } else {
        char text[FAULT_REASON];
        if (!ws->close_code) /* in the place kept for it */
            queue(ws, message_error(fault));
        websocket_close(ws, fault_close_code(fault), fault_reason(fault, text));
    }
}

void websocket_queue(struct websocket *ws, char *text)
{
    struct fault fault;

    if (ws->close_code) { /* nothing follows a fatal error */
        message_free(text);
    } else if (text && ws->outbox_count >= STREAM_OUTBOX) {
        message_free(text);
        fault_say(&fault, FAULT_TOO_FAST, "2.5", "too many answers wait unread");
        websocket_send_error(ws, &fault);
    } else if (text) {
        queue(ws, text);
    }
}

struct sent_image *websocket_next_image(struct websocket *ws)
{
    struct server *s = ws->server;
    struct sent_image *p = NULL;

    if (ws->recorder) { /* gets its sequence's images only, one at a time */
        p = ws->sequence ? ingest_kept(s, ws->sequence) : NULL;
        if (p && image_header(p)->sequence <= ws->begun) {
            image_unref(p);
            p = NULL;
        }
        return p;
    }
    pthread_mutex_lock(&s->lock);
    struct sent_image *next = ws->kind >= STREAM_TRACKS ? chain_next(s, ws) : s->latest[ws->kind];
    if (next && image_header(next)->sequence > ws->begun)
        p = image_ref(next);
    pthread_mutex_unlock(&s->lock);
    return p;
}

static void pace_over(lws_sorted_usec_list_t *sul)
{
    struct websocket *ws = lws_container_of(sul, struct websocket, pace);

    websocket_request_write(ws);
}

/* Whether the viewer has credit and a next image. Without one, an H.264 viewer requests a keyframe. */
static bool has_image(struct websocket *ws)
{
    const bool video = ws->wish.subscribe.format == PROTOCOL_H264;

    if (ws->unacked_count >= (video ? PROTOCOL_CREDIT_H264 : PROTOCOL_CREDIT))
        return false;
    struct sent_image *p = websocket_next_image(ws);
    bool may = p != NULL;
    if (video) {
        pthread_mutex_lock(&ws->server->lock);
        may = p && chain_may_begin(ws->server, ws, p);
        if (!p)
            chain_ask(ws->server, ws);
        pthread_mutex_unlock(&ws->server->lock);
    }
    image_unref(p);
    return may;
}

bool websocket_may_begin(struct websocket *ws)
{
    if (ws->current || ws->close_code || !ws->subscribed || ws->wish.subscribe.paused || !has_image(ws))
        return false;
    const int64_t wait = ws->due_us - stream_now_us();
    if (wait > 0)
        lws_sul_schedule(ws->server->context, 0, &ws->pace, pace_over, wait);
    return wait <= 0;
}

static void begin_image(struct websocket *ws)
{
    struct sent_image *p = websocket_next_image(ws);

    if (!p)
        return;
    const struct protocol_picture *header = image_header(p);
    /* No image of an H.264 chain can be left out; its track has the rate. */
    const double rate = header->format == PROTOCOL_H264 ? 0.0 : ws->wish.subscribe.max_rate;
    if (ws->begun > 0 && !ws->recorder) { /* a recorder's numbers have gaps for images of others */
        const uint64_t skipped = header->sequence - ws->begun - 1;
        ws->skipped += skipped;
        atomic_fetch_add(&ws->server->counts.skipped, skipped);
        atomic_fetch_add(rate > 0.0 ? &ws->server->metrics.skipped_rate : &ws->server->metrics.skipped_slow, skipped);
    }
    ws->due_us = websocket_due(ws->due_us, stream_now_us(), rate);
    ws->begun = header->sequence;
    ws->chained = true;
    ws->repeated = image_placed_us(p) < ws->since_us;
    ws->unacked[ws->unacked_count].sequence = header->sequence;
    ws->unacked[ws->unacked_count++].placed_us = image_placed_us(p);
    ws->current = p;
    ws->offset = 0;
}

int64_t websocket_due(int64_t due_us, int64_t now_us, double rate)
{
    if (!(rate > 0.0))
        return due_us;
    const int64_t interval = (int64_t)(1e6 / rate);
    return (due_us > now_us - interval ? due_us : now_us) + interval;
}

static int send_fragment(struct websocket *ws)
{
    size_t size;
    const uint8_t *message = image_message(ws->current, &size);
    const size_t left = size - ws->offset, piece = left < STREAM_CHUNK ? left : STREAM_CHUNK;
    uint8_t *out = ws->staging + LWS_PRE;

    memcpy(out, message + ws->offset, piece);
    if (ws->offset == 0 && ws->repeated)
        out[PROTOCOL_PICTURE_FLAGS_AT] |= PROTOCOL_PICTURE_REPEAT;
    if (lws_write(ws->wsi, out, piece, lws_write_ws_flags(LWS_WRITE_BINARY, ws->offset == 0, piece == left)) < 0)
        return -1;
    ws->offset += piece;
    atomic_fetch_add(&ws->server->counts.bytes, piece);
    if (ws->offset == size) {
        if (!ws->repeated)
            server_observe(ws->server, SERVER_SENT, 1e-6 * (double)(stream_now_us() - image_placed_us(ws->current)));
        atomic_fetch_add(&ws->server->metrics.sent[metrics_kind(image_kind(ws->current))], 1);
        image_unref(ws->current);
        ws->current = NULL;
        ws->sent++;
        atomic_fetch_add(&ws->server->counts.sent, 1);
    }
    return 0;
}

static int send_text(struct websocket *ws, const char *text)
{
    const size_t size = strlen(text);

    if (size > STREAM_CHUNK)
        return -1;
    memcpy(ws->staging + LWS_PRE, text, size);
    return lws_write(ws->wsi, ws->staging + LWS_PRE, size, LWS_WRITE_TEXT) < 0 ? -1 : 0;
}

static int send_made(struct websocket *ws, char *text)
{
    const int result = text ? send_text(ws, text) : 0;

    message_free(text);
    return result;
}

static int send_status(struct websocket *ws)
{
    struct server *s = ws->server;

    ws->status_due = false;
    pthread_mutex_lock(&s->lock);
    if (!s->status)
        s->status = message_status_shared(&s->figures, s->controls);
    char *text =
        s->status ? message_status(s->status, clock_wall_us(), s->demand.viewers, ws->sent, ws->skipped) : NULL;
    pthread_mutex_unlock(&s->lock);
    return send_made(ws, text);
}

/* The text message that is due first, if any; messages to this viewer alone come before the status. */
static bool text_is_due(const struct websocket *ws)
{
    return ws->outbox_count > 0 || ws->status_due || control_due(ws) || inspect_due(ws);
}

static int send_due_text(struct websocket *ws)
{
    if (ws->outbox_count > 0) {
        char *text = ws->outbox[0];
        drop_first(ws->outbox, &ws->outbox_count, sizeof(ws->outbox[0]));
        ws->outbox_bytes -= strlen(text);
        return send_made(ws, text);
    }
    if (ws->status_due)
        return send_status(ws);
    return send_made(ws, control_due(ws) ? control_text(ws) : inspect_text(ws));
}

static int send_image(struct websocket *ws)
{
    if (websocket_may_begin(ws))
        begin_image(ws);
    return ws->current ? send_fragment(ws) : 0;
}

/* libwebsockets wants one write per call. Between the fragments of an image only a close frame may go. */
int websocket_write(struct websocket *ws)
{
    ws->waiting = false;
    if (ws->close_code && (ws->current || ws->outbox_count == 0)) {
        lws_close_reason(ws->wsi, (enum lws_close_status)ws->close_code, (unsigned char *)ws->close_text,
                         strlen(ws->close_text));
        return -1;
    }
    const int result = !ws->current && text_is_due(ws) ? send_due_text(ws) : send_image(ws);
    if (result == 0 && (ws->current || text_is_due(ws) || ws->close_code || websocket_may_begin(ws)))
        websocket_request_write(ws);
    return result;
}
