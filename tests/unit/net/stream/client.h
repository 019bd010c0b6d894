/* A WebSocket client made of a plain socket, so that every byte on the wire, right or wrong, is the test's own choice.
 * All waiting ends after CLIENT_WAIT_MS, which only ends a hang. */
#pragma once

#include "support/unit.h"

#include "net/stream/server.h"

#include <arpa/inet.h>
#include <ctype.h>
#include <jansson.h>
#include <netinet/in.h>
#include <poll.h>
#include <stdbool.h>
#include <strings.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#define CLIENT_WAIT_MS 600000
#ifndef CLIENT_MESSAGE_MAX
#define CLIENT_MESSAGE_MAX ((size_t)32 << 20)
#endif

enum { OP_CONTINUE = 0, OP_TEXT = 1, OP_BINARY = 2, OP_CLOSE = 8, OP_PING = 9, OP_PONG = 10 };

struct test_client {
    int fd;
    uint8_t *in; /* received and not yet taken */
    size_t in_size;
    uint8_t *message; /* the last whole one, with a 0 behind it */
    size_t size;
    int op;         /* its opcode */
    int close_code; /* of a close frame; -1 for an end without one */
    char reason[128];
};

static inline struct server *server_start(const struct server_desc *given)
{
    const struct server_desc none = { 0 };
    struct server *s = NULL;
    struct reason why = { { 0 } };

    if (server_create(given ? given : &none, &s, &why) != ERR_OK)
        fail_msg("%s", why.text);
    return s;
}

/* The address of those opened from now on, which stands for another machine: 127.0.0.0/8 is all ours. */
static const char *client_address = "127.0.0.1";

/* Their receive buffer, which must be known before they connect: what they do not read waits in it. 0: the system's. */
static int client_buffer;

static inline void client_open_port(struct test_client *c, uint16_t port)
{
    struct sockaddr_in to = { .sin_family = AF_INET, .sin_port = htons(port) }, from = { .sin_family = AF_INET };

    *c = (struct test_client){ .fd = socket(AF_INET, SOCK_STREAM, 0), .close_code = 0 };
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    assert_true(c->fd >= 0);
    assert_int_equal(inet_pton(AF_INET, client_address, &from.sin_addr), 1);
    assert_int_equal(bind(c->fd, (struct sockaddr *)&from, sizeof(from)), 0);
    if (client_buffer)
        assert_int_equal(setsockopt(c->fd, SOL_SOCKET, SO_RCVBUF, &client_buffer, sizeof(client_buffer)), 0);
    assert_int_equal(connect(c->fd, (struct sockaddr *)&to, sizeof(to)), 0);
    c->in = malloc(CLIENT_MESSAGE_MAX);
    c->message = malloc(CLIENT_MESSAGE_MAX + 1);
    assert_non_null(c->in);
    assert_non_null(c->message);
}

static inline void client_open(struct test_client *c, const struct server *s)
{
    client_open_port(c, server_port(s));
}

static inline void client_shut(struct test_client *c)
{
    close(c->fd);
    free(c->in);
    free(c->message);
}

static inline void client_write(struct test_client *c, const void *bytes, size_t size)
{
    const uint8_t *from = bytes;

    while (size > 0) {
        const ssize_t n = send(c->fd, from, size, MSG_NOSIGNAL);
        if (n <= 0)
            return; /* closed by the server: what comes next will say so */
        from += n;
        size -= (size_t)n;
    }
}

/* More bytes into c->in; false at the end of the stream or when nothing came in time. */
static inline bool client_fill(struct test_client *c, int wait_ms)
{
    struct pollfd p = { .fd = c->fd, .events = POLLIN };

    if (poll(&p, 1, wait_ms) <= 0)
        return false;
    const ssize_t n = recv(c->fd, c->in + c->in_size, CLIENT_MESSAGE_MAX - c->in_size, 0);
    if (n <= 0)
        return false;
    c->in_size += (size_t)n;
    return true;
}

static inline void client_drop(struct test_client *c, size_t size)
{
    memmove(c->in, c->in + size, c->in_size - size);
    c->in_size -= size;
}

/* Sends a request and reads up to the end of the answer's header, which stays in c->message. The status, or 0. */
static inline int client_request(struct test_client *c, const char *text)
{
    client_write(c, text, strlen(text));
    for (;;) {
        for (size_t i = 0; i + 4 <= c->in_size; i++) {
            if (memcmp(c->in + i, "\r\n\r\n", 4) == 0) {
                memcpy(c->message, c->in, i + 4);
                c->message[i + 4] = 0;
                client_drop(c, i + 4);
                return atoi((char *)c->message + 9);
            }
        }
        if (!client_fill(c, CLIENT_WAIT_MS))
            return 0;
    }
}

/* Everything up to the end of the connection, as text in c->message. */
static inline const char *client_rest(struct test_client *c)
{
    while (client_fill(c, CLIENT_WAIT_MS)) {
    }
    memcpy(c->message, c->in, c->in_size);
    c->message[c->in_size] = 0;
    return (char *)c->message;
}

/* A handshake with these header lines in place of the usual ones where not NULL. The status of the answer. */
struct handshake {
    const char *path, *host, *origin, *protocol, *version, *extra;
};

static inline int client_handshake(struct test_client *c, const struct handshake *h)
{
    char text[4096];
    const struct handshake none = { 0 };

    h = h ? h : &none;
    snprintf(
        text, sizeof(text),
        "GET %s HTTP/1.1\r\nHost: %s\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: %s\r\n%s%s%s%s%s%s%s\r\n",
        h->path ? h->path : PROTOCOL_PATH, h->host ? h->host : "127.0.0.1", h->version ? h->version : "13",
        h->protocol && !h->protocol[0] ? "" : "Sec-WebSocket-Protocol: ", h->protocol ? h->protocol : PROTOCOL_NAME,
        h->protocol && !h->protocol[0] ? "" : "\r\n", h->origin ? "Origin: " : "", h->origin ? h->origin : "",
        h->origin ? "\r\n" : "", h->extra ? h->extra : "");
    return client_request(c, text);
}

/* One frame as it is: any opcode, with or without FIN, masked as a client must. */
static inline void client_frame(struct test_client *c, int op, bool fin, const void *bytes, size_t size)
{
    const uint8_t mask[4] = { 0x11, 0x22, 0x33, 0x44 };
    uint8_t *out = malloc(size + 14);
    size_t n = 0;

    assert_non_null(out);
    out[n++] = (uint8_t)((fin ? 0x80 : 0) | op);
    if (size < 126) {
        out[n++] = (uint8_t)(0x80 | size);
    } else if (size < 65536) {
        out[n++] = 0x80 | 126;
        out[n++] = (uint8_t)(size >> 8);
        out[n++] = (uint8_t)size;
    } else {
        out[n++] = 0x80 | 127;
        for (int i = 7; i >= 0; i--)
            out[n++] = (uint8_t)((uint64_t)size >> (8 * i));
    }
    memcpy(out + n, mask, 4);
    n += 4;
    for (size_t i = 0; i < size; i++)
        out[n + i] = ((const uint8_t *)bytes)[i] ^ mask[i % 4];
    client_write(c, out, n + size);
    free(out);
}

static inline void client_say(struct test_client *c, const char *text)
{
    client_frame(c, OP_TEXT, true, text, strlen(text));
}

/* Takes one frame from the wire: appended to the message. 0 when there is none in time or the stream has ended. */
static inline int client_take_frame(struct test_client *c, int *op, bool *fin, int wait_ms)
{
    size_t head = 2, length = 0;

    for (;;) {
        if (c->in_size >= 2) {
            length = c->in[1] & 0x7f;
            head = length == 126 ? 4 : length == 127 ? 10 : 2;
            if (c->in_size >= head) {
                if (head > 2)
                    length = 0;
                for (size_t i = 2; i < head; i++)
                    length = length << 8 | c->in[i];
                if (c->in_size >= head + length)
                    break;
            }
        }
        if (!client_fill(c, wait_ms))
            return 0;
    }
    *op = c->in[0] & 15;
    *fin = c->in[0] >> 7;
    assert_int_equal(c->in[1] & 0x80, 0); /* a server must not mask */
    if (*op < 8) {
        memcpy(c->message + c->size, c->in + head, length);
        c->size += length;
        c->message[c->size] = 0;
    } else if (*op == OP_CLOSE) {
        c->close_code = length >= 2 ? c->in[head] << 8 | c->in[head + 1] : 1005;
        snprintf(c->reason, sizeof(c->reason), "%.*s", length > 2 ? (int)length - 2 : 0, (char *)c->in + head + 2);
    }
    client_drop(c, head + length);
    return 1;
}

/* The next whole message: OP_TEXT, OP_BINARY, OP_CLOSE, or 0 when nothing comes within wait_ms. Pings are passed over.
 */
static inline int client_next(struct test_client *c, int wait_ms)
{
    bool fin = false;
    int op = 0;

    c->size = 0;
    c->op = 0;
    for (;;) {
        if (!client_take_frame(c, &op, &fin, wait_ms)) {
            char byte;
            if (recv(c->fd, &byte, 1, MSG_PEEK | MSG_DONTWAIT) == 0)
                c->close_code = c->close_code ? c->close_code : -1;
            return 0;
        }
        if (op == OP_CLOSE)
            return OP_CLOSE;
        if (op >= 8)
            continue;
        if (op != OP_CONTINUE)
            c->op = op;
        if (fin)
            return c->op;
    }
}

/* Passes over what comes until a text message of this op; NULL when there is none in time. The caller frees. */
static inline json_t *client_await(struct test_client *c, const char *op)
{
    for (int got; (got = client_next(c, CLIENT_WAIT_MS)) != 0 && got != OP_CLOSE;) {
        if (got != OP_TEXT)
            continue;
        json_t *object = json_loadb((char *)c->message, c->size, 0, NULL);
        assert_non_null(object);
        if (strcmp(json_string_value(json_object_get(object, "op")), op) == 0)
            return object;
        json_decref(object);
    }
    return NULL;
}

static inline void client_expect(struct test_client *c, const char *op)
{
    json_t *object = client_await(c, op);
    if (!object)
        fail_msg("no %s came", op);
    json_decref(object);
}

/* Passes over texts until an image; the sequence number, or 0. Its header stays in *h. */
static inline uint64_t client_picture(struct test_client *c, struct protocol_picture *h, int wait_ms)
{
    struct timespec begun, now;
    size_t offset;

    clock_gettime(CLOCK_MONOTONIC, &begun);
    for (int got; (got = client_next(c, wait_ms)) != 0 && got != OP_CLOSE;) {
        if (got == OP_BINARY) {
            assert_int_equal(protocol_picture_decode(c->message, c->size, h, &offset), PROTOCOL_OK);
            return h->sequence;
        }
        clock_gettime(CLOCK_MONOTONIC, &now);
        if ((now.tv_sec - begun.tv_sec) * 1000 + (now.tv_nsec - begun.tv_nsec) / 1000000 > wait_ms)
            return 0;
    }
    return 0;
}

/* Passes over everything until the connection is closed, and returns the code. */
static inline int client_close_code(struct test_client *c)
{
    for (int got; (got = client_next(c, CLIENT_WAIT_MS)) != 0 && got != OP_CLOSE;) {
    }
    return c->close_code;
}

/* Opens, shakes hands and says hello. */
static inline void client_greet(struct test_client *c, const struct server *s)
{
    client_open(c, s);
    assert_int_equal(client_handshake(c, NULL), 101);
    client_say(c, "{\"op\":\"hello\",\"role\":\"viewer\",\"version\":{\"major\":1,\"minor\":0}}");
    client_expect(c, "welcome");
}

static inline void client_watch(struct test_client *c, const struct server *s)
{
    client_greet(c, s);
    client_say(c, "{\"op\":\"subscribe\",\"format\":\"jpeg\"}");
    client_expect(c, "subscribed");
}

static inline void client_ack(struct test_client *c, uint64_t sequence)
{
    char text[80];
    snprintf(text, sizeof(text), "{\"op\":\"ack\",\"sequence\":%llu}", (unsigned long long)sequence);
    client_say(c, text);
}

/* An image of `size` bytes that all depend on `frame`. */
static inline void publish(struct server *s, uint64_t frame, size_t size)
{
    const struct protocol_picture header = {
        .format = PROTOCOL_JPEG,
        .frame = frame,
        .width = 64,
        .height = 36,
        .gain = 1.0f,
        .samples = 64,
    };
    uint8_t *bytes = malloc(size);

    assert_non_null(bytes);
    for (size_t i = 0; i < size; i++)
        bytes[i] = (uint8_t)(frame * 31 + i * 7);
    struct sent_image *p = image_create(&header, bytes, size);
    free(bytes);
    assert_non_null(p);
    server_publish(s, p);
}

static inline void sleep_ms(long ms)
{
    const struct timespec t = { ms / 1000, ms % 1000 * 1000000 };
    nanosleep(&t, NULL);
}

/* 0 under AddressSanitizer, which keeps freed memory on purpose. */
static inline long resident_kib(void)
{
#ifdef __SANITIZE_ADDRESS__
    return 0;
#endif
    char line[256];
    long kib = 0;
    FILE *in = fopen("/proc/self/status", "r");

    assert_non_null(in);
    while (fgets(line, sizeof(line), in))
        sscanf(line, "VmRSS: %ld", &kib);
    fclose(in);
    return kib;
}
