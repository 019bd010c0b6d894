#include "net/stream/server.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "base/process.h"
#include "net/stream/internal.h"

#include <arpa/inet.h>
#include <assert.h>
#include <errno.h>
#include <netinet/in.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/random.h>
#include <sys/socket.h>
#include <unistd.h>

#define TOKEN_MAX 255 /* bytes, as in PROTOCOL.md 4.1.3 */

enum { CONNECTIONS_DEFAULT = 128, CONNECTIONS_MAX = 4096, PER_ADDRESS_DEFAULT = 32, SILENT_DEFAULT_S = 10 };

/* libwebsockets logs every client's mistake as an error of its own. */
static void route_log(int level, const char *line)
{
    const size_t length = strcspn(line, "\n");

    if (level & LLL_ERR)
        log_debug("libwebsockets: %.*s", (int)length, line);
}

#define OTHER_FDS 64 /* for listening and waking, and connections that are being closed */

struct address {
    struct sockaddr_storage socket;
    socklen_t size;
    bool six;
    bool loopback;
};

static enum err address_parse(const char *text, uint16_t port, struct address *a, struct reason *why)
{
    struct sockaddr_in *four = (struct sockaddr_in *)&a->socket;
    struct sockaddr_in6 *six = (struct sockaddr_in6 *)&a->socket;

    *a = (struct address){ 0 };
    if (inet_pton(AF_INET, text, &four->sin_addr) == 1) {
        four->sin_family = AF_INET;
        four->sin_port = htons(port);
        a->size = sizeof(*four);
        a->loopback = ntohl(four->sin_addr.s_addr) >> 24 == 127;
    } else if (inet_pton(AF_INET6, text, &six->sin6_addr) == 1) {
        six->sin6_family = AF_INET6;
        six->sin6_port = htons(port);
        a->size = sizeof(*six);
        a->six = true;
        a->loopback = IN6_IS_ADDR_LOOPBACK(&six->sin6_addr);
    } else {
        return err_say(why, ERR_USAGE, "--bind %s: not a numeric IPv4 or IPv6 address, nor localhost", text);
    }
    return ERR_OK;
}

/* libwebsockets does not say why it cannot listen; so try the address first, under the same rules. */
static enum err address_try(const struct address *a, const char *text, uint16_t port, struct reason *why)
{
    const int on = 1;
    enum err e = ERR_OK;
    const int fd = socket(a->socket.ss_family, SOCK_STREAM, 0);

    if (fd < 0)
        return err_say(why, ERR_IO, "%s: no socket: %s", text, strerror(errno));
    if (setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on)) != 0 ||
        bind(fd, (const struct sockaddr *)&a->socket, a->size) != 0 || listen(fd, 1) != 0) {
        if (errno == EADDRINUSE)
            err_say(why, ERR_IO, "port %u at %s is in use by another program; choose one with --port", port, text);
        else
            err_say(why, ERR_IO, "cannot listen on port %u at %s: %s", port, text, strerror(errno));
        e = ERR_IO;
    }
    close(fd);
    return e;
}

static enum err copy_address(struct server *s, const char *wanted, struct reason *why)
{
    const char *address = wanted && wanted[0] ? wanted : "127.0.0.1";

    if (strcmp(address, "localhost") == 0)
        address = "127.0.0.1";
    if (strlen(address) >= sizeof(s->address))
        return err_say(why, ERR_USAGE, "--bind %.40s...: not an address", address);
    memcpy(s->address, address, strlen(address) + 1);
    return ERR_OK;
}

static enum err copy_proxy(struct server *s, const char *proxy, struct reason *why)
{
    if (address_read(proxy ? proxy : "127.0.0.1", s->proxies[0]) && address_read(proxy ? proxy : "::1", s->proxies[1]))
        return ERR_OK;
    return err_say(why, ERR_USAGE, "--proxy-address %s: not a numeric IPv4 or IPv6 address", proxy);
}

static uint32_t or_default(uint32_t given, uint32_t otherwise)
{
    return given ? given : otherwise;
}

static enum err copy_limits(struct server *s, const struct server_desc *desc, struct reason *why)
{
    s->frame_ms = or_default(desc->frame_ms, STREAM_FRAME_MS);
    s->max_frame_bytes = desc->max_frame_bytes ? desc->max_frame_bytes : INGEST_FRAME_BYTES;
    s->limits.most_admitted = or_default(desc->max_connections, CONNECTIONS_DEFAULT);
    s->limits.per_address = or_default(desc->max_per_address, PER_ADDRESS_DEFAULT);
    s->limits.per_address_given = desc->max_per_address != 0;
    s->silent_s = or_default(desc->silent_s, SILENT_DEFAULT_S);
    if (s->limits.most_admitted > CONNECTIONS_MAX)
        return err_say(why, ERR_USAGE, "at most %d connections can be allowed", CONNECTIONS_MAX);
    return limits_init(&s->limits, s->limits.most_admitted + ARRIVING_MOST + OTHER_FDS)
               ? ERR_OK
               : err_say(why, ERR_NOMEM, "out of memory");
}

static enum err copy_text(char **out, const char *text, struct reason *why)
{
    if (!text || !text[0])
        return ERR_OK;
    *out = mem_text(text);
    return *out ? ERR_OK : err_say(why, ERR_NOMEM, "out of memory");
}

/* No message contains a token. */
static enum err copy_token(char **out, const char *name, const char *token, struct reason *why)
{
    const size_t length = token ? strlen(token) : 1;

    if (length < 1 || length > TOKEN_MAX)
        return err_say(why, ERR_USAGE, "--token-%s: a token has 1 to %d bytes, not %zu", name, TOKEN_MAX, length);
    return copy_text(out, token, why);
}

static enum err copy_secrets(struct server *s, const struct server_desc *desc, struct reason *why)
{
    enum err e = copy_token(&s->token_metrics, "metrics", desc->token_metrics, why);

    for (int r = 0; r < SERVER_ROLES && !e; r++)
        e = copy_token(&s->tokens[r], server_role_names[r], desc->tokens[r], why);
    if (!e && !desc->tls_cert != !desc->tls_key)
        e = err_say(why, ERR_USAGE, "--tls-cert and --tls-key need each other");
    if (!e)
        e = copy_text(&s->tls_cert, desc->tls_cert, why);
    if (!e)
        e = copy_text(&s->tls_key, desc->tls_key, why);
    if (!e && desc->tls_cert)
        e = tls_load(desc->tls_cert, desc->tls_key, &s->tls, why);
    return e;
}

static enum err copy_desc(struct server *s, const struct server_desc *desc, struct reason *why)
{
    uint64_t random;
    enum err e = copy_address(s, desc->address, why);

    s->allow_remote = desc->allow_remote;
    s->push = desc->push;
    s->h264 = desc->h264;
    s->controls = desc->controls;
    s->new_work = desc->new_work;
    s->leave = desc->leave;
    s->behind_proxy = desc->behind_proxy;
    if (!e)
        e = copy_proxy(s, desc->proxy, why);
    if (!e)
        e = copy_limits(s, desc, why);
    if (!e)
        e = copy_secrets(s, desc, why);
    if (!e)
        e = copy_text(&s->public_names, desc->public_names, why);
    if (!e)
        e = embed_policy(desc->embed_from, &s->embed_policy, why);
    if (e)
        return e;
    if (getrandom(&random, sizeof(random), 0) != sizeof(random))
        return err_say(why, ERR_IO, "no random number for the session: %s", strerror(errno));
    snprintf(s->session, sizeof(s->session), "%016llx", (unsigned long long)random);
    return ERR_OK;
}

/* Thread: service. */
static void tick(lws_sorted_usec_list_t *sul)
{
    struct server *s = lws_container_of(sul, struct server, tick);

    metrics_tick(s, stream_now_us(), STREAM_STATUS_US);
    if (s->leave && atomic_load(s->leave) && !s->leaving) /* the main thread may be busy for a while */
        server_drain(s);
    server_take_change(s);
    websockets_tick(s);
    watchers_tick(s);
    limits_tick(&s->limits, stream_now_us());
    lws_sul_schedule(s->context, 0, &s->tick, tick, STREAM_STATUS_US);
}

static void *serve(void *arg)
{
    struct server *s = arg;
    int64_t leave_us = 0;

    metrics_tick(s, stream_now_us(), STREAM_STATUS_US);
    lws_sul_schedule(s->context, 0, &s->tick, tick, STREAM_STATUS_US);
    for (;;) {
        if (lws_service(s->context, 0) < 0)
            break;
        if (!atomic_load(&s->stopping))
            continue;
        /* Leave when the last client has gone or time is up; the tick keeps this loop awake. */
        if (leave_us == 0)
            leave_us = (int64_t)lws_now_usecs() + STREAM_GOODBYE_US;
        if ((!s->websockets && !s->watchers) || (int64_t)lws_now_usecs() > leave_us)
            break;
    }
    lws_sul_cancel(&s->tick);
    return NULL;
}

/* How many descriptors connections may use. Where the process may not have as many as wanted, arriving connections and
 * those that leave keep a quarter each. */
static uint32_t share_descriptors(struct server *s)
{
    struct limits *l = &s->limits;
    const uint32_t wanted = l->most_admitted + ARRIVING_MOST + OTHER_FDS;
    const uint32_t allowed = process_connections_allowed(wanted);

    l->most_arriving = ARRIVING_MOST;
    if (allowed < wanted) {
        const uint32_t quarter = allowed / 4;
        l->most_arriving = quarter < ARRIVING_MOST ? quarter : ARRIVING_MOST;
        const uint32_t left = allowed - l->most_arriving - (quarter < OTHER_FDS ? quarter : OTHER_FDS);
        l->most_admitted = left < l->most_admitted ? left : l->most_admitted;
    }
    return allowed;
}

/* Describes context and vhost: no extensions (permessage-deflate of 4.1.6 has known faults, and images do not
 * compress), bounded tables, short time-outs. */
static struct lws_context *context_create(struct server *s, const struct address *a, uint16_t port)
{
    s->protocols[0] = (struct lws_protocols){ .name = "http",
                                              .callback = http_callback,
                                              .per_session_data_size = sizeof(struct http_session),
                                              .tx_packet_size = STREAM_CHUNK };
    s->protocols[1] = (struct lws_protocols){ .name = PROTOCOL_NAME,
                                              .callback = websocket_callback,
                                              .per_session_data_size = sizeof(struct websocket *),
                                              .rx_buffer_size = STREAM_RECEIVE,
                                              .tx_packet_size = STREAM_CHUNK + LWS_PRE };
    s->validity = (lws_retry_bo_t){ .secs_since_valid_ping = (uint16_t)s->silent_s,
                                    .secs_since_valid_hangup = (uint16_t)(s->silent_s * 5 / 2) };

    const uint32_t descriptors = share_descriptors(s);
    struct lws_context_creation_info info = {
        .port = port,
        .iface = s->address,
        .protocols = s->protocols,
        .gid = (gid_t)-1,
        .uid = (uid_t)-1,
        .user = s,
        .options = LWS_SERVER_OPTION_FAIL_UPON_UNABLE_TO_BIND | (a->six ? 0 : LWS_SERVER_OPTION_DISABLE_IPV6),
        .fd_limit_per_thread = descriptors,
        .max_http_header_pool = (unsigned short)descriptors, /* no connection waits for a header buffer */
        .max_http_header_data = 8192,
        .pt_serv_buf_size = STREAM_RECEIVE,
        .timeout_secs = 5,
        .timeout_secs_ah_idle = 5,
        .keepalive_timeout = 5,
        .retry_and_idle_policy = &s->validity,
        .headers = http_headers(),
        .server_string = "relightd",
    };
    if (s->tls_cert) {
        info.options |= LWS_SERVER_OPTION_DO_SSL_GLOBAL_INIT;
        info.ssl_cert_filepath = s->tls_cert;
        info.ssl_private_key_filepath = s->tls_key;
        info.alpn = "http/1.1"; /* HTTP/2 of 4.1.6 has known faults */
    }
    return lws_create_context(&info);
}

/* Beyond loopback every role requires a token. Without one for controllers that role is not offered; nor is that of
 * recorders without one where viewers or producers require theirs. */
static enum err check_tokens(struct server *s, const struct address *a, struct reason *why)
{
    s->loopback = a->loopback;
    s->controllers = a->loopback || s->tokens[SERVER_CONTROLLER];
    const bool open = a->loopback && !s->tokens[SERVER_VIEWER] && !s->tokens[SERVER_PRODUCER];
    s->recorders = s->push && (open || s->tokens[SERVER_RECORDER]);
    if (!a->loopback && !s->tokens[SERVER_VIEWER])
        return err_say(why, ERR_USAGE, "--bind %s: anyone on the network could watch; --token-viewer is required",
                       s->address);
    if (!a->loopback && s->push && !s->tokens[SERVER_PRODUCER])
        return err_say(why, ERR_USAGE, "--bind %s: anyone on the network could send; --token-producer is required",
                       s->address);
    return ERR_OK;
}

/* Whether the server may listen on its address with these roles and tokens. */
static enum err check_address(struct server *s, uint16_t port, struct address *a, struct reason *why)
{
    const enum err e = address_parse(s->address, port, a, why);

    if (e)
        return e;
    if (!a->loopback && !s->allow_remote)
        return err_say(why, ERR_USAGE,
                       "--bind %s: anyone on the network could connect; an address other than loopback requires "
                       "--token-viewer, --token-controller and --token-producer",
                       s->address);
    return check_tokens(s, a, why);
}

enum err server_may_listen(struct server *s, uint16_t port, struct reason *why)
{
    struct address a;

    return check_address(s, port, &a, why);
}

static enum err start(struct server *s, const struct server_desc *desc, struct reason *why)
{
    struct address a;
    sigset_t all, before;
    enum err e = check_address(s, desc->port, &a, why);

    if (!e)
        e = address_try(&a, s->address, desc->port, why);
    if (e)
        return e;
    lws_set_log_level(LLL_ERR, route_log);
    s->context = context_create(s, &a, desc->port);
    if (!s->context)
        return err_say(why, ERR_IO, "cannot listen on port %u at %s", desc->port, s->address);
    s->port = (uint16_t)lws_get_vhost_listen_port(lws_get_vhost_by_name(s->context, "default"));
    snprintf(s->url, sizeof(s->url), a.six ? "http%s://[%s]:%u/" : "http%s://%s:%u/", s->tls_cert ? "s" : "",
             s->address, s->port);

    server_log_certificate(s); /* before the service thread owns it */
    /* Signals go to the main thread. */
    sigfillset(&all);
    pthread_sigmask(SIG_BLOCK, &all, &before);
    const int failed = pthread_create(&s->thread, NULL, serve, s);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    if (failed)
        return err_say(why, ERR_NOMEM, "no thread for the network: %s", strerror(failed));
    s->running = true;
    return ERR_OK;
}

struct server *server_prepare(const struct server_desc *desc, enum err *e, struct reason *why)
{
    struct server *s = mem_alloc(1, sizeof(*s));

    if (!s) {
        *e = err_say(why, ERR_NOMEM, "out of memory");
        return NULL;
    }
    pthread_mutex_init(&s->lock, NULL);
    clock_condition(&s->ingest.arrived);
    *e = copy_desc(s, desc, why);
    return s;
}

enum err server_create(const struct server_desc *desc, struct server **out, struct reason *why)
{
    char web_dir[4096];
    enum err e;

    *out = NULL;
    struct server *s = server_prepare(desc, &e, why);
    if (e)
        goto failed;
    e = site_folder(desc->web_dir, web_dir, sizeof(web_dir), why);
    if (!e)
        e = site_load(&s->site, web_dir, why);
    if (!e)
        e = start(s, desc, why);
    if (e)
        goto failed;
    *out = s;
    return ERR_OK;
failed:
    server_destroy(s);
    return e;
}

void server_drain(struct server *s)
{
    if (!s->running)
        return;
    atomic_store(&s->stopping, true);
    lws_cancel_service(s->context);
}

void server_destroy(struct server *s)
{
    if (!s)
        return;
    server_drain(s);
    if (s->running)
        pthread_join(s->thread, NULL);
    if (s->context)
        lws_context_destroy(s->context); /* calls back for every open connection */
    for (int k = 0; k < STREAM_KINDS; k++)
        image_unref(s->latest[k]);
    for (int r = 0; r < SERVER_ROLES; r++)
        mem_free(s->tokens[r]);
    mem_free(s->token_metrics);
    mem_free(s->public_names);
    mem_free(s->embed_policy);
    mem_free(s->tls_cert);
    mem_free(s->tls_key);
    tls_destroy(s->tls);
    limits_finish(&s->limits);
    server_destroy(s->next);
    chains_clear(s, 0);
    message_free(s->status);
    message_free(s->control.shared);
    inspections_finish(&s->inspections);
    ingest_finish(&s->ingest);
    site_finish(&s->site);
    pthread_mutex_destroy(&s->lock);
    mem_free(s);
}

uint16_t server_port(const struct server *s)
{
    return s->port;
}

const char *server_url(const struct server *s)
{
    return s->url;
}

unsigned image_kind(const struct sent_image *p)
{
    const struct protocol_picture *header = image_header(p);
    uint64_t serial;
    const int rendition = image_rendition(p, &serial);

    if (rendition >= 0)
        return STREAM_RENDITIONS + (unsigned)rendition;
    if (header->format == PROTOCOL_H264)
        return STREAM_TRACKS + image_track(p);
    if (header->format == PROTOCOL_JPEG && header->flags & PROTOCOL_PICTURE_HALF)
        return STREAM_JPEG_HALF;
    if (header->format == PROTOCOL_JPEG && header->flags & PROTOCOL_PICTURE_QUARTER)
        return STREAM_JPEG_QUARTER;
    return header->format;
}

double server_track_rate(unsigned track)
{
    const unsigned index = track % SERVER_RATES;

    return index == 0 ? 0.0 : 120.0 / (double)(1u << index);
}

/* The fastest rate not above `most`, or else the slowest. */
static unsigned rate_index(double most)
{
    unsigned index = 0;

    while (most > 0.0 && index < SERVER_RATES - 1 && (index == 0 || server_track_rate(index) > most))
        index++;
    return index;
}

unsigned subscribed_kind(const struct server *s, const struct message *wish)
{
    const uint32_t width = wish->subscribe.max_width, height = wish->subscribe.max_height;
    unsigned scale = 0;

    if (wish->subscribe.format != PROTOCOL_JPEG && wish->subscribe.format != PROTOCOL_H264)
        return wish->subscribe.format;
    while (scale < 2 &&
           ((width && s->figures.width >> scale > width) || (height && s->figures.height >> scale > height)))
        scale++;
    if (wish->subscribe.format == PROTOCOL_H264)
        return STREAM_TRACKS + scale * SERVER_RATES + rate_index(wish->subscribe.max_rate);
    return scale == 0 ? PROTOCOL_JPEG : scale == 1 ? STREAM_JPEG_HALF : STREAM_JPEG_QUARTER;
}

/* A frame's first image gives its age; repeated and refined images have no new times. */
static void observe(struct server *s, unsigned kind, const struct protocol_picture *h)
{
    struct metrics *m = &s->metrics;
    const unsigned counted = metrics_kind(kind);

    atomic_fetch_add(&m->published[counted], 1);
    if (h->flags & PROTOCOL_PICTURE_REPEAT)
        return;
    histogram_add(&m->encode[counted], 1e-6 * h->encoded_us);
    if (h->flags & PROTOCOL_PICTURE_FINER || h->capture_us == 0 || h->capture_us == s->captured_us)
        return;
    s->captured_us = h->capture_us;
    server_observe(s, SERVER_CAPTURED, 1e-6 * (double)(h->published_us - h->capture_us));
}

struct sent_image *server_place(struct server *s, struct sent_image *p, uint8_t flags)
{
    const unsigned kind = image_kind(p);

    assert(kind >= PROTOCOL_JPEG && kind < STREAM_KINDS);
    if (kind >= STREAM_RENDITIONS && !rendition_is_wanted(s, p))
        return p; /* its slot has another use by now */
    struct sent_image *old = s->latest[kind];
    image_stamp(p, ++s->issued[kind], s->begun, clock_wall_us(), flags);
    s->latest[kind] = p;
    observe(s, kind, image_header(p));
    if (kind >= STREAM_TRACKS && kind < STREAM_RENDITIONS)
        chain_place(s, p);
    s->published++;
    return old;
}

void server_publish(struct server *s, struct sent_image *image)
{
    pthread_mutex_lock(&s->lock);
    struct sent_image *old = server_place(s, image, 0);
    pthread_mutex_unlock(&s->lock);
    image_unref(old);
    lws_cancel_service(s->context); /* the only libwebsockets call allowed on other threads */
}

void server_begin_image(struct server *s)
{
    pthread_mutex_lock(&s->lock);
    s->begun++;
    pthread_mutex_unlock(&s->lock);
}

void server_set_figures(struct server *s, const struct server_figures *f)
{
    pthread_mutex_lock(&s->lock);
    const bool news = s->figures.source != f->source || strcmp(s->figures.detail, f->detail) != 0;
    const bool resized = s->figures.width != f->width || s->figures.height != f->height;
    s->figures = *f;
    message_free(s->status);
    s->status = NULL;
    pthread_mutex_unlock(&s->lock);
    if (news)
        atomic_store(&s->urgent, true);
    if (resized)
        atomic_store(&s->resized, true);
    if (news || resized)
        lws_cancel_service(s->context);
}

void server_demand(struct server *s, struct server_demand *out)
{
    pthread_mutex_lock(&s->lock);
    *out = s->demand;
    out->h264_keys = s->keys_wanted & out->h264;
    ingest_demand(&s->ingest, out);
    pthread_mutex_unlock(&s->lock);
}

void server_counters(struct server *s, struct server_counters *out)
{
    const struct stream_counts *c = &s->counts;

    *out = (struct server_counters){
        .connections = atomic_load(&c->connections),
        .open = atomic_load(&c->open),
        .refused = atomic_load(&c->refused),
        .errors = atomic_load(&c->errors),
        .sent = atomic_load(&c->sent),
        .skipped = atomic_load(&c->skipped),
        .acked = atomic_load(&c->acked),
        .bytes = atomic_load(&c->bytes),
        .stalled = atomic_load(&c->stalled),
        .crowded = atomic_load(&s->limits.reached[LIMIT_ADDRESS].reached),
        .wrong_tokens = atomic_load(&c->wrong_tokens),
        .too_fast = atomic_load(&c->too_fast),
        .frames_cut = atomic_load(&c->frames_cut),
        .frame_bytes = atomic_load(&c->frame_bytes),
    };
    pthread_mutex_lock(&s->lock);
    out->published = s->published;
    out->frames_received = s->ingest.received;
    out->frames_superseded = s->ingest.superseded;
    out->frames_refused = s->ingest.refused;
    out->frames_repeated = s->ingest.repeated;
    pthread_mutex_unlock(&s->lock);
}
