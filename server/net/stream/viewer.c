#include "net/stream/internal.h"

#include "base/log.h"
#include "base/mem.h"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <string.h>
#include <sys/socket.h>

/* Sixteen bytes in base 64 [RFC 6455, 4.2.1]; libwebsockets would accept any word. */
static bool key_ok(struct lws *wsi)
{
    static const char letters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    char key[32];

    return lws_hdr_copy(wsi, key, sizeof(key), WSI_TOKEN_KEY) == 24 && strspn(key, letters) == 22 &&
           strcmp(key + 22, "==") == 0;
}

/* Before the upgrade is answered. */
static int filter(struct server *s, struct lws *wsi)
{
    const struct guest *g = guest_of(wsi);
    char path[64], version[8], http[16];

    if (!g || g->state == GUEST_LEAVING)
        return -1;
    if (atomic_load(&s->stopping))
        return http_refuse(s, wsi, 503, "The server is shutting down.\n");
    if (!http_host_ok(s, wsi) || !http_origin_ok(wsi))
        return http_refuse(s, wsi, 403, "Pages of other sites are not served.\n");
    if (lws_hdr_copy(wsi, path, sizeof(path), WSI_TOKEN_GET_URI) <= 0 || strcmp(path, PROTOCOL_PATH) != 0)
        return http_refuse(s, wsi, 404, "WebSockets are at " PROTOCOL_PATH "\n");
    if (lws_hdr_copy(wsi, version, sizeof(version), WSI_TOKEN_VERSION) <= 0 || strcmp(version, "13") != 0)
        return http_refuse(s, wsi, 400, "Only WebSocket version 13 is supported.\n");
    if (lws_hdr_copy(wsi, http, sizeof(http), WSI_TOKEN_HTTP) <= 0 || strcmp(http, "HTTP/1.1") != 0 || !key_ok(wsi))
        return http_refuse(s, wsi, 400, "A WebSocket handshake is HTTP/1.1 with a key of 16 bytes.\n");
    if (!admission_forwarded(s, wsi))
        return http_refuse(s, wsi, 400, "The proxy names no address in X-Forwarded-For.\n");
    return 0;
}

bool viewer_has_room(struct viewer *v)
{
    char text[160];
    struct fault fault;

    if (!guest_refusal(v->server, v->guest, text, sizeof(text)))
        return true;
    atomic_fetch_add(&v->server->counts.refused, 1);
    fault_say(&fault, FAULT_FULL, "2.4", "%s", text);
    viewer_send_error(v, &fault);
    return false;
}

void viewer_limit_unsent(struct lws *wsi)
{
    const int unsent = STREAM_UNSENT;

    setsockopt(lws_get_socket_fd(wsi), IPPROTO_TCP, TCP_NOTSENT_LOWAT, &unsent, sizeof(unsent));
}

static int open_viewer(struct server *s, struct lws *wsi, struct viewer **out)
{
    struct viewer *v = mem_alloc(1, sizeof(*v));

    if (!v)
        return -1;
    *out = v;
    v->server = s;
    v->wsi = wsi;
    v->id = ++s->last_id;
    v->tokens = STREAM_BURST;
    v->opened_us = v->heard_us = v->tokens_us = v->moved_us = viewer_now_us();
    lws_get_peer_simple(wsi, v->peer, sizeof(v->peer));
    flood_begin(v);
    viewer_limit_unsent(wsi);
    v->next = s->viewers;
    s->viewers = v;
    atomic_fetch_add(&s->counts.connections, 1);
    atomic_fetch_add(&s->counts.open, 1);
    v->guest = guest_of(wsi);
    if (s->behind_proxy)
        visitor_name(v->guest->visitor, v->peer);
    if (atomic_load(&s->stopping))
        viewer_close(v, 1001, "the server is shutting down");
    else
        viewer_has_room(v);
    return 0;
}

static void close_viewer(struct viewer *v)
{
    struct server *s = v->server;
    struct viewer **link = &s->viewers;

    while (*link != v)
        link = &(*link)->next;
    *link = v->next;
    producer_leave(v);
    recorder_leave(v);
    inspect_leave(v);
    atomic_fetch_sub(&s->counts.open, 1);
    lws_sul_cancel(&v->pace);
    image_unref(v->current);
    while (v->outbox_count > 0)
        message_free(v->outbox[--v->outbox_count]);
    mem_free(v);
    viewers_demand(s);
}

void viewers_wake(struct server *s)
{
    const bool urgent = atomic_exchange(&s->urgent, false), resized = atomic_exchange(&s->resized, false);

    for (struct viewer *v = s->viewers; v && resized; v = v->next)
        if (v->subscribed)
            viewer_choose(v);
    if (resized)
        viewers_demand(s);
    controls_tell(s);
    inspections_send(s);
    producers_send(s);
    for (struct viewer *v = s->viewers; v; v = v->next) {
        if (urgent && v->greeted)
            v->status_due = true;
        recorder_send_end(v);
        if (v->status_due || control_due(v) || inspect_due(v) || viewer_may_begin(v))
            viewer_request_write(v);
    }
    watchers_wake(s);
}

void viewers_tick(struct server *s)
{
    const int64_t now = viewer_now_us();
    struct fault fault;

    for (struct viewer *v = s->viewers; v; v = v->next) {
        flood_check(v);
        if (v->waiting && now - v->moved_us > STREAM_STALL_US) {
            atomic_fetch_add(&s->counts.stalled, 1);
            log_warning("%s: closed: it took no bytes for %d s; it got %llu images and skipped %llu", v->peer,
                        STREAM_STALL_US / 1000000, (unsigned long long)v->sent, (unsigned long long)v->skipped);
            lws_set_timeout(v->wsi, PENDING_TIMEOUT_USER_REASON_BASE, LWS_TO_KILL_ASYNC);
        } else if (!v->greeted && !v->close_code && now - v->opened_us > STREAM_HELLO_US) {
            fault_say(&fault, FAULT_NO_HELLO, "4.1", "no hello within %d s", STREAM_HELLO_US / 1000000);
            viewer_send_error(v, &fault);
        } else if (v->greeted && !v->close_code) {
            producer_tick(v, now);
            v->status_due = true;
            viewer_request_write(v);
        }
    }
}

void viewers_leave(struct server *s)
{
    for (struct viewer *v = s->viewers; v; v = v->next)
        viewer_close(v, 1001, "the server is shutting down");
    for (struct watcher *w = s->watchers; w; w = w->next)
        watcher_close(w);
}

void viewers_demand(struct server *s)
{
    struct server_demand d = { 0 };
    bool unlimited = false;

    pthread_mutex_lock(&s->lock);
    watchers_demand(s, &d);
    unlimited = d.viewers > 0;
    for (struct viewer *v = s->viewers; v; v = v->next) {
        if (!v->subscribed || v->wish.subscribe.paused || v->close_code || v->recorder)
            continue;
        d.viewers++;
        d.formats |= 1u << v->wish.subscribe.format;
        d.halves |= v->kind == STREAM_JPEG_HALF;
        d.quarters |= v->kind == STREAM_JPEG_QUARTER;
        if (v->kind >= STREAM_TRACKS)
            d.h264 |= 1u << (v->kind - STREAM_TRACKS);
        if (v->wish.subscribe.quality > d.jpeg_quality)
            d.jpeg_quality = v->wish.subscribe.quality;
        if (v->wish.subscribe.max_rate > d.max_rate)
            d.max_rate = v->wish.subscribe.max_rate;
        unlimited = unlimited || v->wish.subscribe.max_rate == 0.0;
    }
    if (unlimited)
        d.max_rate = 0.0;
    s->demand = d;
    chains_clear(s, d.h264);
    pthread_mutex_unlock(&s->lock);
}

/* relight.v1 on one connection. Thread: service. */
static int answer(struct lws *wsi, enum lws_callback_reasons reason, void *user, void *in, size_t length)
{
    struct server *s = lws_context_user(lws_get_context(wsi));
    struct viewer **slot = user, *v = slot ? *slot : NULL;

    switch (reason) {
    case LWS_CALLBACK_FILTER_PROTOCOL_CONNECTION: return filter(s, wsi);
    case LWS_CALLBACK_ESTABLISHED: return open_viewer(s, wsi, slot);
    case LWS_CALLBACK_RECEIVE:
        v->heard_us = viewer_now_us();
        flood_add(v, length);
        viewer_receive(v, in, length);
        lws_validity_confirmed(wsi);
        return 0;
    case LWS_CALLBACK_RECEIVE_PONG: flood_check(v); return 0;
    case LWS_CALLBACK_SERVER_WRITEABLE:
        if (!v->waiting) /* libwebsockets has sent something itself, such as a pong */
            flood_check(v);
        return viewer_write(v);
    case LWS_CALLBACK_CLOSED:
        if (v)
            close_viewer(v);
        *slot = NULL;
        return 0;
    case LWS_CALLBACK_EVENT_WAIT_CANCELLED:
        server_take_change(s);
        if (atomic_load(&s->stopping) && !s->leaving) {
            s->leaving = true;
            viewers_leave(s);
        }
        viewers_wake(s);
        return 0;
    default: return 0;
    }
}

int viewer_callback(struct lws *wsi, enum lws_callback_reasons reason, void *user, void *in, size_t length)
{
    const int64_t begun_us = viewer_now_us();
    const int result = answer(wsi, reason, user, in, length);

    if (reason == LWS_CALLBACK_RECEIVE || reason == LWS_CALLBACK_SERVER_WRITEABLE ||
        reason == LWS_CALLBACK_EVENT_WAIT_CANCELLED)
        metrics_worked(lws_context_user(lws_get_context(wsi)), begun_us);
    return result;
}
