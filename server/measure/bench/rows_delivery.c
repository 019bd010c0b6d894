/* One image to all viewers: through net/stream/server.h, and over sockets with nothing around them. This thread plays
 * the viewers, over plain sockets in both cases. */
#include "measure/bench/bench.h"

#include "base/clock.h"
#include "base/mem.h"
#include "net/stream/server.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pthread.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#define VIEWERS_MAX 64         /* bounds tables; the range of --viewers */
#define ROOM ((size_t)1 << 18) /* bytes read at a time */
#define WAIT_SECONDS 5

struct delivery {
    const struct bench *bench;
    uint32_t viewers;
    uint8_t *bytes[BENCH_SKIES]; /* of the images */
    size_t size[BENCH_SKIES];
    uint32_t now; /* {lock} the image */
    uint8_t *room;
    struct server *server;
    struct protocol_picture header;
    uint64_t published;
    int viewer[VIEWERS_MAX]; /* sockets of the server's viewers, */
    int bare[VIEWERS_MAX];   /* of the bare ones, */
    int ends[VIEWERS_MAX];   /* and the sides that are written to */
    pthread_mutex_t lock;
    pthread_cond_t wake;
    uint64_t requested; /* {lock} images for the writer; UINT64_MAX ends it */
    bool writes;        /* the writer's thread runs */
    pthread_t writer;
};

static int connect_to(uint16_t port)
{
    struct sockaddr_in to = { .sin_family = AF_INET, .sin_port = htons(port) };
    const int fd = socket(AF_INET, SOCK_STREAM, 0), on = 1;
    const struct timeval wait = { .tv_sec = WAIT_SECONDS };

    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (fd >= 0 && connect(fd, (struct sockaddr *)&to, sizeof(to)) == 0) {
        setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
        setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &wait, sizeof(wait));
        return fd;
    }
    if (fd >= 0)
        close(fd);
    return -1;
}

/* Reads so many bytes into `to`, over and over where they are more than its `room`. */
static bool read_bytes(int fd, uint8_t *to, size_t room, uint64_t size)
{
    for (size_t at = 0; size > 0; at = at == room ? 0 : at) {
        const ssize_t n = recv(fd, to + at, size < room - at ? size : room - at, 0);
        if (n <= 0)
            return false;
        at += (size_t)n;
        size -= (uint64_t)n;
    }
    return true;
}

/* ---- Viewers of the server ---- */

/* A text of at most 125 bytes, masked by zeros. */
static bool send_text(int fd, const char *text)
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
    uint32_t last = 0;
    uint8_t byte;

    if (send(fd, request, sizeof(request) - 1, MSG_NOSIGNAL) != (ssize_t)sizeof(request) - 1)
        return false;
    while (last != 0x0d0a0d0a) { /* up to the empty line */
        if (!read_bytes(fd, &byte, 1, 1))
            return false;
        last = last << 8 | byte;
    }
    return send_text(fd, "{\"op\":\"hello\",\"role\":\"viewer\",\"version\":{\"major\":1}}") &&
           send_text(fd, "{\"op\":\"subscribe\",\"format\":\"jpeg\"}");
}

/* The size of the frame whose head begins at `h`; 0 while more than the `size` bytes that are there are needed. */
static uint64_t frame_size(const uint8_t *h, size_t size)
{
    const size_t kind = size < 2 ? 0 : h[1] & 0x7f, head = kind == 127 ? 10 : kind == 126 ? 4 : 2;
    uint64_t length = 0;

    if (size < head)
        return 0;
    for (size_t i = 2; i < head; i++)
        length = length << 8 | h[i];
    return head + (kind < 126 ? kind : length);
}

/* Reads WebSocket frames until an image is complete, as much at a time as has come, and acknowledges it: until then
 * the server sends no other. Small messages that come with an image's end are dropped. */
static bool read_image(struct delivery *d, int fd)
{
    bool complete = false;

    for (size_t have = 0; !complete;) {
        const ssize_t n = recv(fd, d->room + have, ROOM - have, 0);
        if (n <= 0)
            return false;
        have += (size_t)n;
        for (uint64_t size; !complete && (size = frame_size(d->room, have)) > 0;) {
            complete = d->room[0] == 0x82 || d->room[0] == 0x80; /* whole, or its last fragment */
            if (size > have) {
                if (!read_bytes(fd, d->room, ROOM, size - have))
                    return false;
                size = have;
            }
            have -= (size_t)size;
            memmove(d->room, d->room + size, complete ? 0 : have);
        }
    }
    char text[80];
    snprintf(text, sizeof(text), "{\"op\":\"ack\",\"sequence\":%llu}", (unsigned long long)d->published);
    return send_text(fd, text);
}

static enum err deliver(void *context)
{
    struct delivery *d = context;
    const size_t k = d->bench->turn % BENCH_SKIES;
    struct sent_image *p = image_create(&d->header, d->bytes[k], d->size[k]);

    if (!p)
        return ERR_NOMEM;
    server_publish(d->server, p);
    d->published++;
    for (uint32_t i = 0; i < d->viewers; i++)
        if (!read_image(d, d->viewer[i]))
            return ERR_IO;
    return ERR_OK;
}

static bool connect_viewers(struct delivery *d)
{
    struct server_demand demand = { 0 };

    for (uint32_t i = 0; i < d->viewers; i++) {
        d->viewer[i] = connect_to(server_port(d->server));
        if (d->viewer[i] < 0 || !shake_hands(d->viewer[i]))
            return false;
    }
    const double end = clock_seconds() + WAIT_SECONDS;
    while (demand.viewers < d->viewers && clock_seconds() < end) {
        poll(NULL, 0, 5);
        server_demand(d->server, &demand);
    }
    return demand.viewers == d->viewers;
}

/* ---- Bare sockets ---- */

/* Writes the same bytes to each socket in turn, as often as requested. */
static void *write_main(void *arg)
{
    struct delivery *d = arg;

    for (uint64_t done = 0;; done++) {
        pthread_mutex_lock(&d->lock);
        while (d->requested == done)
            pthread_cond_wait(&d->wake, &d->lock);
        const bool ends = d->requested == UINT64_MAX;
        const uint32_t k = d->now;
        pthread_mutex_unlock(&d->lock);
        if (ends)
            return NULL;
        for (uint32_t i = 0; i < d->viewers; i++)
            for (size_t at = 0; at < d->size[k];) {
                const ssize_t n = send(d->ends[i], d->bytes[k] + at, d->size[k] - at, MSG_NOSIGNAL);
                if (n <= 0)
                    return NULL;
                at += (size_t)n;
            }
    }
}

static void request_images(struct delivery *d, uint64_t count)
{
    pthread_mutex_lock(&d->lock);
    d->requested = count;
    d->now = d->bench->turn % BENCH_SKIES;
    pthread_cond_signal(&d->wake);
    pthread_mutex_unlock(&d->lock);
}

static enum err deliver_bare(void *context)
{
    struct delivery *d = context;

    request_images(d, d->requested + 1);
    for (uint32_t i = 0; i < d->viewers; i++)
        if (!read_bytes(d->bare[i], d->room, ROOM, d->size[d->now]))
            return ERR_IO;
    return ERR_OK;
}

static bool connect_bare(struct delivery *d)
{
    struct sockaddr_in at = { .sin_family = AF_INET };
    socklen_t size = sizeof(at);
    const int listener = socket(AF_INET, SOCK_STREAM, 0), on = 1;

    at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    bool good = listener >= 0 && bind(listener, (struct sockaddr *)&at, sizeof(at)) == 0 &&
                listen(listener, VIEWERS_MAX) == 0 && getsockname(listener, (struct sockaddr *)&at, &size) == 0;
    for (uint32_t i = 0; i < d->viewers && good; i++) {
        d->bare[i] = connect_to(ntohs(at.sin_port));
        d->ends[i] = d->bare[i] >= 0 ? accept(listener, NULL, NULL) : -1;
        good = d->ends[i] >= 0 && setsockopt(d->ends[i], IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on)) == 0;
    }
    if (listener >= 0)
        close(listener);
    d->writes = good && pthread_create(&d->writer, NULL, write_main, d) == 0;
    return d->writes;
}

static void delivery_finish(struct delivery *d)
{
    for (uint32_t i = 0; i < d->viewers; i++) /* a blocked writer ends */
        if (d->bare[i] >= 0)
            close(d->bare[i]);
    if (d->writes) {
        request_images(d, UINT64_MAX);
        pthread_join(d->writer, NULL);
    }
    for (uint32_t i = 0; i < d->viewers; i++) {
        if (d->viewer[i] >= 0)
            close(d->viewer[i]);
        if (d->ends[i] >= 0)
            close(d->ends[i]);
    }
    server_destroy(d->server);
    pthread_mutex_destroy(&d->lock);
    pthread_cond_destroy(&d->wake);
    for (int k = 0; k < BENCH_SKIES; k++)
        mem_free(d->bytes[k]);
    mem_free(d->room);
}

/* The bench's images as JPEGs. */
static enum err make_bytes(struct delivery *d, const struct bench *b)
{
    struct jpeg_encoder *j = jpeg_encoder_create();
    const uint8_t *bytes;
    enum err e = j && (d->room = mem_alloc(ROOM, 1)) ? ERR_OK : ERR_NOMEM;

    for (int k = 0; k < BENCH_SKIES && !e; k++) {
        e = jpeg_encode(j, b->skies[k].display, b->desc->width, b->desc->height, BENCH_QUALITY, &bytes, &d->size[k]);
        if (!e && !(d->bytes[k] = mem_alloc(d->size[k], 1)))
            e = ERR_NOMEM;
        if (!e)
            memcpy(d->bytes[k], bytes, d->size[k]);
    }
    jpeg_encoder_destroy(j);
    return e;
}

enum err bench_delivery(struct bench *b, struct bench_row *row)
{
    const uint32_t viewers = b->desc->viewers < VIEWERS_MAX ? b->desc->viewers : VIEWERS_MAX;
    struct delivery d = {
        .bench = b,
        .viewers = viewers,
        .header = { .format = PROTOCOL_JPEG, .width = b->desc->width, .height = b->desc->height, .gain = 1.0f },
        .lock = PTHREAD_MUTEX_INITIALIZER,
        .wake = PTHREAD_COND_INITIALIZER,
    };
    const struct bench_pair pair = { { deliver, deliver_bare }, &d, .scale = { 1e3, 1e3 } };
    struct reason why = { "" };

    for (uint32_t i = 0; i < viewers; i++)
        d.viewer[i] = d.bare[i] = d.ends[i] = -1;
    enum err e = make_bytes(&d, b);
    snprintf(
        row->note, sizeof(row->note),
        "one image of about %zu bytes to %u viewers on this machine, until each has received it; bare: send and recv",
        d.size[0], viewers);
    if (!e && server_create(&(struct server_desc){ .port = 0 }, &d.server, &why))
        bench_skip(row, "%.150s", why.text);
    else if (!e && (!connect_viewers(&d) || !connect_bare(&d)))
        bench_skip(row, "viewers could not be connected");
    else if (!e)
        e = bench_time(b, &pair, row);
    if (e == ERR_IO) {
        bench_skip(row, "a connection was closed or timed out");
        e = ERR_OK;
    }
    delivery_finish(&d);
    return e;
}
