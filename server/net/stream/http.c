#include "net/stream/internal.h"

#include "base/mem.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <sys/socket.h>

/* Extracts the name from "name", "name:port" or "[::1]:port", without brackets. */
static bool host_name(const char *host, char *out, size_t size)
{
    const bool six = host[0] == '[';
    const char *begin = host + six;
    const size_t length = strcspn(begin, six ? "]" : ":");
    const char *port = begin + length + six;

    if (length == 0 || length >= size || (six && !begin[length]) ||
        (*port && (*port != ':' || port[1 + strspn(port + 1, "0123456789")])))
        return false;
    memcpy(out, begin, length);
    out[length] = 0;
    return true;
}

/* Whether the comma-separated list contains the name. */
static bool is_listed(const char *list, const char *name)
{
    const size_t length = strlen(name);

    for (const char *at = list;; at++) {
        const size_t next = strcspn(at, ",");
        if (next == length && strncasecmp(at, name, length) == 0)
            return true;
        at += next;
        if (!*at)
            return false;
    }
}

bool http_is_address(const struct sockaddr_storage *local, const char *name)
{
    const struct sockaddr_in6 *six = (const struct sockaddr_in6 *)local;
    const struct sockaddr_in *four = (const struct sockaddr_in *)local;
    struct in6_addr named;

    if (inet_pton(AF_INET6, name, &named) == 1)
        return local->ss_family == AF_INET6 && memcmp(&named, &six->sin6_addr, sizeof(named)) == 0;
    if (inet_pton(AF_INET, name, &named) != 1)
        return false;
    if (local->ss_family == AF_INET6) /* a dual-stack socket maps IPv4 to the last four bytes */
        return IN6_IS_ADDR_V4MAPPED(&six->sin6_addr) && memcmp(&named, six->sin6_addr.s6_addr + 12, 4) == 0;
    return memcmp(&named, &four->sin_addr, 4) == 0;
}

/* Whether the name is the numeric address at which this connection reached us. A page that an attacker's DNS lets in
 * has a name, never a number. */
static bool is_local_address(struct lws *wsi, const char *name)
{
    struct sockaddr_storage local = { 0 };
    socklen_t size = sizeof(local);

    return getsockname(lws_get_socket_fd(wsi), (struct sockaddr *)&local, &size) == 0 && http_is_address(&local, name);
}

bool http_host_ok(const struct server *s, struct lws *wsi)
{
    char host[256], name[256];

    if (lws_hdr_copy(wsi, host, sizeof(host), WSI_TOKEN_HOST) <= 0 || !host_name(host, name, sizeof(name)))
        return false;
    /* A name that an attacker's DNS points at 127.0.0.1 is still the attacker's name. */
    return address_is_loopback(name) || is_local_address(wsi, name) ||
           (s->public_names && is_listed(s->public_names, name));
}

bool http_origin_ok(struct lws *wsi)
{
    char host[256], origin[256];

    if (lws_hdr_total_length(wsi, WSI_TOKEN_ORIGIN) == 0)
        return true; /* not a browser */
    if (lws_hdr_copy(wsi, origin, sizeof(origin), WSI_TOKEN_ORIGIN) <= 0 ||
        lws_hdr_copy(wsi, host, sizeof(host), WSI_TOKEN_HOST) <= 0)
        return false;
    const char *authority = strstr(origin, "://");
    return authority && strcasecmp(authority + 3, host) == 0;
}

/* Header of a request by its name with the colon; "": it has none. */
static const char *header(struct lws *wsi, const char *name, char *out, size_t size)
{
    const int length = (int)strlen(name);

    out[0] = 0;
    if (lws_hdr_custom_length(wsi, name, length) >= 0 && lws_hdr_custom_copy(wsi, out, (int)size, name, length) < 0)
        snprintf(out, size, "too long");
    return out;
}

bool http_is_foreign(struct lws *wsi, bool framed)
{
    char site[32], mode[32], dest[32], purpose[64];

    if (!header(wsi, "sec-fetch-site:", site, sizeof(site))[0] || strcmp(site, "same-origin") == 0 ||
        strcmp(site, "none") == 0)
        return false; /* no browser, this page, or its user */
    header(wsi, "sec-fetch-mode:", mode, sizeof(mode));
    header(wsi, "sec-fetch-dest:", dest, sizeof(dest));
    /* A link: it leads the user here. A page that is fetched before somebody wants it is none. */
    const bool frame = strcmp(dest, "iframe") == 0 || strcmp(dest, "frame") == 0;
    return strcmp(mode, "navigate") != 0 || !(strcmp(dest, "document") == 0 || (framed && frame)) ||
           header(wsi, "sec-purpose:", purpose, sizeof(purpose))[0];
}

/* libwebsockets ends a path at ; and &, proxies do not: what is guarded there under one name would have others here. */
static bool is_whole(struct lws *wsi, const char *path)
{
    const enum lws_token_indexes token =
        lws_hdr_total_length(wsi, WSI_TOKEN_HEAD_URI) > 0 ? WSI_TOKEN_HEAD_URI : WSI_TOKEN_GET_URI;
    char all[256], rest[256];

    return lws_hdr_copy(wsi, all, sizeof(all), token) > 0 && strcmp(all, path) == 0 &&
           lws_hdr_copy_fragment(wsi, rest, sizeof(rest), token, 1) < 0;
}

static bool may_be_framed(const struct server *s, const char *path)
{
    return strcmp(path, "/embed") == 0 && !strstr(s->embed_policy, "frame-ancestors 'none'");
}

#define POLICY                                                                                                         \
    "default-src 'none'; script-src 'self'; worker-src 'self'; style-src 'self'; img-src 'self'; "                     \
    "media-src 'self' blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors "

/* Security headers of every answer. The page needs only its own server. */
const struct lws_protocol_vhost_options *http_headers(void)
{
    static const struct lws_protocol_vhost_options opener = { NULL, NULL,
                                                              "cross-origin-opener-policy:", "same-origin" };
    static const struct lws_protocol_vhost_options owner = { &opener, NULL,
                                                             "cross-origin-resource-policy:", "same-origin" };
    static const struct lws_protocol_vhost_options senses = {
        &owner, NULL, "permissions-policy:", "camera=(), microphone=(), geolocation=(), payment=(), usb=()"
    };
    static const struct lws_protocol_vhost_options frames = { &senses, NULL, "x-frame-options:", "DENY" };
    static const struct lws_protocol_vhost_options referrer = { &frames, NULL, "referrer-policy:", "no-referrer" };
    static const struct lws_protocol_vhost_options sniff = { &referrer, NULL, "x-content-type-options:", "nosniff" };
    static const struct lws_protocol_vhost_options policy = { &sniff, NULL,
                                                              "content-security-policy:", POLICY "'none'" };

    return &policy;
}

static bool is_origin(const char *text, size_t length)
{
    static const char letters[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-:[]";
    const size_t scheme = strncmp(text, "https://", 8) == 0 ? 8 : strncmp(text, "http://", 7) == 0 ? 7 : 0;

    return scheme > 0 && length > scheme && length < 256 && strspn(text + scheme, letters) >= length - scheme;
}

enum err embed_policy(const char *origins, char **out, struct reason *why)
{
    const char *list = origins && origins[0] ? origins : "'none'";
    const char *at = origins ? origins : "";

    for (size_t length; *at; at += length + (at[length] == ',')) {
        length = strcspn(at, ",");
        if (!is_origin(at, length))
            return err_say(why, ERR_USAGE,
                           "--embed-from %.*s: not an origin such as https://example.org or http://192.168.1.5:8000",
                           (int)length, at);
    }
    const size_t size = sizeof(POLICY) + strlen(list);
    *out = mem_alloc(size, 1);
    if (!*out)
        return err_say(why, ERR_NOMEM, "out of memory");
    snprintf(*out, size, "%s%s", POLICY, list);
    for (char *c = *out + sizeof(POLICY) - 1; *c; c++)
        *c = *c == ',' ? ' ' : *c;
    return ERR_OK;
}

static bool put(struct lws *wsi, const char *name, const char *value, uint8_t **p, uint8_t *end)
{
    return lws_add_http_header_by_name(wsi, (const uint8_t *)name, (const uint8_t *)value, (int)strlen(value), p,
                                       end) == 0;
}

/* A head with a policy of its own for frames: libwebsockets would add that of all others. */
static bool put_framed(struct lws *wsi, const struct http_head *h, uint8_t **p, uint8_t *end)
{
    const int n = snprintf((char *)*p, (size_t)(end - *p), "HTTP/1.1 %u %s\r\n", h->status,
                           h->status == 304 ? "Not Modified" : "OK");

    if (n < 0 || n >= end - *p)
        return false;
    *p += n;
    for (const struct lws_protocol_vhost_options *o = http_headers(); o; o = o->next)
        if (strcmp(o->name, "x-frame-options:") != 0 &&
            !put(wsi, o->name, strcmp(o->name, "content-security-policy:") == 0 ? h->policy : o->value, p, end))
            return false;
    return put(wsi, "content-type:", h->type, p, end) &&
           (h->status == 304 || lws_add_http_header_content_length(wsi, h->size, p, end) == 0);
}

/* Writes the header into out; NULL when it does not fit. */
static uint8_t *put_header(struct lws *wsi, const struct http_head *h, uint8_t *out, uint8_t *end)
{
    const lws_filepos_t size = h->status == 304 || h->endless ? LWS_ILLEGAL_HTTP_CONTENT_LEN : h->size;
    uint8_t *p = out;

    if (h->policy ? !put_framed(wsi, h, &p, end)
                  : lws_add_http_common_headers(wsi, h->status, h->type, size, &p, end) != 0)
        return NULL;
    if (!put(wsi, "cache-control:", h->fresh ? "no-store" : "no-cache", &p, end) || /* no-cache: 304 while unchanged */
        (h->etag && !put(wsi, "etag:", h->etag, &p, end)) ||
        (h->asks_password && !put(wsi, "www-authenticate:", "Basic realm=\"relightd\"", &p, end)) ||
        lws_finalize_http_header(wsi, &p, end))
        return NULL;
    return p;
}

int http_send_head(struct lws *wsi, const struct http_head *h)
{
    uint8_t buffer[LWS_PRE + 4096], *begin = buffer + LWS_PRE;
    const uint8_t *end = put_header(wsi, h, begin, buffer + sizeof(buffer) - 1);

    return end && lws_write(wsi, begin, (size_t)(end - begin), LWS_WRITE_HTTP_HEADERS) >= 0 ? 0 : -1;
}

/* Sends the header; the body (bytes that outlive the request) follows unless this is a HEAD. */
static int respond(struct lws *wsi, struct http_session *h, const struct http_head *head, const uint8_t *bytes,
                   bool without_body)
{
    if (http_send_head(wsi, head) != 0)
        return -1;
    h->bytes = bytes;
    h->left = without_body || head->status == 304 ? 0 : head->size;
    if (h->left == 0)
        return lws_http_transaction_completed(wsi) ? -1 : 0;
    lws_callback_on_writable(wsi);
    return 0;
}

int http_respond_text(struct lws *wsi, unsigned status, const char *type, const char *text, bool head)
{
    uint8_t buffer[LWS_PRE + 3072], *begin = buffer + LWS_PRE;
    const struct http_head h = {
        .status = status, .type = type, .size = strlen(text), .fresh = status >= 400, .asks_password = status == 401
    };
    uint8_t *end = put_header(wsi, &h, begin, buffer + 2048);

    if (!end || h.size > 1024)
        return -1;
    if (!head) {
        memcpy(end, text, h.size);
        end += h.size;
    }
    if (lws_write(wsi, begin, (size_t)(end - begin), LWS_WRITE_HTTP_HEADERS) < 0)
        return -1;
    return lws_http_transaction_completed(wsi) ? -1 : 0;
}

static void forget_text(struct http_session *h)
{
    mem_free(h->text);
    h->text = NULL;
    h->bytes = NULL;
    h->left = 0;
}

int http_respond_long(struct lws *wsi, struct http_session *h, const char *type, char *text, size_t size, bool head)
{
    forget_text(h);
    h->text = text;
    return respond(wsi, h, &(struct http_head){ .status = 200, .type = type, .size = size }, (uint8_t *)text, head);
}

/* Refuses a request and closes its connection, so that nothing else on it is read. */
int http_refuse(struct server *s, struct lws *wsi, unsigned status, const char *text)
{
    atomic_fetch_add(&s->counts.refused, 1);
    http_respond_text(wsi, status, "text/plain; charset=utf-8", text, false);
    return -1;
}

static int answer_request(struct server *s, struct lws *wsi, struct http_session *h, const char *path)
{
    const bool head = lws_hdr_total_length(wsi, WSI_TOKEN_HEAD_URI) > 0;
    const struct connection *c = connection_of(wsi);
    char given[64];

    if (!c || c->state == CONNECTION_LEAVING)
        return -1;
    if (!http_host_ok(s, wsi))
        return http_refuse(s, wsi, 403, "This server does not answer to that Host name; see --public-name.\n");
    if (!http_origin_ok(wsi) || http_is_foreign(wsi, may_be_framed(s, path)))
        return http_refuse(s, wsi, 403, "Pages of other sites get nothing; they may show /embed, with --embed-from.\n");
    if (!head && lws_hdr_total_length(wsi, WSI_TOKEN_GET_URI) == 0)
        return http_refuse(s, wsi, 405, "Only GET and HEAD are supported.\n");
    if (lws_hdr_total_length(wsi, WSI_TOKEN_HTTP_CONTENT_LENGTH) > 0 ||
        lws_hdr_total_length(wsi, WSI_TOKEN_HTTP_TRANSFER_ENCODING) > 0)
        return http_refuse(s, wsi, 413, "A request must not have a body.\n");
    if (!is_whole(wsi, path))
        return http_refuse(s, wsi, 404, "There is nothing here: no path has a semicolon or an ampersand.\n");
    if (monitor_knows(path))
        return monitor_answer(s, wsi, h, path, head);
    if (watcher_knows(path))
        return watcher_request(s, wsi, path, head);

    const struct site_file *f = site_find(&s->site, path);
    if (!f)
        return http_respond_text(
            wsi, 404, "text/plain; charset=utf-8",
            "There is nothing here. The viewer is at /, images are at " WATCHER_PATHS " and /embed.\n", head);
    const bool known =
        lws_hdr_copy(wsi, given, sizeof(given), WSI_TOKEN_HTTP_IF_NONE_MATCH) > 0 && strcmp(given, f->etag) == 0;
    const struct http_head answer = { .status = known ? 304 : 200,
                                      .type = f->type,
                                      .etag = f->etag,
                                      .policy = strcmp(f->path, "/embed") == 0 ? s->embed_policy : NULL,
                                      .size = f->size };
    return respond(wsi, h, &answer, f->bytes, head);
}

/* 0: the upgrade may go on. HTTP/2 is off: libwebsockets 4.1.6 has known faults there. Do not read this callback's
 * `in`: it may point to freed memory. */
static int confirm_upgrade(struct server *s, struct lws *wsi)
{
    char to[32];

    if (lws_hdr_copy(wsi, to, sizeof(to), WSI_TOKEN_UPGRADE) > 0 && strcasecmp(to, "websocket") == 0)
        return 0;
    atomic_fetch_add(&s->counts.refused, 1);
    return -1;
}

static int send_more(struct lws *wsi, struct http_session *h)
{
    uint8_t buffer[LWS_PRE + 16384];
    const size_t size = h->left < sizeof(buffer) - LWS_PRE ? h->left : sizeof(buffer) - LWS_PRE;
    const struct connection *c = connection_of(wsi);

    if (c && c->watcher)
        return watcher_write(c->watcher);
    if (h->left == 0)
        return 0;
    memcpy(buffer + LWS_PRE, h->bytes, size);
    h->bytes += size;
    h->left -= size;
    if (lws_write(wsi, buffer + LWS_PRE, size, h->left ? LWS_WRITE_HTTP : LWS_WRITE_HTTP_FINAL) < 0)
        return -1;
    if (h->left == 0) {
        forget_text(h);
        return lws_http_transaction_completed(wsi) ? -1 : 0;
    }
    lws_callback_on_writable(wsi);
    return 0;
}

/* Requests, and handshakes without a subprotocol, which are refused. Thread: service. */
static int answer(struct lws *wsi, enum lws_callback_reasons reason, void *user, void *in, size_t length)
{
    struct server *s = lws_context_user(lws_get_context(wsi));

    switch (reason) {
    case LWS_CALLBACK_OPENSSL_LOAD_EXTRA_SERVER_VERIFY_CERTS: /* once, before listening; user is the SSL_CTX */
        tls_show(user, &s->tls);
        return tls_restrict(user) ? 0 : -1;
    case LWS_CALLBACK_SERVER_NEW_CLIENT_INSTANTIATED: return connection_open(s, wsi);
    case LWS_CALLBACK_WSI_DESTROY: connection_close(s, wsi); return 0;
    case LWS_CALLBACK_HTTP: return answer_request(s, wsi, user, in);
    case LWS_CALLBACK_HTTP_WRITEABLE: return send_more(wsi, user);
    case LWS_CALLBACK_FILTER_PROTOCOL_CONNECTION:
        return http_refuse(s, wsi, 400, "The WebSocket subprotocol " PROTOCOL_NAME " must be requested.\n");
    case LWS_CALLBACK_HTTP_CONFIRM_UPGRADE: return confirm_upgrade(s, wsi);
    case LWS_CALLBACK_CLOSED_HTTP:
        if (user)
            forget_text(user);
        return lws_callback_http_dummy(wsi, reason, user, in, length);
    case LWS_CALLBACK_HTTP_BODY: return -1; /* answered already; do not read the rest */
    case LWS_CALLBACK_RAW_ADOPT: /* CONNECT: libwebsockets would keep the connection as a pipe, without a time-out */
    case LWS_CALLBACK_RAW_CONNECTED:
    case LWS_CALLBACK_RAW_RX: atomic_fetch_add(&s->counts.refused, 1); return -1;
    case LWS_CALLBACK_ESTABLISHED:
    case LWS_CALLBACK_RECEIVE: return -1;
    default: return lws_callback_http_dummy(wsi, reason, user, in, length);
    }
}

int http_callback(struct lws *wsi, enum lws_callback_reasons reason, void *user, void *in, size_t length)
{
    const int64_t begun_us = stream_now_us();
    const int result = answer(wsi, reason, user, in, length);

    if (reason == LWS_CALLBACK_HTTP || reason == LWS_CALLBACK_HTTP_WRITEABLE)
        metrics_worked(lws_context_user(lws_get_context(wsi)), begun_us);
    return result;
}
