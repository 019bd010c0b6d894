/* Images by plain HTTP: /snapshot.jpg, .png and .exr, and /stream.mjpeg. A watcher is one such request, and counts as
 * a viewer until it is answered. It gets the newest image whenever the connection can accept one; images are
 * encoded once for all watchers and viewers of a format and width. The token is in a header, since logs record URLs. */
#include "net/stream/internal.h"

#include "base/log.h"
#include "base/mem.h"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

#define BOUNDARY "relightd"
#define PLAIN "text/plain; charset=utf-8"
#define WIDTH_LEAST 16 /* the range of ?width= */
#define WIDTH_MOST 16384

enum {
    WAIT_US = 10000000,  /* for an image to be made */
    REPEAT_US = 5000000, /* a stream gets the last image again: proxies close silent connections */
    DEAD_MS = 25000,     /* as for viewers (PROTOCOL.md 2.6) */
};

struct resource {
    const char *path, *type;
    enum server_image image;
    bool stream;
};

static const struct resource resources[] = {
    { "/snapshot.jpg", "image/jpeg", SERVER_JPEG, false },
    { "/snapshot.png", "image/png", SERVER_PNG, false },
    { "/snapshot.exr", "image/x-exr", SERVER_EXR, false },
    { "/stream.mjpeg", "multipart/x-mixed-replace; boundary=" BOUNDARY, SERVER_JPEG, true },
};

static const struct resource *find(const char *path)
{
    for (size_t i = 0; i < sizeof(resources) / sizeof(resources[0]); i++)
        if (strcmp(resources[i].path, path) == 0)
            return &resources[i];
    return NULL;
}

bool watcher_knows(const char *path)
{
    return find(path) != NULL;
}

/* ---- Renditions ---- */

bool rendition_is_wanted(const struct server *s, const struct sent_image *p)
{
    uint64_t serial;
    const int slot = image_rendition(p, &serial);

    return s->users[slot] > 0 && s->demand.renditions[slot].serial == serial;
}

/* {lock} The slot of that image and width, with one more user; -1: all are taken. */
static int take_slot(struct server *s, enum server_image image, uint32_t width)
{
    struct server_rendition *all = s->demand.renditions;
    int free_slot = -1;

    for (int k = 0; k < SERVER_RENDITIONS; k++) {
        if (s->users[k] > 0 && all[k].image == image && all[k].width == width) {
            s->users[k]++;
            return k;
        }
        free_slot = s->users[k] == 0 ? k : free_slot;
    }
    if (free_slot >= 0) {
        all[free_slot] = (struct server_rendition){ image, true, width, ++s->last_serial };
        s->users[free_slot] = 1;
    }
    return free_slot;
}

/* {lock} */
static void leave_slot(struct server *s, unsigned slot)
{
    if (--s->users[slot] > 0)
        return;
    s->demand.renditions[slot] = (struct server_rendition){ 0 };
    image_unref(s->latest[STREAM_RENDITIONS + slot]);
    s->latest[STREAM_RENDITIONS + slot] = NULL;
}

/* The client that uses the slot; of several the first, or with `alone` NULL. */
static const struct client *holder(const struct server *s, unsigned slot, bool alone)
{
    const struct client *c = NULL;

    for (const struct watcher *w = s->watchers; w; w = w->next) {
        if (w->kind != STREAM_RENDITIONS + slot)
            continue;
        if (alone && c && w->connection->client != c)
            return NULL;
        c = w->connection->client;
    }
    return c;
}

/* {lock} Where all slots are taken, the client that alone has most of them loses one; if none has enough, two may have
 * taken all together, and the one that was first in most of them loses one, with all who watch it. */
static void make_room(struct server *s, const struct client *by)
{
    const struct client *holders[SERVER_RENDITIONS];

    int slot = -1;

    for (int round = 0; round < 2 && slot < 0; round++) {
        for (unsigned k = 0; k < SERVER_RENDITIONS; k++)
            holders[k] = holder(s, k, round == 0);
        slot = client_crowds(holders, SERVER_RENDITIONS, by);
    }
    limit_reached(&s->limits, LIMIT_WIDTHS, slot < 0 ? by : holders[slot]);
    for (struct watcher *w = s->watchers; w && slot >= 0; w = w->next) {
        if (w->kind != STREAM_RENDITIONS + (unsigned)slot)
            continue;
        leave_slot(s, (unsigned)slot);
        w->kind = 0; /* no kind of image */
        watcher_close(w);
    }
}

/* {lock} The kind of image; 0: no slot is free. width 0: the image's. */
static unsigned choose_kind(struct server *s, const struct client *by, enum server_image image, uint32_t width)
{
    if (width >= s->figures.width && s->figures.width > 0)
        width = 0;
    if (width == 0 && image != SERVER_PNG)
        return image == SERVER_JPEG ? PROTOCOL_JPEG : PROTOCOL_EXR_HALF;
    int slot = take_slot(s, image, width);
    if (slot < 0) {
        make_room(s, by);
        slot = take_slot(s, image, width);
    }
    return slot < 0 ? 0 : STREAM_RENDITIONS + (unsigned)slot;
}

void watchers_demand(const struct server *s, struct server_demand *d)
{
    memcpy(d->renditions, s->demand.renditions, sizeof(d->renditions));
    for (int k = 0; k < SERVER_RENDITIONS; k++)
        d->renditions[k].owner = 0;
    for (const struct watcher *w = s->watchers; w; w = w->next) {
        if (w->kind == 0) /* it has lost its slot, and closes */
            continue;
        d->viewers++;
        if (w->kind < STREAM_RENDITIONS)
            d->formats |= 1u << w->kind;
        else
            d->renditions[w->kind - STREAM_RENDITIONS].owner =
                1 + (uint32_t)(w->connection->client - s->limits.clients);
    }
}

/* ---- A request ---- */

static int refuse(struct server *s, struct lws *wsi, unsigned status, const char *text)
{
    char line[512];

    snprintf(line, sizeof(line), "%s\n", text);
    return http_refuse(s, wsi, status, line);
}

/* 0: admitted; else refused, and the result is that of the callback. */
static int admit(struct server *s, struct lws *wsi)
{
    if (atomic_load(&s->stopping))
        return refuse(s, wsi, 503, "The server is shutting down.");
    if (!connection_forwarded(s, wsi))
        return refuse(s, wsi, 400, "The proxy names no address in X-Forwarded-For.");
    switch (token_check_header(s, wsi, s->tokens[SERVER_VIEWER])) {
    case TOKEN_RIGHT: return 0;
    case TOKEN_LATER: return refuse(s, wsi, 429, "Too many wrong tokens came from this address; wait ten seconds.");
    default:
        return refuse(
            s, wsi, 401,
            "The viewers' token is needed: as \"Authorization: Bearer TOKEN\", or as a password with any user "
            "name, as in curl -u viewer:TOKEN. A token in the address has no effect.");
    }
}

/* ?width=N; *width 0: none was given. False: not a number in range. */
static bool read_width(struct lws *wsi, uint32_t *width)
{
    char argument[64], *end;

    *width = 0;
    const char *text = lws_get_urlarg_by_name(wsi, "width=", argument, sizeof(argument));
    if (!text)
        return true;
    const long value = strtol(text, &end, 10);
    *width = (uint32_t)value;
    return text[0] >= '0' && text[0] <= '9' && *end == '\0' && value >= WIDTH_LEAST && value <= WIDTH_MOST;
}

/* Why there is no image to show; NULL: there is one. */
static const char *why_none(struct server *s)
{
    struct server_health h;

    pthread_mutex_lock(&s->lock);
    const bool any = s->published > 0;
    pthread_mutex_unlock(&s->lock);
    if (any)
        return NULL;
    server_health(s, &h);
    return h.ready ? "no producer has sent a frame yet" : h.reason;
}

static void prepare_line(struct lws *wsi)
{
    const unsigned dead = DEAD_MS;

    setsockopt(lws_get_socket_fd(wsi), IPPROTO_TCP, TCP_USER_TIMEOUT, &dead, sizeof(dead));
    lws_set_timeout(wsi, NO_PENDING_TIMEOUT, 0);
    websocket_limit_unsent(wsi);
}

/* Libwebsockets 4.1.6 reads nothing before the request is answered, but spins over input and over clients that have
 * left. So input is watched only while a write waits, which needs that, and watchers_tick closes connections that send
 * or end. */
static void watch_input(struct watcher *w, bool on)
{
    lws_rx_flow_control(w->wsi, on);
}

static void request_write(struct watcher *w)
{
    watch_input(w, true);
    if (!w->waiting) {
        w->waiting = true;
        w->moved_us = stream_now_us();
    }
    lws_callback_on_writable(w->wsi);
}

/* Its next image as a new reference; NULL: none yet. */
static struct sent_image *next_image(const struct watcher *w)
{
    struct server *s = w->server;

    pthread_mutex_lock(&s->lock);
    struct sent_image *p = s->latest[w->kind];
    const bool counts = p && (image_header(p)->sequence > w->begun || w->again) && image_made(p) >= w->fresh;
    p = counts ? image_ref(p) : NULL;
    pthread_mutex_unlock(&s->lock);
    return p;
}

static bool has_image(const struct watcher *w)
{
    struct sent_image *p = next_image(w);

    image_unref(p);
    return p != NULL;
}

static int watch(struct server *s, struct lws *wsi, const struct resource *r, uint32_t width, bool head)
{
    struct connection *c = connection_of(wsi);
    struct watcher *w = mem_alloc(1, sizeof(*w));

    if (!w)
        return refuse(s, wsi, 503, "Out of memory.");
    pthread_mutex_lock(&s->lock);
    w->kind = choose_kind(s, c->client, r->image, width);
    w->fresh = s->begun;
    pthread_mutex_unlock(&s->lock);
    if (w->kind == 0 || !connection_admit(s, c)) {
        if (w->kind >= STREAM_RENDITIONS) {
            pthread_mutex_lock(&s->lock);
            leave_slot(s, w->kind - STREAM_RENDITIONS);
            pthread_mutex_unlock(&s->lock);
        }
        mem_free(w);
        return refuse(s, wsi, 503, "Too many different widths are requested at once; try again, or omit the width.");
    }
    w->server = s;
    w->wsi = wsi;
    w->connection = c;
    w->resource = r;
    w->head = head;
    w->opened_us = w->sent_us = w->moved_us = stream_now_us();
    client_name(c->client, w->peer);
    c->watcher = w;
    w->next = s->watchers;
    s->watchers = w;
    prepare_line(wsi);
    viewers_demand(s);
    if (has_image(w))
        request_write(w);
    else
        watch_input(w, false);
    return 0;
}

int watcher_request(struct server *s, struct lws *wsi, const char *path, bool head)
{
    const struct resource *r = find(path);
    char text[320], why[160];
    uint32_t width;

    const int refused = admit(s, wsi);
    if (refused)
        return refused;
    if (!read_width(wsi, &width)) {
        snprintf(text, sizeof(text), "width must be an integer from %d to %d, as in %s?width=640", WIDTH_LEAST,
                 WIDTH_MOST, path);
        return refuse(s, wsi, 400, text);
    }
    const char *none = why_none(s);
    if (none) {
        snprintf(text, sizeof(text), "There is no image yet: %s; try again later.", none);
        return refuse(s, wsi, 503, text);
    }
    if (connection_refusal(s, connection_of(wsi), why, sizeof(why))) {
        snprintf(text, sizeof(text), "No connection is free: %s; try again later.", why);
        return refuse(s, wsi, 503, text);
    }
    return watch(s, wsi, r, width, head);
}

bool watcher_streams(const struct watcher *w)
{
    return w->resource->stream;
}

void watcher_close(struct watcher *w)
{
    w->closing = true;
    request_write(w);
}

void watcher_destroy(struct watcher *w)
{
    if (!w)
        return;
    struct server *s = w->server;
    struct watcher **link = &s->watchers;

    while (*link != w)
        link = &(*link)->next;
    *link = w->next;
    w->connection->watcher = NULL;
    connection_dismiss(s, w->connection);
    image_unref(w->current);
    if (w->kind >= STREAM_RENDITIONS) {
        pthread_mutex_lock(&s->lock);
        leave_slot(s, w->kind - STREAM_RENDITIONS);
        pthread_mutex_unlock(&s->lock);
    }
    mem_free(w);
    viewers_demand(s);
}

/* ---- Sending ---- */

static void begin(struct watcher *w, struct sent_image *p)
{
    const uint64_t sequence = image_header(p)->sequence;

    if (w->begun > 0 && sequence > w->begun) {
        const uint64_t skipped = sequence - w->begun - 1;
        w->skipped += skipped;
        atomic_fetch_add(&w->server->counts.skipped, skipped);
        atomic_fetch_add(&w->server->metrics.skipped_slow, skipped);
    }
    w->begun = sequence;
    w->again = false;
    w->current = p;
    w->offset = PROTOCOL_PICTURE_BYTES; /* the header of relight.v1 stays here */
}

enum sending {
    SENDING_FAILED,
    SENDING_ON,
    SENDING_DONE, /* the request is answered */
};

static enum sending send_head(struct watcher *w)
{
    const struct resource *r = w->resource;
    size_t size;

    image_message(w->current, &size);
    const struct http_head head = {
        .status = 200, .type = r->type, .size = size - PROTOCOL_PICTURE_BYTES, .endless = r->stream, .fresh = true
    };
    w->answered = true;
    if (http_send_head(w->wsi, &head) != 0)
        return SENDING_FAILED;
    return w->head ? SENDING_DONE : SENDING_ON;
}

/* The next piece of the image. A part of a stream ends with the boundary, because some browsers show it only then. */
static enum sending send_piece(struct watcher *w)
{
    static const char between[] = "\r\n--" BOUNDARY "\r\n";
    uint8_t buffer[LWS_PRE + 16384 + 256], *out = buffer + LWS_PRE;
    size_t size, n = 0;
    const uint8_t *message = image_message(w->current, &size);
    const size_t left = size - w->offset, piece = left < 16384 ? left : 16384;

    if (w->resource->stream && w->offset == PROTOCOL_PICTURE_BYTES)
        n = (size_t)snprintf((char *)out, 200, "%sContent-Type: image/jpeg\r\nContent-Length: %zu\r\n\r\n",
                             w->sent == 0 ? between + 2 : "", left);
    memcpy(out + n, message + w->offset, piece);
    n += piece;
    if (w->resource->stream && piece == left) {
        memcpy(out + n, between, sizeof(between) - 1);
        n += sizeof(between) - 1;
    }
    const bool last = piece == left && !w->resource->stream;
    if (lws_write(w->wsi, out, n, last ? LWS_WRITE_HTTP_FINAL : LWS_WRITE_HTTP) < 0)
        return SENDING_FAILED;
    w->offset += piece;
    atomic_fetch_add(&w->server->counts.bytes, piece);
    if (w->offset < size)
        return SENDING_ON;
    atomic_fetch_add(&w->server->metrics.sent[metrics_kind(w->kind)], 1);
    atomic_fetch_add(&w->server->counts.sent, 1);
    image_unref(w->current);
    w->current = NULL;
    w->sent++;
    w->sent_us = stream_now_us();
    return last ? SENDING_DONE : SENDING_ON;
}

int watcher_write(struct watcher *w)
{
    struct lws *wsi = w->wsi;

    w->waiting = false;
    if (w->closing)
        return -1;
    struct sent_image *p = w->current ? NULL : next_image(w);
    if (p)
        begin(w, p);
    if (!w->current) {
        watch_input(w, false);
        return 0;
    }
    const enum sending state = w->answered ? send_piece(w) : send_head(w);
    if (state == SENDING_DONE) { /* the connection may bring another request */
        watcher_destroy(w);
        return lws_http_transaction_completed(wsi) ? -1 : 0;
    }
    if (w->current || has_image(w))
        request_write(w);
    else
        watch_input(w, false);
    return state == SENDING_FAILED ? -1 : 0;
}

/* ---- All of them ---- */

void watchers_wake(struct server *s)
{
    for (struct watcher *w = s->watchers; w; w = w->next)
        if (!w->current && has_image(w))
            request_write(w);
}

static void kill_soon(struct watcher *w)
{
    lws_set_timeout(w->wsi, PENDING_TIMEOUT_USER_REASON_BASE, LWS_TO_KILL_ASYNC);
}

/* Whether the client has closed its end, or sends what nobody asked for. */
static bool has_left(const struct watcher *w)
{
    char byte;

    return recv(lws_get_socket_fd(w->wsi), &byte, 1, MSG_PEEK | MSG_DONTWAIT) >= 0;
}

void watchers_tick(struct server *s)
{
    const int64_t now = stream_now_us();

    for (struct watcher *w = s->watchers; w; w = w->next) {
        if (w->waiting && now - w->moved_us > STREAM_STALL_US) {
            atomic_fetch_add(&s->counts.stalled, 1);
            log_warning("%s: %s closed: it took no bytes for %d s; it got %llu images and skipped %llu", w->peer,
                        w->resource->path, STREAM_STALL_US / 1000000, (unsigned long long)w->sent,
                        (unsigned long long)w->skipped);
            kill_soon(w);
        } else if (!w->answered && !w->waiting && now - w->opened_us > WAIT_US) {
            http_respond_text(w->wsi, 503, PLAIN, "No image could be made in time; try again later.\n", w->head);
            w->answered = true;
            kill_soon(w);
        } else if (has_left(w)) {
            kill_soon(w);
        } else if (w->sent > 0 && !w->current && now - w->sent_us > REPEAT_US) {
            w->again = true;
            request_write(w);
        }
    }
}
