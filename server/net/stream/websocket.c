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
    const struct connection *c = connection_of(wsi);
    char path[64], version[8], http[16];

    if (!c || c->state == CONNECTION_LEAVING)
        return -1;
    if (atomic_load(&s->stopping))
        return http_refuse(s, wsi, 503, "The server is shutting down.\n");
    if (!http_host_ok(s, wsi) || !http_origin_ok(wsi) || http_is_foreign(wsi, false))
        return http_refuse(s, wsi, 403, "Pages of other sites are not served.\n");
    if (lws_hdr_copy(wsi, path, sizeof(path), WSI_TOKEN_GET_URI) <= 0 || strcmp(path, PROTOCOL_PATH) != 0)
        return http_refuse(s, wsi, 404, "WebSockets are at " PROTOCOL_PATH "\n");
    if (lws_hdr_copy(wsi, version, sizeof(version), WSI_TOKEN_VERSION) <= 0 || strcmp(version, "13") != 0)
        return http_refuse(s, wsi, 400, "Only WebSocket version 13 is supported.\n");
    if (lws_hdr_copy(wsi, http, sizeof(http), WSI_TOKEN_HTTP) <= 0 || strcmp(http, "HTTP/1.1") != 0 || !key_ok(wsi))
        return http_refuse(s, wsi, 400, "A WebSocket handshake is HTTP/1.1 with a key of 16 bytes.\n");
    if (!connection_forwarded(s, wsi))
        return http_refuse(s, wsi, 400, "The proxy names no address in X-Forwarded-For.\n");
    return 0;
}

bool websocket_has_room(struct websocket *ws)
{
    char text[160];
    struct fault fault;

    if (!connection_refusal(ws->server, ws->connection, text, sizeof(text)))
        return true;
    atomic_fetch_add(&ws->server->counts.refused, 1);
    fault_say(&fault, FAULT_FULL, "2.4", "%s", text);
    websocket_send_error(ws, &fault);
    return false;
}

struct websocket *websocket_of(const struct server *s, uint64_t id)
{
    struct websocket *ws = s->websockets;

    while (ws && ws->id != id)
        ws = ws->next;
    return ws;
}

void websocket_limit_unsent(struct lws *wsi)
{
    const int unsent = STREAM_UNSENT;

    setsockopt(lws_get_socket_fd(wsi), IPPROTO_TCP, TCP_NOTSENT_LOWAT, &unsent, sizeof(unsent));
}

static int open_websocket(struct server *s, struct lws *wsi, struct websocket **out)
{
    struct websocket *ws = mem_alloc(1, sizeof(*ws));

    if (!ws)
        return -1;
    *out = ws;
    ws->server = s;
    ws->wsi = wsi;
    ws->id = ++s->last_id;
    ws->opened_us = ws->heard_us = ws->moved_us = stream_now_us();
    lws_get_peer_simple(wsi, ws->peer, sizeof(ws->peer));
    flood_begin(ws);
    websocket_limit_unsent(wsi);
    ws->next = s->websockets;
    s->websockets = ws;
    atomic_fetch_add(&s->counts.connections, 1);
    atomic_fetch_add(&s->counts.open, 1);
    ws->connection = connection_of(wsi);
    ws->connection->websocket = ws;
    if (s->behind_proxy)
        client_name(ws->connection->client, ws->peer);
    if (atomic_load(&s->stopping))
        websocket_close(ws, 1001, "the server is shutting down");
    else
        websocket_has_room(ws);
    return 0;
}

static void close_websocket(struct websocket *ws)
{
    struct server *s = ws->server;
    struct websocket **link = &s->websockets;

    while (*link != ws)
        link = &(*link)->next;
    *link = ws->next;
    ws->connection->websocket = NULL;
    producer_leave(ws);
    recorder_leave(ws);
    inspect_leave(ws);
    atomic_fetch_sub(&s->counts.open, 1);
    lws_sul_cancel(&ws->pace);
    image_unref(ws->current);
    while (ws->outbox_count > 0)
        message_free(ws->outbox[--ws->outbox_count]);
    mem_free(ws);
    viewers_demand(s);
}

void websockets_wake(struct server *s)
{
    const bool urgent = atomic_exchange(&s->urgent, false), resized = atomic_exchange(&s->resized, false);

    for (struct websocket *ws = s->websockets; ws && resized; ws = ws->next)
        if (ws->subscribed)
            websocket_choose(ws);
    if (resized)
        viewers_demand(s);
    controls_tell(s);
    inspections_send(s);
    producers_send(s);
    for (struct websocket *ws = s->websockets; ws; ws = ws->next) {
        if (urgent && ws->greeted)
            ws->status_due = true;
        recorder_send_end(ws);
        if (ws->status_due || control_due(ws) || inspect_due(ws) || websocket_may_begin(ws))
            websocket_request_write(ws);
    }
    watchers_wake(s);
    holdings_limit(s);
}

void websockets_tick(struct server *s)
{
    const int64_t now = stream_now_us();
    struct fault fault;

    holdings_limit(s); /* texts come without images, too */
    for (struct websocket *ws = s->websockets; ws; ws = ws->next) {
        flood_check(ws);
        if (ws->waiting && now - ws->moved_us > STREAM_STALL_US) {
            atomic_fetch_add(&s->counts.stalled, 1);
            log_warning("%s: closed: it took no bytes for %d s; it got %llu images and skipped %llu", ws->peer,
                        STREAM_STALL_US / 1000000, (unsigned long long)ws->sent, (unsigned long long)ws->skipped);
            lws_set_timeout(ws->wsi, PENDING_TIMEOUT_USER_REASON_BASE, LWS_TO_KILL_ASYNC);
        } else if (!ws->greeted && !ws->close_code && now - ws->opened_us > STREAM_HELLO_US) {
            fault_say(&fault, FAULT_NO_HELLO, "4.1", "no hello within %d s", STREAM_HELLO_US / 1000000);
            websocket_send_error(ws, &fault);
        } else if (ws->greeted && !ws->close_code) {
            producer_tick(ws, now);
            ws->status_due = true;
            websocket_request_write(ws);
        }
    }
}

void websockets_leave(struct server *s)
{
    for (struct websocket *ws = s->websockets; ws; ws = ws->next)
        websocket_close(ws, 1001, "the server is shutting down");
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
    for (struct websocket *ws = s->websockets; ws; ws = ws->next) {
        if (!ws->subscribed || ws->wish.subscribe.paused || ws->close_code || ws->recorder)
            continue;
        d.viewers++;
        d.formats |= 1u << ws->wish.subscribe.format;
        d.halves |= ws->kind == STREAM_JPEG_HALF;
        d.quarters |= ws->kind == STREAM_JPEG_QUARTER;
        if (ws->kind >= STREAM_TRACKS)
            d.h264 |= 1u << (ws->kind - STREAM_TRACKS);
        if (ws->wish.subscribe.quality > d.jpeg_quality)
            d.jpeg_quality = ws->wish.subscribe.quality;
        if (ws->wish.subscribe.max_rate > d.max_rate)
            d.max_rate = ws->wish.subscribe.max_rate;
        unlimited = unlimited || ws->wish.subscribe.max_rate == 0.0;
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
    struct websocket **slot = user, *ws = slot ? *slot : NULL;

    switch (reason) {
    case LWS_CALLBACK_FILTER_PROTOCOL_CONNECTION: return filter(s, wsi);
    case LWS_CALLBACK_ESTABLISHED: return open_websocket(s, wsi, slot);
    case LWS_CALLBACK_RECEIVE:
        ws->heard_us = stream_now_us();
        ws->flood.messages += (int64_t)(length + length / 64 + 64); /* headers of WebSocket and TLS, generously */
        websocket_receive(ws, in, length);
        lws_validity_confirmed(wsi);
        return 0;
    case LWS_CALLBACK_RECEIVE_PONG: flood_check(ws); return 0;
    case LWS_CALLBACK_SERVER_WRITEABLE:
        if (!ws->waiting) /* libwebsockets has sent something itself, such as a pong */
            flood_check(ws);
        return websocket_write(ws);
    case LWS_CALLBACK_CLOSED:
        if (ws)
            close_websocket(ws);
        *slot = NULL;
        return 0;
    case LWS_CALLBACK_EVENT_WAIT_CANCELLED:
        server_take_change(s);
        if (atomic_load(&s->stopping) && !s->leaving) {
            s->leaving = true;
            websockets_leave(s);
        }
        websockets_wake(s);
        return 0;
    default: return 0;
    }
}

int websocket_callback(struct lws *wsi, enum lws_callback_reasons reason, void *user, void *in, size_t length)
{
    const int64_t begun_us = stream_now_us();
    const int result = answer(wsi, reason, user, in, length);

    if (reason == LWS_CALLBACK_RECEIVE || reason == LWS_CALLBACK_SERVER_WRITEABLE ||
        reason == LWS_CALLBACK_EVENT_WAIT_CANCELLED)
        metrics_worked(lws_context_user(lws_get_context(wsi)), begun_us);
    return result;
}
