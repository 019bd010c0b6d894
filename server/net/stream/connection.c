#include "net/stream/internal.h"

#include "base/mem.h"

#include <linux/tcp.h> /* not netinet/tcp.h, whose tcp_info ends before tcpi_bytes_received */
#include <netinet/in.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#define BESIDE_ADMITTED 16 /* connections of a client beside its admitted ones: a browser opens six for a page */

/* ---- Places ---- */

struct connection *connection_of(struct lws *wsi)
{
    return lws_get_opaque_user_data(wsi); /* libwebsockets keeps it with the socket */
}

/* Local connections may all come through a proxy. */
static bool is_limited(const struct limits *l, const struct client *c)
{
    return l->per_address_given || !c->loopback;
}

static void take_out(struct limits *l, struct connection *c)
{
    *(c->previous ? &c->previous->next : &l->first) = c->next;
    *(c->next ? &c->next->previous : &l->last) = c->previous;
    l->connections[c->state]--;
    c->client->connections[c->state]--;
}

static void put_last(struct limits *l, struct connection *c, enum connection_state state)
{
    c->state = state;
    c->previous = l->last;
    c->next = NULL;
    *(l->last ? &l->last->next : &l->first) = c;
    l->last = c;
    l->connections[state]++;
    c->client->connections[state]++;
}

static void change(struct limits *l, struct connection *c, enum connection_state state)
{
    take_out(l, c);
    put_last(l, c, state);
}

/* Closes the oldest arriving connection of the client that has most. */
static void evict(struct limits *l)
{
    struct connection *out = NULL;

    for (struct connection *c = l->first; c; c = c->next)
        if (c->state == CONNECTION_ARRIVING &&
            (!out || c->client->connections[CONNECTION_ARRIVING] > out->client->connections[CONNECTION_ARRIVING]))
            out = c;
    limit_reached(l, LIMIT_ARRIVALS, out->client);
    change(l, out, CONNECTION_LEAVING);
    /* Not in this call: libwebsockets may be about to service it. */
    lws_set_timeout(out->wsi, PENDING_TIMEOUT_USER_REASON_BASE, LWS_TO_KILL_ASYNC);
}

/* The address at the other end. False: the socket is gone. */
static bool peer_address(struct lws *wsi, uint8_t out[16])
{
    struct sockaddr_storage from = { 0 };
    socklen_t size = sizeof(from);

    return getpeername(lws_get_socket_fd(wsi), (struct sockaddr *)&from, &size) == 0 &&
           address_take((const struct sockaddr *)&from, out);
}

int connection_open(struct server *s, struct lws *wsi)
{
    struct limits *l = &s->limits;
    uint8_t address[16];
    struct client *client = peer_address(wsi, address) ? client_find(l, address, stream_now_us()) : NULL;

    lws_set_opaque_user_data(wsi, NULL);
    if (!client || (is_limited(l, client) && client_connections(client) >= l->per_address + BESIDE_ADMITTED)) {
        atomic_fetch_add(&s->counts.refused, 1);
        limit_reached(l, LIMIT_ADDRESS, client);
        return -1;
    }
    struct connection *c = mem_alloc(1, sizeof(*c));
    if (!c)
        return -1;
    *c = (struct connection){ .wsi = wsi, .client = client };
    put_last(l, c, CONNECTION_ARRIVING);
    lws_set_opaque_user_data(wsi, c);
    if (l->connections[CONNECTION_ARRIVING] > l->most_arriving)
        evict(l);
    return 0;
}

void connection_close(struct server *s, struct lws *wsi)
{
    struct connection *c = connection_of(wsi);

    if (!c)
        return;
    watcher_destroy(c->watcher);
    take_out(&s->limits, c);
    lws_set_opaque_user_data(wsi, NULL);
    mem_free(c);
}

/* Producers and recorders have work to finish. */
static bool may_give_way(const struct connection *c)
{
    const struct websocket *ws = c->websocket;

    return c->state == CONNECTION_ADMITTED && (!ws || (!ws->producing && !ws->recorder && !ws->close_code));
}

/* The newest of the client with most, if that has at least two more than c's: first requests of plain HTTP, then
 * viewers. NULL: none. */
static struct connection *who_gives_way(const struct limits *l, const struct connection *c)
{
    uint32_t most = c->client->connections[CONNECTION_ADMITTED] + 2;
    struct connection *out = NULL;

    for (struct connection *k = l->last; k; k = k->previous) {
        const uint32_t has = k->client->connections[CONNECTION_ADMITTED];
        if (may_give_way(k) && (has > most || (has == most && (!out || (k->watcher && !out->watcher))))) {
            most = has;
            out = k;
        }
    }
    return out;
}

const char *connection_refusal(struct server *s, const struct connection *c, char *text, size_t size)
{
    struct limits *l = &s->limits;

    if (is_limited(l, c->client) && c->client->connections[CONNECTION_ADMITTED] >= l->per_address) {
        snprintf(text, size, "one address has at most %u connections", l->per_address);
        limit_reached(l, LIMIT_ADDRESS, c->client);
        return text;
    }
    if (l->connections[CONNECTION_ADMITTED] < l->most_admitted || who_gives_way(l, c))
        return NULL;
    snprintf(text, size, "all %u connections are taken", l->most_admitted);
    limit_reached(l, LIMIT_CLIENTS, c->client);
    return text;
}

/* Closes an admitted connection that gives way. */
static void show_out(struct server *s, struct connection *out)
{
    struct fault fault;

    limit_reached(&s->limits, LIMIT_CLIENTS, out->client);
    change(&s->limits, out, CONNECTION_ARRIVING); /* until it has gone */
    if (out->watcher) {
        watcher_close(out->watcher);
        return;
    }
    fault_say(&fault, FAULT_FULL, "2.4", "all %u connections are taken, and its address had most of them",
              s->limits.most_admitted);
    websocket_send_error(out->websocket, &fault);
}

bool connection_admit(struct server *s, struct connection *c)
{
    if (c->state != CONNECTION_ARRIVING)
        return false;
    if (s->limits.connections[CONNECTION_ADMITTED] >= s->limits.most_admitted)
        show_out(s, who_gives_way(&s->limits, c));
    change(&s->limits, c, CONNECTION_ADMITTED);
    return true;
}

void connection_dismiss(struct server *s, struct connection *c)
{
    if (c->state == CONNECTION_ADMITTED)
        change(&s->limits, c, CONNECTION_ARRIVING);
}

/* ---- Proxies and tokens ---- */

/* Whether the other end is the configured proxy. */
static bool is_proxy(const struct server *s, struct lws *wsi)
{
    uint8_t address[16];

    return peer_address(wsi, address) &&
           (memcmp(address, s->proxies[0], 16) == 0 || memcmp(address, s->proxies[1], 16) == 0);
}

bool connection_forwarded(struct server *s, struct lws *wsi)
{
    struct connection *c = connection_of(wsi); /* of the proxy, or of the client of the previous request */
    char header[1024];

    if (!s->behind_proxy || !c || lws_hdr_total_length(wsi, WSI_TOKEN_X_FORWARDED_FOR) == 0 || !is_proxy(s, wsi))
        return true;
    if (lws_hdr_copy(wsi, header, sizeof(header), WSI_TOKEN_X_FORWARDED_FOR) <= 0)
        return false;
    struct client *client = client_forwarded(&s->limits, header, stream_now_us());
    if (!client)
        return false;
    c->client->connections[c->state]--;
    c->client = client;
    client->connections[c->state]++;
    return true;
}

/* Compares in constant time, so that timing reveals nothing about the token. */
static bool is_same(const char *given, const char *wanted)
{
    const size_t length = strlen(given);
    unsigned differs = length != strlen(wanted);

    for (size_t i = 0; wanted[i]; i++)
        differs |= (unsigned char)wanted[i] ^ (unsigned char)given[i < length ? i : length];
    return !differs;
}

enum token_check token_check(struct server *s, struct lws *wsi, const char *given, const char *wanted)
{
    const struct connection *c = connection_of(wsi);
    struct client *client = c ? c->client : NULL;
    const int64_t now = stream_now_us();

    if (!wanted)
        return TOKEN_RIGHT;
    if (!given[0]) /* an empty token is no guess */
        return TOKEN_WRONG;
    if (client && !client_may_guess(&s->limits, client, now)) {
        limit_reached(&s->limits, LIMIT_GUESSES, client);
        return TOKEN_LATER;
    }
    if (is_same(given, wanted)) {
        if (client)
            client->known = true;
        return TOKEN_RIGHT;
    }
    atomic_fetch_add(&s->counts.wrong_tokens, 1);
    if (client)
        client_guessed_wrong(&s->limits, client, now);
    return TOKEN_WRONG;
}

enum token_check token_check_header(struct server *s, struct lws *wsi, const char *wanted)
{
    char given[512], pair[512];

    if (!wanted)
        return TOKEN_RIGHT;
    if (lws_hdr_copy(wsi, given, sizeof(given), WSI_TOKEN_HTTP_AUTHORIZATION) <= 0)
        return TOKEN_WRONG;
    if (strncasecmp(given, "Bearer ", 7) == 0)
        return token_check(s, wsi, given + 7, wanted);
    const int size =
        strncasecmp(given, "Basic ", 6) == 0 ? lws_b64_decode_string(given + 6, pair, sizeof(pair) - 1) : 0;
    if (size <= 0)
        return TOKEN_WRONG;
    pair[size] = '\0';
    const char *colon = strchr(pair, ':'); /* the user may have any name [RFC 7617, 2] */
    return colon ? token_check(s, wsi, colon + 1, wanted) : TOKEN_WRONG;
}

/* ---- Bytes beside messages ---- */

/* Bytes that were received and read; fewer if some arrive between the two calls. Negative: this kernel does not say. */
static int64_t bytes_read(struct lws *wsi)
{
    struct tcp_info info;
    socklen_t size = sizeof(info);
    const int fd = lws_get_socket_fd(wsi);
    int unread = 0;

    if (getsockopt(fd, IPPROTO_TCP, TCP_INFO, &info, &size) != 0 ||
        size < offsetof(struct tcp_info, tcpi_bytes_received) + sizeof(info.tcpi_bytes_received) ||
        ioctl(fd, FIONREAD, &unread) != 0)
        return -1;
    return (int64_t)info.tcpi_bytes_received - unread;
}

void flood_begin(struct websocket *ws)
{
    ws->flood.read = bytes_read(ws->wsi);
}

void flood_check(struct websocket *ws)
{
    struct flood *f = &ws->flood;
    const int64_t read = bytes_read(ws->wsi);
    struct fault fault;

    if (read < 0 || f->read < 0 || ws->close_code)
        return;
    /* Compare totals: what was taken for something else may turn out to be a message of which a piece is still to come,
     * and is then not counted again. */
    const int64_t beside = read - f->read - f->messages;
    bucket_fill(&f->bucket, FLOOD_BURST, FLOOD_RATE, stream_now_us());
    if (beside > f->beside) {
        f->bucket.left -= (double)(beside - f->beside);
        f->beside = beside;
    }
    if (f->bucket.left >= 0.0)
        return;
    atomic_fetch_add(&ws->server->counts.too_fast, 1);
    fault_say(&fault, FAULT_TOO_FAST, "2.5", "more than %d bytes a second besides messages", FLOOD_RATE);
    websocket_send_error(ws, &fault);
    lws_rx_flow_control(ws->wsi, 0); /* else it would cost until it is gone */
}
