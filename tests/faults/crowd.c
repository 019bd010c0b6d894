/* Many cheap viewers of one server: crowd PORT VIEWERS RATE SECONDS [PATH]. Without PATH they speak relight.v1: each
 * subscribes to JPEG, reads and acknowledges. With PATH they request that file by HTTP, each RATE times a second on a
 * persistent connection. Prints {"viewers":..,"messages":..,"bytes":..,"seconds":..}; crowd.py measures the server's
 * cost. */
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

enum { VIEWERS_MAX = 1024, HEAD = 4096 };

struct viewer {
    int fd;
    uint8_t head[HEAD]; /* of the incoming message; the rest is only counted */
    size_t have;
    uint64_t skip; /* remaining bytes of it */
    bool upgraded;
    double due_s;
};

static struct viewer viewers[VIEWERS_MAX];
static uint8_t in[1 << 18];
static uint64_t messages, bytes;
static const char *path;

static double now_s(void)
{
    struct timespec t;

    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void say(const struct viewer *v, const void *text, size_t size)
{
    if (send(v->fd, text, size, MSG_NOSIGNAL) != (ssize_t)size) {
        perror("crowd: send");
        exit(1);
    }
}

/* A text as one frame, masked with zeros. */
static void say_frame(const struct viewer *v, const char *text)
{
    const size_t size = strlen(text);
    uint8_t out[256] = { 0x81, (uint8_t)(0x80 | size), 0, 0, 0, 0 };

    memcpy(out + 6, text, size); /* fewer than 126 bytes */
    say(v, out, size + 6);
}

static void ask(struct viewer *v)
{
    char text[256];
    const int size = snprintf(text, sizeof(text), "GET %s HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n", path);

    say(v, text, (size_t)size);
}

static void begin(struct viewer *v, uint16_t port)
{
    const struct sockaddr_in to = { .sin_family = AF_INET,
                                    .sin_port = htons(port),
                                    .sin_addr = { htonl(INADDR_LOOPBACK) } };
    static const char upgrade[] = "GET /ws HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                                  "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: c2l4dGVlbiBieXRlcyAhIQ==\r\n"
                                  "Sec-WebSocket-Protocol: relight.v1\r\n\r\n";
    const int on = 1;

    v->fd = socket(AF_INET, SOCK_STREAM, 0);
    if (v->fd < 0 || connect(v->fd, (const struct sockaddr *)&to, sizeof(to)) != 0) {
        perror("crowd: connect");
        exit(1);
    }
    setsockopt(v->fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
    if (!path) {
        say(v, upgrade, sizeof(upgrade) - 1);
    }
    fcntl(v->fd, F_SETFL, O_NONBLOCK);
}

/* Parses a complete message head: for HTTP up to its empty line, for a frame including 16 bytes of an image. Returns
 * its length and the length of the rest; 0: incomplete. */
static size_t http_head(const struct viewer *v, uint64_t *follows)
{
    const uint8_t *end = memmem(v->head, v->have, "\r\n\r\n", 4);
    const uint8_t *length = memmem(v->head, v->have, "Content-Length: ", 16);

    *follows = end && length && length < end ? strtoull((const char *)length + 16, NULL, 10) : 0;
    return end ? (size_t)(end - v->head) + 4 : 0;
}

static size_t frame_head(const struct viewer *v, uint64_t *follows)
{
    const uint8_t *h = v->head;
    const size_t wide = v->have < 2 ? 0 : h[1] == 126 ? 2 : h[1] == 127 ? 8 : 0;
    uint64_t size = v->have < 2 ? 0 : h[1];

    if (v->have < 2 + wide)
        return 0;
    if (wide)
        size = 0;
    for (size_t i = 0; i < wide; i++)
        size = size << 8 | h[2 + i];
    const size_t wanted = 2 + wide + (size < 16 ? (size_t)size : 16);
    if (v->have < wanted)
        return 0;
    *follows = size - (wanted - 2 - wide);
    return wanted;
}

static void take_frame(struct viewer *v, size_t head)
{
    const uint8_t *p = v->head + head - 16;
    char text[80];
    uint64_t sequence = 0;

    if ((v->head[0] & 15) != 2 || memcmp(p, "RLP1", 4) != 0)
        return;
    for (int i = 7; i >= 0; i--)
        sequence = sequence << 8 | p[8 + i];
    snprintf(text, sizeof(text), "{\"op\":\"ack\",\"sequence\":%llu}", (unsigned long long)sequence);
    say_frame(v, text);
    messages++;
}

static void take(struct viewer *v, const uint8_t *from, size_t size)
{
    bytes += size;
    while (size > 0) {
        if (v->skip > 0) {
            const size_t n = v->skip < size ? (size_t)v->skip : size;
            v->skip -= n;
            from += n;
            size -= n;
            continue;
        }
        if (v->have == HEAD)
            exit(3);
        v->head[v->have++] = *from++;
        size--;
        uint64_t follows = 0;
        const bool http = path || !v->upgraded;
        const size_t head = http ? http_head(v, &follows) : frame_head(v, &follows);
        if (head == 0)
            continue;
        if (path) {
            messages++;
        } else if (http) {
            v->upgraded = true;
            say_frame(v, "{\"op\":\"hello\",\"role\":\"viewer\",\"version\":{\"major\":1}}");
            say_frame(v, "{\"op\":\"subscribe\",\"format\":\"jpeg\"}");
        } else {
            take_frame(v, head);
        }
        v->have = 0;
        v->skip = follows;
    }
}

int main(int argc, char **argv)
{
    if (argc < 5)
        return 2;
    const int count = atoi(argv[2]);
    const double interval = 1.0 / atof(argv[3]), begun = now_s(), over = begun + atof(argv[4]);
    const int poll = epoll_create1(0);
    struct epoll_event events[64];

    path = argc > 5 ? argv[5] : NULL;
    if (count < 1 || count > VIEWERS_MAX)
        return 2;
    for (int i = 0; i < count; i++) {
        begin(&viewers[i], (uint16_t)atoi(argv[1]));
        viewers[i].due_s = now_s() + interval * i / count;
        epoll_ctl(poll, EPOLL_CTL_ADD, viewers[i].fd,
                  &(struct epoll_event){ .events = EPOLLIN, .data.ptr = &viewers[i] });
    }
    while (now_s() < over) {
        const int n = epoll_wait(poll, events, 64, path ? 1 : 50);
        for (int i = 0; i < n; i++) {
            struct viewer *v = events[i].data.ptr;
            const ssize_t got = recv(v->fd, in, sizeof(in), 0);
            if (got > 0)
                take(v, in, (size_t)got);
            else if (got == 0 || errno != EAGAIN)
                return fprintf(stderr, "crowd: a viewer was cut\n"), 1;
        }
        const double now = now_s();
        for (int i = 0; path && i < count; i++) {
            if (viewers[i].due_s <= now) {
                ask(&viewers[i]);
                viewers[i].due_s += interval;
            }
        }
    }
    printf("{\"viewers\":%d,\"messages\":%llu,\"bytes\":%llu,\"seconds\":%.3f}\n", count, (unsigned long long)messages,
           (unsigned long long)bytes, now_s() - begun);
    return 0;
}
