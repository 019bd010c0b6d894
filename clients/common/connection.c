#include "connection_parts.h"

#include "clock.h"
#include "log.h"
#include "mem.h"
#include "message.h"
#include "retry.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define CLOSING_MS 2000 /* for the server to answer a close frame */
#define WELCOME_MS 10000
#define TICK_US 100000
#define SETTLED_MS 5000 /* a connection that lasted so long was no accident */
#define PING_MS 1000

void connection_move_to(struct connection *c, enum connection_state state)
{
    c->state = state;
    c->since_ms = clock_ms();
}

void connection_over(struct connection *c, enum connection_end end, const char *text)
{
    if (c->over)
        return;
    c->over = true;
    c->end = end;
    if (text != c->why.text)
        snprintf(c->why.text, sizeof(c->why.text), "%s", text);
}

static void begin_close(struct connection *c)
{
    if (c->state == STATE_CLOSING)
        return;
    if (c->state != STATE_OPEN && c->state != STATE_WELCOMED) {
        connection_over(c, c->end, c->why.text);
        return;
    }
    connection_move_to(c, STATE_CLOSING);
    connection_want_write(c);
}

void connection_finish(struct connection *c)
{
    if (c->finishing || c->state != STATE_WELCOMED)
        return;
    c->finishing = true;
    connection_ping(c);
}

void connection_stop(struct connection *c)
{
    connection_fail(c, CONNECTION_DONE, "%s", "");
}

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
    begin_close(c);
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

void connection_wake(struct connection *c)
{
    lws_cancel_service(c->context);
}

/* ---- Losing the server and coming back ---- */

static void dial(struct connection *c);

static void on_retry(lws_sorted_usec_list_t *sul)
{
    dial(lws_container_of(sul, struct connection, retry));
}

static void drop_socket(struct connection *c)
{
    const bool welcomed = c->open;

    if (c->state == STATE_WELCOMED && clock_ms() - c->since_ms > SETTLED_MS)
        c->tries = 0;
    c->wsi = NULL;
    c->open = false;
    connection_move_to(c, STATE_AWAY);
    c->sending = false;
    c->in.size = 0;
    c->finishing = false;
    c->finish_ping = 0;
    connection_outbox_clear(c);
    if (welcomed) {
        c->away_ms = clock_ms();
        if (c->desc.hooks.lost)
            c->desc.hooks.lost(c->desc.user);
    }
}

/* Says the same trouble once, however often it comes. */
static void tell(struct connection *c, const char *text, int wait_ms)
{
    if (c->desc.quiet || strcmp(text, c->told.text) == 0)
        return;
    log_warning("%s; trying again%s", text, wait_ms >= RETRY_MOST_MS ? " in ten seconds" : "");
    snprintf(c->told.text, sizeof(c->told.text), "%s", text);
}

static void on_gone(struct connection *c, struct retry_rule rule, const char *text)
{
    struct reason why;

    drop_socket(c);
    if (c->stopping) {
        connection_over(c, c->end, c->why.text);
        return;
    }
    (void)err_say(&why, ERR_OK, "%s: %s", c->address.named, text);
    const enum connection_end end = rule.refused ? CONNECTION_REFUSED : CONNECTION_LOST;
    const double away_s = 1e-3 * (double)(clock_ms() - c->away_ms);
    const int wait_ms = retry_wait_ms(c->tries, rule.when, &c->rng);
    if (rule.when == RETRY_NEVER || (c->desc.tries >= 0 && (int64_t)c->tries >= c->desc.tries) ||
        (c->desc.give_up_s > 0.0 && away_s + 1e-3 * wait_ms > c->desc.give_up_s)) {
        connection_over(c, end, why.text);
        return;
    }
    tell(c, why.text, wait_ms);
    c->tries++;
    lws_sul_schedule(c->context, 0, &c->retry, on_retry, (lws_usec_t)wait_ms * 1000);
}

static void on_closed(struct connection *c)
{
    const struct retry_rule rule = retry_after_close(c->close_code ? c->close_code : 1006);

    on_gone(c, rule, c->complaint[0] ? c->complaint : rule.name);
}

static void on_no_connection(struct connection *c, const char *said, size_t size)
{
    char text[160], whole[240];
    const int status = c->wsi ? (int)lws_http_client_http_response(c->wsi) : 0;
    const struct retry_rule rule = retry_after_status(status == 101 ? 400 : status); /* 101: another subprotocol */

    message_plain_bytes(said ? said : "", said ? size : 0, text, sizeof(text));
    if (status)
        snprintf(whole, sizeof(whole), "%s (HTTP status %d)", rule.name, status);
    else
        snprintf(whole, sizeof(whole), "cannot be reached%s%s", text[0] ? ": " : "", text);
    on_gone(c, rule, whole);
}

/* A server that has gone without a word is noticed after 25 s. */
static const lws_retry_bo_t validity = { .secs_since_valid_ping = 10, .secs_since_valid_hangup = 25 };

static void dial(struct connection *c)
{
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
        .pwsi = &c->wsi,
        .retry_and_idle_policy = &validity,
    };

    c->close_code = 0;
    c->complaint[0] = '\0';
    connection_move_to(c, STATE_CONNECTING);
    if (!lws_client_connect_via_info(&info) && c->state == STATE_CONNECTING) /* else the callback has told it */
        on_no_connection(c, "no socket can be had", 20);
}

/* What silence means in each state. */
static void watch_time(struct connection *c)
{
    const int64_t now = clock_ms();

    if (c->state == STATE_OPEN && now - c->since_ms > WELCOME_MS) {
        snprintf(c->complaint, sizeof(c->complaint), "no welcome within %d s", WELCOME_MS / 1000);
        lws_set_timeout(c->wsi, PENDING_TIMEOUT_USER_REASON_BASE, LWS_TO_KILL_ASYNC);
    }
    if (c->state == STATE_CLOSING && now - c->since_ms > CLOSING_MS)
        connection_over(c, c->end, c->why.text);
    if (c->state == STATE_WELCOMED && now - c->pinged_ms > PING_MS)
        connection_ping(c);
    if (c->stopping && (c->state == STATE_AWAY || c->state == STATE_CONNECTING))
        connection_over(c, c->end, c->why.text);
}

static void on_tick(lws_sorted_usec_list_t *sul)
{
    struct connection *c = lws_container_of(sul, struct connection, tick);

    if (c->desc.hooks.tick)
        c->desc.hooks.tick(c->desc.user);
    watch_time(c);
    lws_sul_schedule(c->context, 0, &c->tick, on_tick, TICK_US);
}

void connection_tick_within(struct connection *c, int64_t us)
{
    lws_sul_schedule(c->context, 0, &c->tick, on_tick, us < TICK_US ? us : TICK_US);
}

static void on_established(struct connection *c)
{
    connection_move_to(c, STATE_OPEN);
    connection_queue(c, c->desc.hooks.hello(c->desc.user));
}

static int callback(struct lws *wsi, enum lws_callback_reasons reason, void *user, void *in, size_t size)
{
    struct connection *c = lws_context_user(lws_get_context(wsi));

    (void)user;
    switch (reason) {
    case LWS_CALLBACK_CLIENT_FILTER_PRE_ESTABLISH:
        c->wsi = wsi;
        return lws_hdr_total_length(wsi, WSI_TOKEN_PROTOCOL) > 0 ? 0 : -1;
    case LWS_CALLBACK_CLIENT_ESTABLISHED: on_established(c); break;
    case LWS_CALLBACK_CLIENT_CONNECTION_ERROR:
        c->wsi = wsi;
        on_no_connection(c, in, in ? strlen(in) : 0);
        break;
    case LWS_CALLBACK_CLIENT_RECEIVE: connection_receive(c, in, size); break;
    case LWS_CALLBACK_CLIENT_WRITEABLE: return c->wsi ? connection_write_more(c) : 0;
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

/* lws speaks of every refused connection as of an error of its own. */
static void no_log(int level, const char *line)
{
    (void)level;
    (void)line;
}

enum err connection_create(const struct connection_desc *d, struct connection **out, struct reason *why)
{
    struct connection *c = mem_alloc(1, sizeof(*c));

    *out = NULL;
    if (!c)
        return err_say(why, ERR_NOMEM, "no memory for a connection");
    c->desc = *d;
    c->rng.state = rng_mix((uint64_t)clock_wall_us(), (uint64_t)getpid());
    const enum err e = address_parse(d->url, &c->address, why);
    if (e) {
        mem_free(c);
        return e;
    }
    c->protocols[0] = (struct lws_protocols){ .name = PROTOCOL_NAME,
                                              .callback = callback,
                                              .rx_buffer_size = CONNECTION_CHUNK,
                                              .tx_packet_size = CONNECTION_CHUNK };
    const struct lws_context_creation_info info = {
        .port = CONTEXT_PORT_NO_LISTEN,
        .protocols = c->protocols,
        .gid = (gid_t)-1,
        .uid = (uid_t)-1,
        .user = c,
        .fd_limit_per_thread = 16,
        .pt_serv_buf_size = CONNECTION_CHUNK,
        .retry_and_idle_policy = &validity,
    };
    lws_set_log_level(0, no_log);
    c->context = lws_create_context(&info);
    if (!c->context) {
        mem_free(c);
        return err_say(why, ERR_NOMEM, "libwebsockets could not be started");
    }
    *out = c;
    return ERR_OK;
}

enum connection_end connection_run(struct connection *c, struct reason *why)
{
    c->away_ms = clock_ms();
    lws_sul_schedule(c->context, 0, &c->tick, on_tick, TICK_US);
    dial(c);
    while (!c->over && lws_service(c->context, 0) >= 0)
        continue;
    connection_over(c, CONNECTION_LOST, "the network's event loop failed");
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
    lws_context_destroy(context);
    connection_outbox_clear(c);
    mem_free(c->in.bytes);
    mem_free(c);
}
