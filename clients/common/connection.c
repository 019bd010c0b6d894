#include "clients/common/connection.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "clients/common/message.h"
#include "protocol/relight_protocol.h"

#include <assert.h>
#include <libwebsockets.h>
#include <netdb.h>
#include <netinet/tcp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define CHUNK ((size_t)64 << 10)       /* of a message that goes out, and of what is read at a time */
#define OUTBOX_MOST ((size_t)64 << 10) /* bytes of text messages that wait: acks, pings */
#define CLOSING_MS 2000                /* for the server to answer a close frame */
#define WELCOME_MS 10000
#define TICK_US 100000  /* at most, between two looks at the clock and at signals */
#define SETTLED_MS 5000 /* a connection that lasted so long was no accident */
#define PING_MS 1000

enum state {
    STATE_AWAY, /* no socket; a timer may be set */
    STATE_CONNECTING,
    STATE_OPEN, /* hello is said */
    STATE_WELCOMED,
    STATE_CLOSING, /* a close frame is to go or has gone */
};

struct connection {
    struct connection_desc desc;
    struct address address;
    SSL_CTX *trust; /* NULL without TLS */
    struct lws_context *context;
    struct lws_protocols protocols[2];
    struct lws *wsi;
    enum state state;
    int64_t since_ms; /* when this state began */
    lws_sorted_usec_list_t tick, retry;
    struct rng rng;

    unsigned tries;      /* since the last success */
    int64_t away_ms;     /* when the server was last there, or the start */
    bool open;           /* this connection was welcomed */
    unsigned welcomed;   /* connections so far */
    struct reason told;  /* the last trouble that was printed */
    char complaint[320]; /* of the server, before it closed; "" none */
    int close_code;      /* of its close frame; 0 none */
    uint64_t ping, last; /* ids: of the newest ping, and of the one whose answer ends it; 0 none */
    int64_t pinged_ms, pinged_us;
    struct offset offset;

    bool stopping, over; /* asked to end; connection_run returns */
    enum connection_end end;
    struct reason why;

    struct lws_buflist *outbox; /* text messages, a segment each */
    uint8_t head[PROTOCOL_HEADER_MAX];
    const uint8_t *payload;
    size_t head_size, payload_size, sent; /* sent: of head and payload together */
    bool sending;

    uint8_t *in; /* the message coming in */
    size_t in_size, in_room;
    bool in_binary;
    uint8_t staging[LWS_PRE + CHUNK]; /* a copy of what goes out: libwebsockets masks it in place */
};

static void move_to(struct connection *c, enum state state)
{
    c->state = state;
    c->since_ms = clock_ms();
}

/* ---- Ends ---- */

void connection_fail(struct connection *c, enum connection_end end, const char *format, ...)
{
    va_list args;

    if (c->stopping)
        return;
    c->stopping = true;
    c->end = end;
    va_start(args, format);
    vsnprintf(c->why.text, sizeof(c->why.text), format, args);
    va_end(args);
    c->over = c->state < STATE_OPEN;
    if (c->over)
        return;
    move_to(c, STATE_CLOSING);
    lws_callback_on_writable(c->wsi);
}

void connection_stop(struct connection *c)
{
    connection_fail(c, CONNECTION_DONE, "%s", "");
}

/* ---- Out: one lws_write for each time that the socket can be written ---- */

static void queue(struct connection *c, json_t *object)
{
    char *text = object ? json_dumps(object, JSON_COMPACT) : NULL;

    json_decref(object);
    if (lws_buflist_total_len(&c->outbox) > OUTBOX_MOST)
        connection_fail(c, CONNECTION_LOST, "%s reads nothing of what it asks for", c->address.named);
    else if (!text || lws_buflist_append_segment(&c->outbox, (uint8_t *)text, strlen(text)) < 0)
        connection_fail(c, CONNECTION_LOST, "no memory for a message");
    free(text);
    lws_callback_on_writable(c->wsi);
}

void connection_say(struct connection *c, json_t *object)
{
    if (c->state == STATE_WELCOMED)
        queue(c, object);
    else
        json_decref(object);
}

static void ping(struct connection *c)
{
    c->pinged_ms = clock_ms();
    c->pinged_us = clock_wall_us();
    queue(c, json_pack("{s:s, s:I}", "op", "ping", "id", (json_int_t)++c->ping));
}

void connection_finish(struct connection *c)
{
    if (c->last || c->state != STATE_WELCOMED)
        return;
    ping(c);
    c->last = c->ping;
}

void connection_send(struct connection *c, const uint8_t *head, size_t head_size, const uint8_t *payload, size_t size)
{
    assert(c->state == STATE_WELCOMED && !c->sending && head_size <= sizeof(c->head));
    memcpy(c->head, head, head_size);
    c->head_size = head_size;
    c->payload = payload;
    c->payload_size = size;
    c->sent = 0;
    c->sending = true;
    lws_callback_on_writable(c->wsi);
}

static int write_text(struct connection *c)
{
    uint8_t *text;
    const size_t size = lws_buflist_next_segment_len(&c->outbox, &text);

    assert(size <= CHUNK);
    memcpy(c->staging + LWS_PRE, text, size);
    lws_buflist_use_segment(&c->outbox, size);
    return lws_write(c->wsi, c->staging + LWS_PRE, size, LWS_WRITE_TEXT);
}

static int write_fragment(struct connection *c)
{
    const size_t left = c->head_size + c->payload_size - c->sent, count = left < CHUNK ? left : CHUNK;
    const size_t head = c->sent == 0 ? c->head_size : 0; /* fits into the first */
    const int flags = lws_write_ws_flags(LWS_WRITE_BINARY, c->sent == 0, count == left);

    memcpy(c->staging + LWS_PRE, c->head, head);
    memcpy(c->staging + LWS_PRE + head, c->payload + (c->sent + head - c->head_size), count - head);
    c->sent += count;
    c->sending = count < left;
    if (lws_write(c->wsi, c->staging + LWS_PRE, count, (enum lws_write_protocol)flags) < 0)
        return -1;
    lws_validity_confirmed(c->wsi); /* bytes were taken; the answer to a ping behind them may come late */
    if (!c->sending && c->desc.hooks.sent)
        c->desc.hooks.sent(c->desc.user);
    return 0;
}

/* A close frame goes between two fragments at the latest: what is left of a large message is not sent. */
static int on_writable(struct connection *c)
{
    int result = 0;

    if (c->state == STATE_CLOSING && (!c->outbox || c->sending)) {
        lws_close_reason(c->wsi, LWS_CLOSE_STATUS_NORMAL, NULL, 0);
        return -1;
    }
    if (c->outbox && (!c->sending || c->sent == 0))
        result = write_text(c);
    else if (c->sending)
        result = write_fragment(c);
    if (c->outbox || c->sending || c->state == STATE_CLOSING)
        lws_callback_on_writable(c->wsi);
    return result < 0 ? -1 : 0;
}

/* ---- In ---- */

static void on_welcome(struct connection *c, const json_t *welcome)
{
    uint64_t major = 0;

    if (c->state != STATE_OPEN)
        return;
    if (!message_number(json_object_get(welcome, "version"), "major", &major) || major != PROTOCOL_MAJOR) {
        connection_fail(c, CONNECTION_REFUSED, "%s speaks another version of the protocol than this program (%d)",
                        c->address.named, PROTOCOL_MAJOR);
        return;
    }
    move_to(c, STATE_WELCOMED);
    c->open = true;
    c->welcomed++;
    if (c->told.text[0] && !c->desc.quiet)
        log_info("connected to %s", c->address.named);
    c->told.text[0] = '\0';
    ping(c);
    if (c->desc.hooks.welcome)
        c->desc.hooks.welcome(c->desc.user, welcome);
}

static void on_pong(struct connection *c, const json_t *pong)
{
    uint64_t id;
    int64_t server_us;

    if (!message_number(pong, "id", &id))
        return;
    if (id == c->ping && message_time(pong, "server_us", &server_us))
        offset_add(&c->offset, c->pinged_us, clock_wall_us(), server_us);
    if (c->last && id >= c->last)
        connection_stop(c);
}

/* True: the client's too. After a fatal one comes a close, which reports it. */
static bool on_error(struct connection *c, const json_t *error)
{
    char code[40], message[200];

    message_plain(error, "code", code, sizeof(code));
    message_plain(error, "message", message, sizeof(message));
    snprintf(c->complaint, sizeof(c->complaint), "%s: %s", code, message);
    if (json_is_true(json_object_get(error, "fatal")))
        return false;
    log_warning("%s: %s", c->address.named, c->complaint);
    return true;
}

static void on_text(struct connection *c)
{
    const char *op;
    json_t *message = message_read(c->in, c->in_size, &op);

    if (!message)
        connection_fail(c, CONNECTION_LOST, "%s sent text that is not a relight.v1 message", c->address.named);
    else if (strcmp(op, "welcome") == 0)
        on_welcome(c, message);
    else if (strcmp(op, "pong") == 0)
        on_pong(c, message);
    else if ((strcmp(op, "error") != 0 || on_error(c, message)) && c->state == STATE_WELCOMED && c->desc.hooks.text)
        c->desc.hooks.text(c->desc.user, op, message);
    json_decref(message);
}

/* Room for more of the message coming in, doubled; sizes are bounded far below overflow. */
static bool grow(struct connection *c, size_t more)
{
    size_t room = c->in_room ? c->in_room : CHUNK;

    while (room - c->in_size < more)
        room *= 2;
    uint8_t *in = room == c->in_room ? c->in : mem_grow(c->in, c->in_size, room, 1);
    c->in = in ? in : c->in;
    c->in_room = in ? room : c->in_room;
    return in != NULL;
}

/* A piece of a message. */
static void on_receive(struct connection *c, const uint8_t *piece, size_t size)
{
    const size_t left = lws_remaining_packet_payload(c->wsi); /* of this frame */

    if (lws_is_first_fragment(c->wsi)) {
        c->in_size = 0;
        c->in_binary = lws_frame_is_binary(c->wsi);
    }
    const size_t most = c->in_binary ? c->desc.binary_most : MESSAGE_TEXT_MAX;
    if (size > most - c->in_size || left > most - c->in_size - size) {
        connection_fail(c, CONNECTION_LOST, "%s sent a %s message of more than %zu bytes", c->address.named,
                        c->in_binary ? "binary" : "text", most);
        return;
    }
    if (!grow(c, size)) {
        connection_fail(c, CONNECTION_LOST, "no memory for a message of more than %zu bytes", c->in_size);
        return;
    }
    if (size > 0)
        memcpy(c->in + c->in_size, piece, size);
    c->in_size += size;
    if (!lws_is_final_fragment(c->wsi) || left > 0)
        return;
    if (!c->in_binary)
        on_text(c);
    else if (c->state == STATE_WELCOMED && c->desc.hooks.binary)
        c->desc.hooks.binary(c->desc.user, c->in, c->in_size);
    c->in_size = 0;
}

/* ---- Losing the server and coming back ---- */

static void dial(lws_sorted_usec_list_t *retry);

static void on_gone(struct connection *c, struct retry_rule rule, const char *text)
{
    const bool welcomed = c->open;
    struct reason why;

    if (c->state == STATE_WELCOMED && clock_ms() - c->since_ms > SETTLED_MS)
        c->tries = 0;
    c->wsi = NULL;
    c->open = c->sending = false;
    c->last = 0;
    move_to(c, STATE_AWAY);
    lws_buflist_destroy_all_segments(&c->outbox);
    c->away_ms = welcomed ? c->since_ms : c->away_ms;
    if (welcomed && c->desc.hooks.lost)
        c->desc.hooks.lost(c->desc.user);
    c->over = c->stopping;
    if (c->over)
        return;
    (void)err_say(&why, ERR_OK, "%s: %s", c->address.named, text);
    const double away_s = 1e-3 * (double)(clock_ms() - c->away_ms);
    const int wait_ms = retry_wait_ms(c->tries, rule.when, &c->rng);
    if (rule.when == RETRY_NEVER || (c->desc.tries >= 0 && (int64_t)c->tries >= c->desc.tries) ||
        (c->desc.give_up_s > 0.0 && away_s + 1e-3 * wait_ms > c->desc.give_up_s)) {
        connection_fail(c, rule.refused ? CONNECTION_REFUSED : CONNECTION_LOST, "%s", why.text);
        return;
    }
    if (!c->desc.quiet && strcmp(why.text, c->told.text) != 0) { /* the same problem is reported once */
        log_warning("%s; trying again%s", why.text, wait_ms >= RETRY_MOST_MS ? " in ten seconds" : "");
        c->told = why;
    }
    c->tries++;
    lws_sul_schedule(c->context, 0, &c->retry, dial, (lws_usec_t)wait_ms * 1000);
}

static void on_closed(struct connection *c)
{
    const struct retry_rule rule = retry_after_close(c->close_code ? c->close_code : 1006);

    on_gone(c, rule, c->complaint[0] ? c->complaint : rule.name);
}

/* `said` is libwebsockets' reason. */
static void on_no_connection(struct connection *c, const char *said)
{
    const int status = c->wsi ? (int)lws_http_client_http_response(c->wsi) : 0;
    const SSL *ssl = c->trust && c->wsi ? lws_get_ssl(c->wsi) : NULL;
    const bool no_http = strcmp(said, "read failed") == 0 || strcmp(said, "Peer hung up") == 0 ||
                         strcmp(said, "problems parsing header") == 0;
    const char *tls = !c->trust && (no_http || status == 400) ? "; if this server uses TLS, connect to wss://" : "";
    const char *name = tls[0] ? c->address.named : "";
    struct retry_rule rule = retry_after_status(status == 101 ? 400 : status); /* 101: another subprotocol */
    struct reason text;

    if (ssl && trust_explain(ssl, c->desc.ca_file, &text)) /* a server that was trusted before may be fixed */
        rule.when = c->welcomed ? RETRY_LATER : RETRY_NEVER;
    else if (ssl && !SSL_is_init_finished(ssl))
        (void)err_say(&text, ERR_OK, "the TLS handshake failed; if this server does not use TLS, connect to ws://%s",
                      c->address.named);
    else if (status)
        (void)err_say(&text, ERR_OK, "%s (HTTP status %d)%s%s", rule.name, status, tls, name);
    else
        (void)err_say(&text, ERR_OK, "cannot be reached: %s%s%s", no_http ? "no HTTP answer" : said, tls, name);
    on_gone(c, rule, text.text);
}

/* libwebsockets made not even a socket, most often for want of an address. */
static void on_no_socket(struct connection *c)
{
    struct addrinfo *list = NULL;
    const int fault = getaddrinfo(c->address.host, NULL, NULL, &list);
    struct reason text = { "no socket can be created" };

    if (fault)
        (void)err_say(&text, ERR_OK, "'%s' cannot be resolved (%s); check the spelling", c->address.host,
                      gai_strerror(fault));
    else
        freeaddrinfo(list);
    on_no_connection(c, text.text);
}

/* A server that says nothing and takes no bytes is given up after 25 s; few may wait, or a slow line would be. */
static const lws_retry_bo_t validity = { .secs_since_valid_ping = 10, .secs_since_valid_hangup = 25 };

static void dial(lws_sorted_usec_list_t *retry)
{
    struct connection *c = lws_container_of(retry, struct connection, retry);
    const struct lws_client_connect_info info = {
        .context = c->context,
        .address = c->address.host,
        .port = c->address.port,
        .path = c->address.path,
        .host = c->address.named,
        .protocol = PROTOCOL_NAME,
        .local_protocol_name = PROTOCOL_NAME,
        .ietf_version_or_minus_one = -1,
        .alpn = "http/1.1",
        .ssl_connection = (c->trust ? LCCSCF_USE_SSL : 0) |
                          (strchr(c->address.host, ':') ? LCCSCF_SKIP_SERVER_CERT_HOSTNAME_CHECK : 0),
        .pwsi = &c->wsi,
        .retry_and_idle_policy = &validity,
    };

    c->close_code = 0;
    c->complaint[0] = '\0';
    move_to(c, STATE_CONNECTING);
    if (!lws_client_connect_via_info(&info) && c->state == STATE_CONNECTING) /* else the callback has reported it */
        on_no_socket(c);
}

/* ---- The loop ---- */

/* What silence means in each state. */
static void watch_time(struct connection *c)
{
    const int64_t for_ms = clock_ms() - c->since_ms;

    if (c->state == STATE_OPEN && for_ms > WELCOME_MS) {
        snprintf(c->complaint, sizeof(c->complaint), "no welcome within %d s", WELCOME_MS / 1000);
        lws_set_timeout(c->wsi, PENDING_TIMEOUT_USER_REASON_BASE, LWS_TO_KILL_ASYNC);
    }
    if (c->state == STATE_WELCOMED && clock_ms() - c->pinged_ms > PING_MS)
        ping(c);
    if (c->stopping && (c->state != STATE_CLOSING || for_ms > CLOSING_MS))
        c->over = true;
}

static void on_tick(lws_sorted_usec_list_t *sul)
{
    struct connection *c = lws_container_of(sul, struct connection, tick);

    if (c->desc.hooks.tick)
        c->desc.hooks.tick(c->desc.user);
    watch_time(c);
    connection_tick_within(c, TICK_US);
}

void connection_tick_within(struct connection *c, int64_t us)
{
    lws_sul_schedule(c->context, 0, &c->tick, on_tick, us < TICK_US ? us : TICK_US);
}

static void say_hello(struct connection *c)
{
    const struct connection_desc *d = &c->desc;

    queue(c, json_pack("{s:s, s:s, s:{s:i, s:i}, s:s*, s:s*, s:s*, s:s*}", "op", "hello", "role", d->role, "version",
                       "major", PROTOCOL_MAJOR, "minor", PROTOCOL_MINOR, "pace", d->pace, "sequence", d->sequence,
                       "recorder", d->recorder, "token", d->token));
}

static int callback(struct lws *wsi, enum lws_callback_reasons reason, void *user, void *in, size_t size)
{
    struct connection *c = lws_context_user(lws_get_context(wsi));
    char text[160];

    (void)user;
    switch (reason) {
    case LWS_CALLBACK_CLIENT_FILTER_PRE_ESTABLISH:
        c->wsi = wsi;
        return lws_hdr_total_length(wsi, WSI_TOKEN_PROTOCOL) > 0 ? 0 : -1;
    case LWS_CALLBACK_CLIENT_ESTABLISHED:
        setsockopt(lws_get_socket_fd(wsi), IPPROTO_TCP, TCP_NOTSENT_LOWAT, &(int){ 2 * CHUNK }, sizeof(int));
        move_to(c, STATE_OPEN);
        say_hello(c);
        break;
    case LWS_CALLBACK_CLIENT_CONNECTION_ERROR:
        c->wsi = wsi;
        on_no_connection(c, message_plain_bytes(in ? in : "", in ? size : 0, text, sizeof(text)));
        break;
    case LWS_CALLBACK_CLIENT_RECEIVE: on_receive(c, in, size); break;
    case LWS_CALLBACK_CLIENT_WRITEABLE: return c->wsi ? on_writable(c) : 0;
    case LWS_CALLBACK_WS_PEER_INITIATED_CLOSE:
        c->close_code = size >= 2 ? ((uint8_t *)in)[0] << 8 | ((uint8_t *)in)[1] : 1005;
        if (size > 2 && !c->complaint[0])
            message_plain_bytes((uint8_t *)in + 2, size - 2, c->complaint, sizeof(c->complaint));
        break;
    case LWS_CALLBACK_CLIENT_CLOSED: on_closed(c); break;
    case LWS_CALLBACK_EVENT_WAIT_CANCELLED:
        if (c && c->context && c->desc.hooks.tick)
            c->desc.hooks.tick(c->desc.user);
        break;
    default: break;
    }
    return 0;
}

enum err connection_create(const struct connection_desc *d, struct connection **out, struct reason *why)
{
    struct connection *c = mem_alloc(1, sizeof(*c));

    *out = NULL;
    if (!c)
        return err_say(why, ERR_NOMEM, "no memory for a connection");
    c->desc = *d;
    c->rng.state = rng_mix((uint64_t)clock_wall_us(), (uint64_t)getpid());
    c->protocols[0] = (struct lws_protocols){
        .name = PROTOCOL_NAME, .callback = callback, .rx_buffer_size = CHUNK, .tx_packet_size = CHUNK
    };
    enum err e = address_parse(d->url, &c->address, why);
    if (!e && c->address.tls)
        e = trust_create(d->ca_file, &c->address, &c->trust, why);
    else if (!e && d->ca_file)
        e = err_say(why, ERR_USAGE, "--ca is for TLS, but %s is not: use wss://%s", d->url, c->address.named);
    const struct lws_context_creation_info info = {
        .port = CONTEXT_PORT_NO_LISTEN,
        .protocols = c->protocols,
        .options = c->trust ? LWS_SERVER_OPTION_DO_SSL_GLOBAL_INIT : 0,
        .provided_client_ssl_ctx = c->trust,
        .gid = (gid_t)-1,
        .uid = (uid_t)-1,
        .user = c,
        .fd_limit_per_thread = 16,
        .pt_serv_buf_size = CHUNK,
        .retry_and_idle_policy = &validity,
    };
    lws_set_log_level(0, NULL); /* it logs every refused connection as an error of its own */
    if (!e && !(c->context = lws_create_context(&info)))
        e = err_say(why, ERR_NOMEM, "libwebsockets could not be started");
    if (e)
        connection_destroy(c);
    else
        *out = c;
    return e;
}

enum connection_end connection_run(struct connection *c, struct reason *why)
{
    c->away_ms = clock_ms();
    connection_tick_within(c, TICK_US);
    dial(&c->retry);
    while (!c->over && lws_service(c->context, 0) >= 0)
        continue;
    if (!c->over)
        connection_fail(c, CONNECTION_LOST, "the network's event loop failed");
    lws_sul_cancel(&c->tick);
    lws_sul_cancel(&c->retry);
    if (c->end != CONNECTION_DONE)
        *why = c->why;
    return c->end;
}

void connection_destroy(struct connection *c)
{
    struct lws_context *context = c ? c->context : NULL;

    if (!c)
        return;
    c->desc.hooks = (struct connection_hooks){ 0 }; /* lws calls back while it ends */
    c->stopping = true;
    c->context = NULL;
    if (context)
        lws_context_destroy(context);
    SSL_CTX_free(c->trust);
    lws_buflist_destroy_all_segments(&c->outbox);
    mem_free(c->in);
    mem_free(c);
}

void connection_wake(struct connection *c)
{
    lws_cancel_service(c->context);
}

void connection_thrive(struct connection *c)
{
    c->tries = 0;
}

bool connection_clock(const struct connection *c, int64_t *ahead_us, int64_t *uncertain_us)
{
    return offset_get(&c->offset, ahead_us, uncertain_us);
}

unsigned connection_count(const struct connection *c)
{
    return c->welcomed;
}

bool connection_is_open(const struct connection *c)
{
    return c->state == STATE_WELCOMED;
}
