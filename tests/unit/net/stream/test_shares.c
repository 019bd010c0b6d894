/* What is bounded for each client is bounded for all together, and shared by address. */
#define CLIENT_MESSAGE_MAX ((size_t)16 << 20)
#include "net/stream/producing.h"

#include <malloc.h>

#define IMAGE_BYTES ((size_t)12 << 20)

/* From which the attacker and everyone else come. */
#define GREEDY "127.0.0.66"
#define OTHER "127.0.0.30"

/* How often that limit was reached, by /metrics. */
static long reached(const struct server *s, const char *limit)
{
    struct test_client c;
    char name[80];

    client_address = "127.0.0.1";
    client_open(&c, s);
    assert_int_equal(client_request(&c, "GET /metrics HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"), 200);
    const char *text = client_rest(&c);
    snprintf(name, sizeof(name), "relightd_limits_reached_total{limit=\"%s\"} ", limit);
    const char *at = strstr(text, name);
    assert_non_null(at);
    const long count = strtol(at + strlen(name), NULL, 10);
    client_shut(&c);
    return count;
}

static struct server *server_with_size(void)
{
    struct server *s = server_start(NULL);

    server_set_figures(s, &(struct server_figures){ .source = SERVER_LIVE, .width = 320, .height = 180 });
    publish(s, 1, 1000);
    return s;
}

/* ---- Memory ---- */

/* Watches, and reads the beginning of an image only. */
static void begin_to_watch(struct test_client *c, const struct server *s)
{
    client_buffer = 65536;
    client_open(c, s);
    client_buffer = 0;
    assert_int_equal(client_handshake(c, NULL), 101);
    client_say(c, "{\"op\":\"hello\",\"role\":\"viewer\",\"version\":{\"major\":1}}");
    client_expect(c, "welcome");
    client_say(c, "{\"op\":\"subscribe\",\"format\":\"jpeg\"}");
    client_expect(c, "subscribed");
    for (int i = 0; i < 4; i++)
        assert_true(client_fill(c, CLIENT_WAIT_MS));
}

/* Slow, but not stalled, however long the others take: the server notices once a third of its send buffer is free, so
 * for thirty times this takes most of the image. */
static void take_a_little(struct test_client *c)
{
    for (const size_t to = c->in_size + IMAGE_BYTES / 36; c->in_size < to;)
        assert_true(client_fill(c, CLIENT_WAIT_MS));
}

/* Each holds another image. All together may hold 128 MiB; who has most of it loses a connection, and who is alone and
 * slow at his address keeps his. */
static void slow_viewers_together_hold_no_more_than_the_limit(void **state)
{
    enum { SLOW = 30 };
    const struct server_desc desc = { .silent_s = 600 }; /* nobody answers pings here */
    struct server *s = server_start(&desc);
    struct test_client slow[SLOW], patient;
    struct protocol_picture h;
    uint64_t n = 1;
    (void)state;

    mallopt(M_MMAP_THRESHOLD, 1 << 20); /* what is freed is no longer resident */
    publish(s, n, IMAGE_BYTES);
    client_address = OTHER;
    begin_to_watch(&patient, s);
    const long before = resident_kib();
    client_address = GREEDY;
    for (int i = 0; i < SLOW; i++) {
        publish(s, ++n, IMAGE_BYTES);
        begin_to_watch(&slow[i], s);
        client_address = GREEDY;
        take_a_little(&patient);
    }
    const long grown_mib = (resident_kib() - before) / 1024;
    struct server_counters counters;
    server_counters(s, &counters);
    const long cut = reached(s, "memory") + (long)counters.stalled; /* on a busy machine they are stalled before */
    if (cut < SLOW - 12 || cut >= SLOW)
        fail_msg("%ld of %d were cut", cut, SLOW);
    /* The clients of this process read next to nothing; without a limit it would be 360. */
    if (grown_mib > 160)
        fail_msg("%ld MiB more are taken", grown_mib);
    assert_int_equal(client_picture(&patient, &h, CLIENT_WAIT_MS), 1);
    for (int i = 0; i < SLOW; i++)
        client_shut(&slow[i]);
    client_shut(&patient);
    server_destroy(s);
}

/* ---- Widths ---- */

static void ask_stream(struct test_client *c, const struct server *s, const char *path)
{
    char request[128];

    client_open(c, s);
    snprintf(request, sizeof(request), "GET %s HTTP/1.1\r\nHost: localhost\r\n\r\n", path);
    client_write(c, request, strlen(request));
}

/* The slot of that width. */
static unsigned slot_of(struct server *s, uint32_t width)
{
    struct server_demand d;

    for (int i = 0; i < CLIENT_WAIT_MS; i++) {
        server_demand(s, &d);
        for (unsigned k = 0; k < SERVER_RENDITIONS; k++)
            if (d.renditions[k].image != SERVER_NO_IMAGE && d.renditions[k].width == width)
                return k;
        sleep_ms(1);
    }
    fail_msg("width %u is not wanted", width);
    return 0;
}

static void nobody_keeps_all_widths(void **state)
{
    struct server *s = server_with_size();
    struct test_client greedy[SERVER_RENDITIONS], more, other;
    struct server_demand d;
    char path[64];
    (void)state;

    client_address = GREEDY;
    for (uint32_t i = 0; i < SERVER_RENDITIONS; i++) {
        snprintf(path, sizeof(path), "/stream.mjpeg?width=%u", 20 + i);
        ask_stream(&greedy[i], s, path);
        slot_of(s, 20 + i);
    }
    ask_stream(&more, s, "/stream.mjpeg?width=90"); /* of the same address */
    assert_int_equal(client_request(&more, ""), 503);
    client_address = OTHER;
    ask_stream(&other, s, "/snapshot.jpg?width=50");
    const unsigned slot = slot_of(s, 50);
    server_demand(s, &d);
    unsigned owners[2] = { 0 };
    for (unsigned k = 0; k < SERVER_RENDITIONS; k++)
        owners[d.renditions[k].owner == d.renditions[slot].owner]++;
    assert_int_equal(owners[0], SERVER_RENDITIONS - 1);
    assert_int_equal(owners[1], 1);
    assert_int_equal(reached(s, "widths"), 2);
    for (int i = 0; i < SERVER_RENDITIONS; i++)
        client_shut(&greedy[i]);
    client_shut(&more);
    client_shut(&other);
    server_destroy(s);
}

static void two_addresses_keep_all_widths_no_more_than_one(void **state)
{
    enum { EACH = SERVER_RENDITIONS };
    struct server *s = server_with_size();
    struct test_client greedy[2 * EACH], other;
    char path[64];
    (void)state;

    for (uint32_t i = 0; i < 2 * EACH; i++) { /* the same widths, in turn */
        client_address = i % 2 ? "127.0.0.67" : GREEDY;
        snprintf(path, sizeof(path), "/stream.mjpeg?width=%u", 20 + i / 2);
        ask_stream(&greedy[i], s, path);
        slot_of(s, 20 + i / 2);
    }
    client_address = OTHER;
    ask_stream(&other, s, "/snapshot.jpg?width=50");
    slot_of(s, 50);
    for (int i = 0; i < 2 * EACH; i++)
        client_shut(&greedy[i]);
    client_shut(&other);
    server_destroy(s);
}

/* ---- Pixels ---- */

static void greet(struct test_client *c, const struct server *s, const char *address)
{
    client_address = address;
    client_greet(c, s);
    client_address = "127.0.0.1";
}

/* Says it, and waits until it was heard. */
static void say_heard(struct test_client *c, const char *text)
{
    client_say(c, text);
    client_say(c, "{\"op\":\"ping\",\"id\":1}");
    client_expect(c, "pong");
}

static const char question[] = "{\"op\":\"probe\",\"request\":7,\"x\":1,\"y\":1}";

/* Forty questions of one address wait for an answer; another's is the next. */
static void questions_take_turns_by_address(void **state)
{
    enum { MANY = 40, WAITING = 32 };
    struct server *s = server_with_size();
    struct test_client greedy[MANY], other;
    struct server_inspection q;
    (void)state;

    for (int i = 0; i < MANY; i++)
        greet(&greedy[i], s, GREEDY);
    greet(&other, s, OTHER);
    say_heard(&greedy[0], question);
    assert_true(server_take_inspection(s, &q));
    for (int i = 1; i < MANY; i++)
        say_heard(&greedy[i], question);
    say_heard(&other, "{\"op\":\"probe\",\"request\":8,\"x\":1,\"y\":1}");
    assert_true(server_take_inspection(s, &q));
    assert_int_equal(q.request, 8);
    assert_int_equal(reached(s, "pixels"), MANY - 1 - WAITING + 1);
    for (int i = 0; i < MANY; i++)
        client_shut(&greedy[i]);
    client_shut(&other);
    server_destroy(s);
}

/* Whoever asks for the sky alone shares one answer and takes no place. */
static void the_sky_is_told_to_all_at_once(void **state)
{
    enum { MANY = 40 };
    struct server *s = server_with_size();
    struct test_client c[MANY];
    struct server_inspection q;
    char text[80];
    (void)state;

    for (int i = 0; i < MANY; i++) {
        greet(&c[i], s, GREEDY);
        snprintf(text, sizeof(text), "{\"op\":\"probe\",\"request\":%d,\"sky\":true}", i);
        say_heard(&c[i], text);
    }
    assert_true(server_take_inspection(s, &q) && q.sky_alone);
    assert_false(server_take_inspection(s, &q));
    server_answer_inspection(s, &(struct server_inspection){ .sky_alone = true }, "{\"frame\":3}", NULL);
    for (int i = 0; i < MANY; i++) {
        json_t *m = client_await(&c[i], "probed");
        assert_int_equal(json_integer_value(json_object_get(m, "request")), i);
        json_decref(m);
        client_shut(&c[i]);
    }
    server_destroy(s);
}

static void followed_pixels_are_shared(void **state)
{
    struct server *s = server_with_size();
    struct test_client greedy[SERVER_FOLLOWED_MAX], other;
    struct server_follow f[SERVER_FOLLOWED_MAX];
    int mine = 0;
    (void)state;

    for (int i = 0; i < SERVER_FOLLOWED_MAX; i++) {
        greet(&greedy[i], s, GREEDY);
        say_heard(&greedy[i], "{\"op\":\"probe\",\"x\":1,\"y\":1,\"follow\":true}");
    }
    greet(&other, s, OTHER);
    say_heard(&other, "{\"op\":\"probe\",\"x\":9,\"y\":9,\"follow\":true}");
    assert_int_equal(server_followed(s, f), SERVER_FOLLOWED_MAX);
    for (int i = 0; i < SERVER_FOLLOWED_MAX; i++)
        mine += f[i].x == 9;
    assert_int_equal(mine, 1);
    json_t *m = client_await(&greedy[SERVER_FOLLOWED_MAX - 1], "error");
    assert_string_equal(json_string_value(json_object_get(m, "code")), "busy");
    json_decref(m);
    for (int i = 0; i < SERVER_FOLLOWED_MAX; i++)
        client_shut(&greedy[i]);
    client_shut(&other);
    server_destroy(s);
}

/* ---- Names ---- */

/* A producer that is refused since another is there takes no name: one would have to be forgotten for it. */
static void a_refused_producer_takes_no_name(void **state)
{
    struct server *s = push_server();
    struct test_client p, r, other;
    struct server_ticket t;
    struct frame f = { 0 };
    int64_t after = 0;
    char text[160];
    (void)state;

    record(&r, s, "kept", "jpeg");
    assert_int_equal(produce_lockstep(&p, s, "kept", &after), 1);
    frame_send(&p, 7);
    take(s, &f, &t, 7);
    publish_for(s, PROTOCOL_JPEG, 7, &t);
    struct protocol_picture h;
    store(&r, client_picture(&r, &h, CLIENT_WAIT_MS));
    expect_fate(&p, 7, "used");
    client_shut(&p);
    client_shut(&r);
    produce_live(&p, s);
    for (int i = 0; i < 20; i++) {
        client_open(&other, s);
        assert_int_equal(client_handshake(&other, NULL), 101);
        snprintf(text, sizeof(text),
                 "{\"op\":\"hello\",\"role\":\"producer\",\"version\":{\"major\":1},\"pace\":\"lockstep\","
                 "\"sequence\":\"n%d\"}",
                 i);
        client_say(&other, text);
        client_close_code(&other);
        client_shut(&other);
    }
    client_shut(&p);
    COUNTER_BECOMES(s, open, 0);
    produce_lockstep(&p, s, "kept", &after);
    assert_int_equal(after, 7);
    client_shut(&p);
    frame_finish(&f);
    server_destroy(s);
}

/* Names that one address takes one after the other are forgotten before those of others. */
static void one_address_forgets_its_own_names(void **state)
{
    struct server *s = push_server();
    struct test_client p, r;
    struct server_ticket t;
    struct protocol_picture h;
    struct frame f = { 0 };
    int64_t after = 0;
    char name[20];
    (void)state;

    client_address = OTHER;
    record(&r, s, "kept", "jpeg");
    assert_int_equal(produce_lockstep(&p, s, "kept", &after), 1);
    frame_send(&p, 7);
    take(s, &f, &t, 7);
    publish_for(s, PROTOCOL_JPEG, 7, &t);
    store(&r, client_picture(&r, &h, CLIENT_WAIT_MS));
    expect_fate(&p, 7, "used");
    client_shut(&p);
    client_shut(&r);
    client_address = GREEDY;
    for (int i = 0; i < 40; i++) {
        snprintf(name, sizeof(name), "n%d", i);
        record(&r, s, name, "jpeg");
        client_shut(&r);
        COUNTER_BECOMES(s, open, 0);
    }
    client_address = OTHER;
    produce_lockstep(&p, s, "kept", &after);
    assert_int_equal(after, 7);
    client_address = "127.0.0.1";
    client_shut(&p);
    frame_finish(&f);
    server_destroy(s);
}

/* A pause is a controller's setting, of which lockstep sequences know nothing. */
static void a_pause_holds_live_frames_only(void **state)
{
    struct server *s = push_server();
    struct test_client p, r;
    struct server_ticket t;
    struct frame f = { 0 };
    int64_t after = 0;
    (void)state;

    produce_live(&p, s);
    frame_send(&p, 1);
    assert_false(server_take_frame(s, &f, &t, false, 300));
    assert_true(server_take_frame(s, &f, &t, true, CLIENT_WAIT_MS));
    client_shut(&p);
    COUNTER_BECOMES(s, open, 0);
    record(&r, s, "a", "jpeg");
    assert_int_equal(produce_lockstep(&p, s, "a", &after), 1);
    frame_send(&p, 1);
    assert_true(server_take_frame(s, &f, &t, false, CLIENT_WAIT_MS));
    assert_true(t.lockstep);
    client_shut(&p);
    client_shut(&r);
    frame_finish(&f);
    server_destroy(s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(slow_viewers_together_hold_no_more_than_the_limit),
    cmocka_unit_test(nobody_keeps_all_widths),
    cmocka_unit_test(two_addresses_keep_all_widths_no_more_than_one),
    cmocka_unit_test(questions_take_turns_by_address),
    cmocka_unit_test(the_sky_is_told_to_all_at_once),
    cmocka_unit_test(followed_pixels_are_shared),
    cmocka_unit_test(a_refused_producer_takes_no_name),
    cmocka_unit_test(one_address_forgets_its_own_names),
    cmocka_unit_test(a_pause_holds_live_frames_only),
};

UNIT_MAIN(tests)
