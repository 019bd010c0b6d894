/* Producers and recorders made of client.h. */
#pragma once

#include "net/stream/client.h"

static inline struct server *push_server(void)
{
    const struct server_desc desc = { .push = true, .max_frame_bytes = 1 << 20 };
    return server_start(&desc);
}

static inline json_t *hello(struct test_client *c, const struct server *s, const char *fields)
{
    char text[512];

    client_open(c, s);
    assert_int_equal(client_handshake(c, NULL), 101);
    snprintf(text, sizeof(text), "{\"op\":\"hello\",\"version\":{\"major\":1},%s}", fields);
    client_say(c, text);
    json_t *welcome = client_await(c, "welcome");
    if (!welcome)
        fail_msg("no welcome for %s; closed with %d: %s", fields, c->close_code, c->reason);
    return welcome;
}

static inline void produce_live(struct test_client *c, const struct server *s)
{
    json_decref(hello(c, s, "\"role\":\"producer\""));
}

/* The credit that comes with welcome; *after: its resume_after, -1 for null. */
static inline int produce_lockstep(struct test_client *c, const struct server *s, const char *name, int64_t *after)
{
    char fields[200];

    snprintf(fields, sizeof(fields), "\"role\":\"producer\",\"pace\":\"lockstep\",\"sequence\":\"%s\"", name);
    json_t *welcome = hello(c, s, fields), *producer = json_object_get(welcome, "producer");
    const json_t *resume = json_object_get(producer, "resume_after");
    const int credit = (int)json_integer_value(json_object_get(producer, "credit"));

    assert_true(json_is_null(resume) || json_is_integer(resume));
    *after = json_is_null(resume) ? -1 : json_integer_value(resume);
    json_decref(welcome);
    return credit;
}

/* Connects and subscribes; returns stored_after, -1 for null. */
static inline int64_t record(struct test_client *c, const struct server *s, const char *name, const char *format)
{
    char text[200];

    snprintf(text, sizeof(text), "\"role\":\"recorder\",\"recorder\":\"%s\"", name);
    json_t *welcome = hello(c, s, text);
    const json_t *after = json_object_get(json_object_get(welcome, "recorder"), "stored_after");
    const int64_t stored = json_is_integer(after) ? json_integer_value(after) : -1;

    json_decref(welcome);
    snprintf(text, sizeof(text), "{\"op\":\"subscribe\",\"format\":\"%s\"}", format);
    client_say(c, text);
    client_expect(c, "subscribed");
    return stored;
}

static inline void store(struct test_client *c, uint64_t sequence)
{
    char text[100];
    snprintf(text, sizeof(text), "{\"op\":\"ack\",\"sequence\":%llu,\"stored\":true}", (unsigned long long)sequence);
    client_say(c, text);
}

/* A 2x1 raw float frame whose texels say its number. Bytes to send; 48 + 24 of them. */
enum { FRAME_SIZE = PROTOCOL_ENVIRONMENT_BYTES + 24 };
static inline void frame_make(uint64_t number, uint8_t out[FRAME_SIZE])
{
    const struct protocol_environment e = {
        .encoding = PROTOCOL_RAW_FLOAT,
        .channels = 3,
        .width = 2,
        .height = 1,
        .payload = 24,
        .frame = number,
        .capture_us = (int64_t)number * 1000,
    };
    const float texels[6] = { (float)number, 1, 2, 3, 4, 5 };

    protocol_environment_encode(&e, out);
    memcpy(out + PROTOCOL_ENVIRONMENT_BYTES, texels, sizeof(texels));
}

static inline void frame_send(struct test_client *c, uint64_t number)
{
    uint8_t bytes[FRAME_SIZE];

    frame_make(number, bytes);
    client_frame(c, OP_BINARY, true, bytes, sizeof(bytes));
}

/* Any file or texels with a header that fits. */
static inline void payload_send(struct test_client *c, struct protocol_environment e, const void *payload)
{
    uint8_t *bytes = malloc(PROTOCOL_ENVIRONMENT_BYTES + e.payload);

    assert_non_null(bytes);
    protocol_environment_encode(&e, bytes);
    memcpy(bytes + PROTOCOL_ENVIRONMENT_BYTES, payload, e.payload);
    client_frame(c, OP_BINARY, true, bytes, PROTOCOL_ENVIRONMENT_BYTES + e.payload);
    free(bytes);
}

/* Waits for the fate of a frame. */
static inline void expect_fate(struct test_client *c, uint64_t number, const char *fate)
{
    json_t *m = client_await(c, "frame");

    if (!m)
        fail_msg("no fate of frame %llu; closed with %d: %s", (unsigned long long)number, c->close_code, c->reason);
    assert_int_equal(json_integer_value(json_object_get(m, "number")), number);
    assert_string_equal(json_string_value(json_object_get(m, "fate")), fate);
    json_decref(m);
}

static inline int credit_comes(struct test_client *c)
{
    json_t *m = client_await(c, "credit");
    const int frames = m ? (int)json_integer_value(json_object_get(m, "frames")) : 0;

    json_decref(m);
    return frames;
}

/* True when no message of that op comes for so long. */
static inline bool nothing_comes(struct test_client *c, const char *op, int wait_ms)
{
    char word[40];
    struct timespec begun, now;

    snprintf(word, sizeof(word), "\"op\":\"%s\"", op);
    clock_gettime(CLOCK_MONOTONIC, &begun);
    do {
        if (client_next(c, 50) == OP_TEXT && strstr((char *)c->message, word))
            return false;
        clock_gettime(CLOCK_MONOTONIC, &now);
    } while ((now.tv_sec - begun.tv_sec) * 1000 + (now.tv_nsec - begun.tv_nsec) / 1000000 < wait_ms);
    return true;
}

static inline void take(struct server *s, struct frame *f, struct server_ticket *t, uint64_t number)
{
    assert_true(server_take_frame(s, f, t, true, CLIENT_WAIT_MS));
    assert_int_equal(f->number, number);
}

/* An image of that frame, for its ticket. */
static inline void publish_for(struct server *s, enum protocol_format format, uint64_t frame,
                               const struct server_ticket *t)
{
    const struct protocol_picture header = {
        .format = format, .frame = frame, .capture_us = (int64_t)frame * 1000, .width = 4, .height = 4
    };
    struct sent_image *p = image_create(&header, (const uint8_t *)"picture", 7);

    assert_non_null(p);
    server_publish_for(s, p, t);
}

/* Waits until a counter has the value. */
#define COUNTER_BECOMES(s, field, value)                                                                               \
    do {                                                                                                               \
        struct server_counters counters_;                                                                              \
        for (int i_ = 0; i_ < CLIENT_WAIT_MS / 20; i_++) {                                                             \
            server_counters(s, &counters_);                                                                            \
            if (counters_.field == (uint64_t)(value))                                                                  \
                break;                                                                                                 \
            sleep_ms(20);                                                                                              \
        }                                                                                                              \
        assert_int_equal(counters_.field, value);                                                                      \
    } while (0)
