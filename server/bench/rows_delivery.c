/* One picture to all viewers: through stream/server.h, and over sockets with nothing around them. The viewers are
 * played by this thread, over plain sockets in both cases. */
#include "bench/bench_parts.h"

#include "base/clock.h"
#include "base/mem.h"
#include "stream/picture.h"
#include "stream/server.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pthread.h>
#include <stdatomic.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define VIEWERS_MAX 64
#define ROOM ((size_t)1 << 18) /* bytes read at a time */
#define WAIT_MS 5000

struct watcher {
    int fd;
    uint8_t head[10]; /* of the WebSocket frame that is coming */
    size_t head_size;
    uint64_t left; /* bytes of its payload still to come */
    bool binary;   /* the message that is coming is a picture */
    uint64_t pictures;
};

struct delivery {
    uint32_t viewers;
    uint8_t *bytes; /* of a picture */
    size_t size;
    uint8_t *room;
    struct server *server;
    struct protocol_picture header;
    uint64_t published;
    struct watcher watcher[VIEWERS_MAX];

    struct watcher bare[VIEWERS_MAX]; /* `pictures` counts bytes here */
    int ends[VIEWERS_MAX];            /* the writer's sides */
    pthread_mutex_t lock;
    pthread_cond_t asked;
    uint64_t wanted; /* {lock} pictures to be written; UINT64_MAX ends the writer */
    bool writes;     /* the writer's thread runs */
    pthread_t writer;
};

/* ---- Viewers of the server ---- */

static int connect_to(uint16_t port)
{
    struct sockaddr_in to = { .sin_family = AF_INET, .sin_port = htons(port) };
    const int fd = socket(AF_INET, SOCK_STREAM, 0), on = 1;

    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (fd >= 0 && connect(fd, (struct sockaddr *)&to, sizeof(to)) == 0) {
        setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
        return fd;
    }
    if (fd >= 0)
        close(fd);
    return -1;
}

/* A text of at most 125 bytes, masked by zeros. */
static bool say(int fd, const char *text)
{
    uint8_t out[6 + 125] = { 0x81 };
    const size_t size = strlen(text);

    out[1] = (uint8_t)(0x80 | size);
    memcpy(out + 6, text, size);
    return send(fd, out, 6 + size, MSG_NOSIGNAL) == (ssize_t)(6 + size);
}

static bool shake_hands(int fd)
{
    static const char request[] = "GET " PROTOCOL_PATH " HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\n"
                                  "Connection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
                                  "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: " PROTOCOL_NAME "\r\n\r\n";
    struct pollfd p = { .fd = fd, .events = POLLIN };
    uint32_t last = 0;
    uint8_t byte;

    if (send(fd, request, sizeof(request) - 1, MSG_NOSIGNAL) != (ssize_t)sizeof(request) - 1)
        return false;
    while (last != 0x0d0a0d0a) { /* up to the empty line */
        if (poll(&p, 1, WAIT_MS) != 1 || recv(fd, &byte, 1, 0) != 1)
            return false;
        last = last << 8 | byte;
    }
    return say(fd, "{\"op\":\"hello\",\"role\":\"viewer\",\"version\":{\"major\":1}}") &&
           say(fd, "{\"op\":\"subscribe\",\"format\":\"jpeg\"}");
}

/* The frame's head is whole: its payload's length. */
static uint64_t length_of(const struct watcher *w)
{
    const uint8_t *h = w->head;
    uint64_t length = h[1] & 0x7f;

    if (length < 126)
        return length;
    const size_t end = length == 126 ? 4 : 10;
    length = 0;
    for (size_t i = 2; i < end; i++)
        length = length << 8 | h[i];
    return length;
}

static size_t head_needs(const struct watcher *w)
{
    const uint8_t kind = w->head_size < 2 ? 0 : w->head[1] & 0x7f;
    return kind == 126 ? 4 : kind == 127 ? 10 : 2;
}

/* Counts pictures that are complete and answers each. */
static bool take_bytes(struct watcher *w, const uint8_t *in, size_t size)
{
    while (size > 0 || (w->head_size == head_needs(w) && w->left == 0)) {
        if (w->left > 0) {
            const size_t n = size < w->left ? size : (size_t)w->left;
            in += n;
            size -= n;
            w->left -= n;
        } else if (w->head_size < head_needs(w)) {
            w->head[w->head_size++] = *in++;
            size--;
            if (w->head_size < head_needs(w))
                continue;
            w->left = length_of(w);
            if ((w->head[0] & 15) == 1 || (w->head[0] & 15) == 2)
                w->binary = (w->head[0] & 15) == 2;
        }
        if (w->left > 0 || w->head_size < head_needs(w))
            continue;
        char text[80];
        const bool whole = w->binary && w->head[0] & 0x80 && (w->head[0] & 15) < 8;
        w->head_size = 0;
        if (!whole)
            continue;
        w->pictures++;
        snprintf(text, sizeof(text), "{\"op\":\"ack\",\"sequence\":%llu}", (unsigned long long)w->pictures);
        if (!say(w->fd, text))
            return false;
    }
    return true;
}

/* Reads whatever comes to any of the watchers until all have reached `want`. */
static enum err read_until(struct delivery *d, struct watcher *w, uint64_t want, bool raw)
{
    struct pollfd p[VIEWERS_MAX];
    uint32_t waiting = d->viewers;

    while (waiting > 0) {
        for (uint32_t i = 0; i < d->viewers; i++)
            p[i] = (struct pollfd){ .fd = w[i].fd, .events = POLLIN };
        if (poll(p, d->viewers, WAIT_MS) <= 0)
            return ERR_IO;
        for (uint32_t i = 0; i < d->viewers; i++) {
            const ssize_t n = p[i].revents ? recv(w[i].fd, d->room, ROOM, 0) : 0;
            if (p[i].revents && n <= 0)
                return ERR_IO;
            if (raw)
                w[i].pictures += (uint64_t)n;
            else if (!take_bytes(&w[i], d->room, (size_t)n))
                return ERR_IO;
        }
        waiting = 0;
        for (uint32_t i = 0; i < d->viewers; i++)
            waiting += w[i].pictures < want;
    }
    return ERR_OK;
}

static enum err deliver(void *context)
{
    struct delivery *d = context;
    struct picture *p = picture_create(&d->header, d->bytes, d->size);

    if (!p)
        return ERR_NOMEM;
    server_publish(d->server, p);
    return read_until(d, d->watcher, ++d->published, false);
}

static bool greet_all(struct delivery *d)
{
    struct server_demand demand = { 0 };

    for (uint32_t i = 0; i < d->viewers; i++) {
        d->watcher[i].fd = connect_to(server_port(d->server));
        if (d->watcher[i].fd < 0 || !shake_hands(d->watcher[i].fd))
            return false;
    }
    const double end = clock_seconds() + 1e-3 * WAIT_MS;
    while (demand.viewers < d->viewers && clock_seconds() < end) {
        poll(NULL, 0, 5);
        server_demand(d->server, &demand);
    }
    return demand.viewers == d->viewers;
}

/* ---- Bare sockets ---- */

/* Writes the same bytes to each socket in turn, as often as asked. */
static void *write_main(void *arg)
{
    struct delivery *d = arg;
    uint64_t done = 0;

    for (;;) {
        pthread_mutex_lock(&d->lock);
        while (d->wanted == done)
            pthread_cond_wait(&d->asked, &d->lock);
        const bool ends = d->wanted == UINT64_MAX;
        pthread_mutex_unlock(&d->lock);
        if (ends)
            return NULL;
        for (uint32_t i = 0; i < d->viewers; i++)
            for (size_t at = 0; at < d->size;) {
                const ssize_t n = send(d->ends[i], d->bytes + at, d->size - at, MSG_NOSIGNAL);
                if (n <= 0)
                    return NULL;
                at += (size_t)n;
            }
        done++;
    }
}

static void ask_for(struct delivery *d, uint64_t wanted)
{
    pthread_mutex_lock(&d->lock);
    d->wanted = wanted;
    pthread_cond_signal(&d->asked);
    pthread_mutex_unlock(&d->lock);
}

static enum err deliver_bare(void *context)
{
    struct delivery *d = context;

    ask_for(d, d->wanted + 1);
    return read_until(d, d->bare, d->wanted * d->size, true);
}

static bool join_all(struct delivery *d)
{
    struct sockaddr_in at = { .sin_family = AF_INET };
    socklen_t size = sizeof(at);
    const int listener = socket(AF_INET, SOCK_STREAM, 0), on = 1;
    bool good = listener >= 0;

    at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    good = good && bind(listener, (struct sockaddr *)&at, sizeof(at)) == 0 && listen(listener, VIEWERS_MAX) == 0 &&
           getsockname(listener, (struct sockaddr *)&at, &size) == 0;
    for (uint32_t i = 0; i < d->viewers && good; i++) {
        d->bare[i].fd = connect_to(ntohs(at.sin_port));
        d->ends[i] = d->bare[i].fd >= 0 ? accept(listener, NULL, NULL) : -1;
        good = d->ends[i] >= 0;
        if (good)
            setsockopt(d->ends[i], IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
    }
    if (listener >= 0)
        close(listener);
    d->writes = good && pthread_create(&d->writer, NULL, write_main, d) == 0;
    return d->writes;
}

static void delivery_finish(struct delivery *d)
{
    if (d->writes) {
        ask_for(d, UINT64_MAX);
        pthread_join(d->writer, NULL);
    }
    for (uint32_t i = 0; i < d->viewers; i++) {
        const int fds[3] = { d->watcher[i].fd, d->bare[i].fd, d->ends[i] };
        for (int k = 0; k < 3; k++)
            if (fds[k] >= 0)
                close(fds[k]);
    }
    server_destroy(d->server);
    pthread_mutex_destroy(&d->lock);
    pthread_cond_destroy(&d->asked);
    mem_free(d->bytes);
    mem_free(d->room);
}

/* The bench's picture as a JPEG. */
static enum err make_bytes(struct delivery *d, const struct bench *b)
{
    struct jpeg_encoder *j = jpeg_encoder_create();
    const uint8_t *bytes;
    enum err e =
        j ? jpeg_encode(j, b->display, b->desc->width, b->desc->height, BENCH_QUALITY, &bytes, &d->size) : ERR_NOMEM;

    if (!e) {
        d->bytes = mem_alloc(d->size, 1);
        d->room = mem_alloc(ROOM, 1);
        e = d->bytes && d->room ? ERR_OK : ERR_NOMEM;
    }
    if (!e)
        memcpy(d->bytes, bytes, d->size);
    jpeg_encoder_destroy(j);
    return e;
}

enum err bench_delivery(struct bench *b, struct bench_row *row)
{
    const uint32_t viewers = b->desc->viewers < VIEWERS_MAX ? b->desc->viewers : VIEWERS_MAX;
    struct delivery d = {
        .viewers = viewers,
        .header = { .format = PROTOCOL_JPEG, .width = b->desc->width, .height = b->desc->height, .gain = 1.0f },
        .lock = PTHREAD_MUTEX_INITIALIZER,
        .asked = PTHREAD_COND_INITIALIZER,
    };
    const struct bench_pair pair = { deliver, deliver_bare, &d, 1e3, 1e3, false };
    struct reason why = { "" };

    row->name = "delivery / bare sockets";
    row->unit = "ms";
    for (uint32_t i = 0; i < viewers; i++)
        d.watcher[i].fd = d.bare[i].fd = d.ends[i] = -1;
    enum err e = make_bytes(&d, b);
    snprintf(row->note, sizeof(row->note),
             "one picture of %zu bytes to %u viewers on this machine, until each has it whole; bare: send and recv",
             d.size, viewers);
    if (!e && server_create(&(struct server_desc){ .port = 0 }, &d.server, &why))
        bench_skip(row, "%.150s", why.text);
    else if (!e && (!greet_all(&d) || !join_all(&d)))
        bench_skip(row, "viewers could not be connected");
    else if (!e)
        e = bench_time(b, &pair, row);
    if (e == ERR_IO) {
        bench_skip(row, "a connection ended or stood still");
        e = ERR_OK;
    }
    delivery_finish(&d);
    return e;
}
