#include "stream/internal.h"

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
    const char *begin = host[0] == '[' ? host + 1 : host;
    const size_t length = strcspn(begin, host[0] == '[' ? "]" : ":");

    if (length == 0 || length >= size)
        return false;
    memcpy(out, begin, length);
    out[length] = 0;
    return true;
}

/* 127.x.x.x, but no name that merely begins so. */
static bool is_ipv4_loopback(const char *name)
{
    return strncmp(name, "127.", 4) == 0 && name[strspn(name, "0123456789.")] == 0;
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

/* Whether the name is the numeric address at which this connection reached us. A page that an attacker's DNS lets in
 * has a name, never a number. */
static bool is_local_address(struct lws *wsi, const char *name)
{
    struct sockaddr_storage local = { 0 };
    const struct sockaddr_in6 *six = (const struct sockaddr_in6 *)&local;
    const struct sockaddr_in *four = (const struct sockaddr_in *)&local;
    socklen_t size = sizeof(local);
    struct in6_addr named;

    if (getsockname(lws_get_socket_fd(wsi), (struct sockaddr *)&local, &size) != 0)
        return false;
    if (inet_pton(AF_INET6, name, &named) == 1)
        return local.ss_family == AF_INET6 && memcmp(&named, &six->sin6_addr, sizeof(named)) == 0;
    if (inet_pton(AF_INET, name, &named) != 1)
        return false;
    if (local.ss_family == AF_INET6) /* a dual-stack socket maps IPv4 to the last four bytes */
        return IN6_IS_ADDR_V4MAPPED(&six->sin6_addr) && memcmp(&named, six->sin6_addr.s6_addr + 12, 4) == 0;
    return memcmp(&named, &four->sin_addr, 4) == 0;
}

bool http_host_ok(const struct server *s, struct lws *wsi)
{
    char host[256], name[256];

    if (lws_hdr_copy(wsi, host, sizeof(host), WSI_TOKEN_HOST) <= 0 || !host_name(host, name, sizeof(name)))
        return false;
    /* A name that an attacker's DNS points at 127.0.0.1 is still the attacker's name. */
    return strcasecmp(name, "localhost") == 0 || is_ipv4_loopback(name) || strcmp(name, "::1") == 0 ||
           is_local_address(wsi, name) || (s->public_names && is_listed(s->public_names, name));
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
    static const struct lws_protocol_vhost_options policy = {
        &sniff, NULL, "content-security-policy:",
        "default-src 'none'; script-src 'self'; worker-src 'self'; style-src 'self'; img-src 'self'; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    };

    return &policy;
}

/* Writes the header into out; NULL when it does not fit. */
static uint8_t *put_header(struct lws *wsi, unsigned status, const char *type, const char *etag, size_t size,
                           uint8_t *out, uint8_t *end)
{
    static const char cache[] = "no-cache"; /* revalidate each time; 304 while unchanged */
    uint8_t *p = out;

    if (lws_add_http_common_headers(wsi, status, type, status == 304 ? LWS_ILLEGAL_HTTP_CONTENT_LEN : size, &p, end) ||
        lws_add_http_header_by_name(wsi, (const uint8_t *)"cache-control:", (const uint8_t *)cache, (int)strlen(cache),
                                    &p, end) ||
        (etag && lws_add_http_header_by_name(wsi, (const uint8_t *)"etag:", (const uint8_t *)etag, (int)strlen(etag),
                                             &p, end)) ||
        lws_finalize_http_header(wsi, &p, end))
        return NULL;
    return p;
}

/* Sends the header; the body (bytes that outlive the request) follows unless this is a HEAD. */
static int respond(struct lws *wsi, struct http_session *h, unsigned status, const struct site_file *f, bool head)
{
    uint8_t buffer[LWS_PRE + 2048], *begin = buffer + LWS_PRE;
    const uint8_t *end =
        put_header(wsi, status, f->type, f->etag[0] ? f->etag : NULL, f->size, begin, buffer + sizeof(buffer) - 1);

    if (!end || lws_write(wsi, begin, (size_t)(end - begin), LWS_WRITE_HTTP_HEADERS) < 0)
        return -1;
    h->bytes = f->bytes;
    h->left = head || status == 304 ? 0 : f->size;
    if (h->left == 0)
        return lws_http_transaction_completed(wsi) ? -1 : 0;
    lws_callback_on_writable(wsi);
    return 0;
}

int http_respond_text(struct lws *wsi, unsigned status, const char *type, const char *text, bool head)
{
    uint8_t buffer[LWS_PRE + 3072], *begin = buffer + LWS_PRE;
    const size_t size = strlen(text);
    uint8_t *end = put_header(wsi, status, type, NULL, size, begin, buffer + 2048);

    if (!end || size > 1024)
        return -1;
    if (!head) {
        memcpy(end, text, size);
        end += size;
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
    const struct site_file f = { .type = type, .bytes = (uint8_t *)text, .size = size };

    forget_text(h);
    h->text = text;
    return respond(wsi, h, 200, &f, head);
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
    const struct guest *g = guest_of(wsi);
    char given[64];

    if (!g || g->state == GUEST_LEAVING)
        return -1;
    if (!http_host_ok(s, wsi))
        return http_refuse(s, wsi, 403, "This server does not answer to that Host name; see --public-name.\n");
    if (!http_origin_ok(wsi))
        return http_refuse(s, wsi, 403, "Pages of other sites are not served.\n");
    if (!head && lws_hdr_total_length(wsi, WSI_TOKEN_GET_URI) == 0)
        return http_refuse(s, wsi, 405, "Only GET and HEAD are answered.\n");
    if (lws_hdr_total_length(wsi, WSI_TOKEN_HTTP_CONTENT_LENGTH) > 0 ||
        lws_hdr_total_length(wsi, WSI_TOKEN_HTTP_TRANSFER_ENCODING) > 0)
        return http_refuse(s, wsi, 413, "A request must not have a body.\n");
    if (monitor_knows(path))
        return monitor_answer(s, wsi, h, path, head);

    const struct site_file *f = site_find(&s->site, path);
    if (!f)
        return http_respond_text(wsi, 404, "text/plain; charset=utf-8", "There is nothing here. The viewer is at /\n",
                                 head);
    const bool known =
        lws_hdr_copy(wsi, given, sizeof(given), WSI_TOKEN_HTTP_IF_NONE_MATCH) > 0 && strcmp(given, f->etag) == 0;
    return respond(wsi, h, known ? 304 : 200, f, head);
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
    case LWS_CALLBACK_SERVER_NEW_CLIENT_INSTANTIATED: return guest_arrive(s, wsi);
    case LWS_CALLBACK_WSI_DESTROY: guest_leave(s, wsi); return 0;
    case LWS_CALLBACK_HTTP: return answer_request(s, wsi, user, in);
    case LWS_CALLBACK_HTTP_WRITEABLE: return send_more(wsi, user);
    case LWS_CALLBACK_FILTER_PROTOCOL_CONNECTION:
        return http_refuse(s, wsi, 400, "The WebSocket subprotocol " PROTOCOL_NAME " must be asked for.\n");
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
    const int64_t begun_us = viewer_now_us();
    const int result = answer(wsi, reason, user, in, length);

    if (reason == LWS_CALLBACK_HTTP || reason == LWS_CALLBACK_HTTP_WRITEABLE)
        metrics_worked(lws_context_user(lws_get_context(wsi)), begun_us);
    return result;
}
