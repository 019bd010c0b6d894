/* PROTOCOL.md sections 4.1, 5.7 and 7: live producers, and what they can do wrong. */
#include "net/stream/producing.h"

#include <math.h>

static void a_raw_frame_arrives_bit_for_bit_and_its_fate_is_told(void **state)
{
    (void)state;
    struct server *s = push_server();
    struct frame f = { 0 };
    struct server_ticket t;
    struct test_client c;

    produce_live(&c, s);
    frame_send(&c, 17);
    take(s, &f, &t, 17);
    assert_int_equal(f.kind, FRAME_TEXELS);
    assert_int_equal(f.width, 2);
    assert_int_equal(f.height, 1);
    assert_int_equal(f.capture_us, 17000);
    assert_string_equal(f.layout, "auto");
    assert_non_null(strstr(f.name, "frame 17 of producer 127.0.0.1"));
    const float want[6] = { 17, 1, 2, 3, 4, 5 };
    assert_memory_equal(f.rgb, want, sizeof(want));
    assert_false(t.lockstep);
    publish_for(s, PROTOCOL_JPEG, 17, &t);
    json_t *m = client_await(&c, "frame");
    assert_non_null(m);
    assert_string_equal(json_string_value(json_object_get(m, "fate")), "used");
    assert_int_equal(json_integer_value(json_object_get(m, "sequence")), 1);
    json_decref(m);
    server_frame_fate(s, &t, SERVER_REFUSED, "too late"); /* does nothing */
    COUNTER_BECOMES(s, frames_refused, 0);
    COUNTER_BECOMES(s, frames_received, 1);
    COUNTER_BECOMES(s, frame_bytes, FRAME_SIZE);
    client_shut(&c);
    frame_finish(&f);
    server_destroy(s);
}

static void halves_alpha_and_rows_from_the_bottom_are_put_right(void **state)
{
    (void)state;
    static const uint16_t halves[2][4] = { { 0x3c00, 0xc000, 0x0001, 0x7bff }, { 0x7c00, 0x3555, 0, 0x3c00 } };
    static const float floats[2][4] = { { 1, 2, 3, 99 }, { 4, 5, 6, 99 } };
    const struct protocol_environment half = { .encoding = PROTOCOL_RAW_HALF,
                                               .layout = PROTOCOL_LATLONG,
                                               .flags = PROTOCOL_BOTTOM_FIRST,
                                               .channels = 4,
                                               .width = 1,
                                               .height = 2,
                                               .payload = sizeof(halves),
                                               .frame = 1 };
    struct protocol_environment single = half;
    struct server *s = push_server();
    struct frame f = { 0 };
    struct server_ticket t;
    struct test_client c;

    single.encoding = PROTOCOL_RAW_FLOAT;
    single.flags = 0;
    single.layout = PROTOCOL_FISHEYE;
    single.payload = sizeof(floats);
    single.frame = 2;
    produce_live(&c, s);
    payload_send(&c, half, halves);
    take(s, &f, &t, 1);
    assert_int_equal(credit_comes(&c), 1);
    assert_string_equal(f.layout, "latlong");
    const float want[6] = { INFINITY, 0x1.554p-2f, 0, 1, -2, 0x1p-24f };
    assert_memory_equal(f.rgb, want, sizeof(want));
    payload_send(&c, single, floats);
    take(s, &f, &t, 2);
    assert_string_equal(f.layout, "fisheye");
    const float rgb[6] = { 1, 2, 3, 4, 5, 6 };
    assert_memory_equal(f.rgb, rgb, sizeof(rgb));
    single.layout = PROTOCOL_CUBE_6X1;
    single.frame = 3;
    payload_send(&c, single, floats);
    take(s, &f, &t, 3);
    assert_string_equal(f.layout, "cube-6x1");
    client_shut(&c);
    frame_finish(&f);
    server_destroy(s);
}

static void the_newest_frame_wins_and_the_other_is_told(void **state)
{
    (void)state;
    struct server *s = push_server();
    struct frame f = { 0 };
    struct server_ticket t;
    struct test_client c;

    produce_live(&c, s);
    frame_send(&c, 1);
    frame_send(&c, 2);
    expect_fate(&c, 1, "superseded");
    assert_int_equal(credit_comes(&c), 1);
    frame_send(&c, 3);
    expect_fate(&c, 2, "superseded");
    take(s, &f, &t, 3);
    assert_false(server_take_frame(s, &f, &t, true, 20));
    COUNTER_BECOMES(s, frames_superseded, 2);
    client_shut(&c);
    frame_finish(&f);
    server_destroy(s);
}

static void a_frame_may_come_in_pieces_of_any_size(void **state)
{
    (void)state;
    const struct protocol_environment e = {
        .encoding = PROTOCOL_FILE_HDR, .payload = 300000, .frame = 5, .layout = PROTOCOL_VCROSS
    };
    uint8_t *bytes = malloc(PROTOCOL_ENVIRONMENT_BYTES + e.payload);
    const size_t size = PROTOCOL_ENVIRONMENT_BYTES + e.payload;
    struct server *s = push_server();
    struct frame f = { 0 };
    struct server_ticket t;
    struct test_client c;
    size_t at = 0;

    protocol_environment_encode(&e, bytes);
    for (size_t i = 0; i < e.payload; i++)
        bytes[PROTOCOL_ENVIRONMENT_BYTES + i] = (uint8_t)(i * 7);
    memcpy(bytes + PROTOCOL_ENVIRONMENT_BYTES, "#?", 2);
    produce_live(&c, s);
    for (size_t piece = 0; at < size; piece = piece * 2 + 1) {
        const size_t n = piece < size - at ? piece : size - at;
        client_frame(&c, at ? OP_CONTINUE : piece ? OP_CONTINUE : OP_BINARY, false, bytes + at, n);
        client_frame(&c, OP_PING, true, "x", 1); /* between any two of them */
        at += n;
    }
    client_frame(&c, OP_CONTINUE, true, "", 0);
    take(s, &f, &t, 5);
    assert_int_equal(f.kind, FRAME_FILE);
    assert_int_equal(f.size, e.payload);
    assert_string_equal(f.layout, "vcross");
    assert_memory_equal(f.bytes, bytes + PROTOCOL_ENVIRONMENT_BYTES, e.payload);
    client_shut(&c);
    free(bytes);
    frame_finish(&f);
    server_destroy(s);
}

/* One thing that a producer does wrong, and what it must be told. Meanwhile a viewer watches. */
struct offence {
    void (*commit)(struct test_client *c);
    int close_code;
    const char *code, *clause;
};

static void altered(struct test_client *c, size_t at, uint8_t value)
{
    uint8_t bytes[FRAME_SIZE];

    frame_make(1, bytes);
    bytes[at] = value;
    client_frame(c, OP_BINARY, true, bytes, sizeof(bytes));
}
static void cut(struct test_client *c)
{
    uint8_t bytes[FRAME_SIZE];
    frame_make(1, bytes);
    client_frame(c, OP_BINARY, true, bytes, 20);
}
static void short_payload(struct test_client *c)
{
    uint8_t bytes[FRAME_SIZE];
    frame_make(1, bytes);
    client_frame(c, OP_BINARY, false, bytes, FRAME_SIZE - 1);
    client_frame(c, OP_CONTINUE, true, bytes, 0);
}
static void long_payload(struct test_client *c)
{
    uint8_t bytes[FRAME_SIZE + 1] = { 0 };
    frame_make(1, bytes);
    client_frame(c, OP_BINARY, true, bytes, sizeof(bytes));
}
static void lie(struct test_client *c) /* announces 4 GiB */
{
    uint8_t bytes[FRAME_SIZE];
    frame_make(1, bytes);
    bytes[6] = PROTOCOL_FILE_EXR;
    bytes[9] = 0;
    memset(bytes + 12, 0, 8);
    memset(bytes + 20, 0xff, 4);
    client_frame(c, OP_BINARY, false, bytes, sizeof(bytes));
}
static void huge(struct test_client *c) /* without any header yet: only WebSocket's own length speaks */
{
    const uint8_t head[14] = { 0x82, 0xff, 0, 0, 0, 1, 0, 0, 0, 0, 1, 2, 3, 4 };
    client_write(c, head, sizeof(head));
    client_write(c, "RLE1", 4);
}
static void magic(struct test_client *c)
{
    altered(c, 0, 'X');
}
static void header_length(struct test_client *c)
{
    altered(c, 4, 50);
}
static void encoding(struct test_client *c)
{
    altered(c, 6, 9);
}
static void layout(struct test_client *c)
{
    altered(c, 7, 9);
}
static void channels(struct test_client *c)
{
    altered(c, 9, 2);
}
static void number(struct test_client *c)
{
    altered(c, 31, 1);
}
static void watch(struct test_client *c)
{
    client_say(c, "{\"op\":\"subscribe\",\"format\":\"jpeg\"}");
}
static void control(struct test_client *c)
{
    client_say(c, "{\"op\":\"control\",\"samples\":4}");
}
static void not_utf8(struct test_client *c)
{
    client_say(c, "{\"op\":\"\xff\"}");
}
static void long_text(struct test_client *c)
{
    static char text[PROTOCOL_TEXT_MAX + 2];
    memset(text, ' ', sizeof(text) - 1);
    client_say(c, text);
}
static void fragments(struct test_client *c)
{
    client_frame(c, OP_BINARY, false, "", 0);
    for (int i = 0; i < 66000; i++)
        client_frame(c, OP_CONTINUE, false, "", 0);
}

static const struct offence offences[] = {
    { cut, 4002, "bad_field", "7.1" },
    { magic, 4002, "bad_field", "7.1" },
    { header_length, 4002, "bad_field", "7.2" },
    { short_payload, 4002, "bad_field", "7.3" },
    { long_payload, 4002, "bad_field", "7.3" },
    { encoding, 4002, "bad_field", "7.4" },
    { layout, 4002, "bad_field", "7.4" },
    { channels, 4002, "bad_field", "7.5" },
    { number, 4002, "bad_field", "7.6" },
    { lie, 1009, "too_big", "7.7" },
    { huge, 1009, "too_big", "7.7" },
    { fragments, 1009, "too_big", "7.8" },
    { watch, 4004, "wrong_role", "4.1.1" },
    { control, 4004, "wrong_role", "4.13" },
    { not_utf8, 1007, "bad_utf8", "3.1" },
    { long_text, 1009, "too_big", "3.3" },
};

static void an_offence_costs_its_own_connection_only(void **state)
{
    (void)state;
    struct server *s = push_server();
    struct test_client viewer;
    struct protocol_picture h;
    struct server_counters before, after;

    client_watch(&viewer, s);
    for (size_t i = 0; i < sizeof(offences) / sizeof(offences[0]); i++) {
        const struct offence *o = &offences[i];
        struct test_client c;
        server_counters(s, &before);
        produce_live(&c, s);
        o->commit(&c);
        json_t *error = client_await(&c, "error");
        if (!error)
            fail_msg("offence %zu (%s): no error came, closed with %d", i, o->clause, c.close_code);
        if (strcmp(json_string_value(json_object_get(error, "clause")), o->clause) != 0)
            fail_msg("offence %zu: clause %s instead of %s", i, json_string_value(json_object_get(error, "clause")),
                     o->clause);
        assert_string_equal(json_string_value(json_object_get(error, "code")), o->code);
        json_decref(error);
        assert_int_equal(client_close_code(&c), o->close_code);
        client_shut(&c);
        server_counters(s, &after);
        assert_int_equal(after.errors, before.errors + 1);
        if (o->clause[0] == '7')
            assert_int_equal(after.frames_cut, before.frames_cut + 1);
        /* and the viewer goes on watching */
        publish(s, i + 1, 2000);
        assert_int_equal(client_picture(&viewer, &h, CLIENT_WAIT_MS), i + 1);
        client_ack(&viewer, h.sequence);
    }
    assert_int_equal(after.frames_received, 0);
    client_shut(&viewer);
    server_destroy(s);
}

static void more_frames_than_credit_are_not_taken(void **state)
{
    (void)state;
    struct server *s = push_server();
    struct test_client c;

    produce_live(&c, s);
    for (uint64_t i = 1; i <= 100; i++) /* credit returns between some of them */
        frame_send(&c, i);
    json_t *error = client_await(&c, "error");
    assert_non_null(error);
    assert_string_equal(json_string_value(json_object_get(error, "code")), "no_credit");
    assert_string_equal(json_string_value(json_object_get(error, "clause")), "5.7");
    json_decref(error);
    assert_int_equal(client_close_code(&c), 4014);
    client_shut(&c);
    server_destroy(s);
}

static void only_producers_push_and_only_where_they_may(void **state)
{
    (void)state;
    struct server *s = push_server(), *closed = server_start(NULL);
    struct test_client c;

    client_greet(&c, s);
    frame_send(&c, 1);
    client_expect(&c, "error");
    assert_int_equal(client_close_code(&c), 4004);
    client_shut(&c);
    client_open(&c, closed);
    assert_int_equal(client_handshake(&c, NULL), 101);
    client_say(&c, "{\"op\":\"hello\",\"role\":\"producer\",\"version\":{\"major\":1}}");
    assert_int_equal(client_close_code(&c), 4004);
    client_shut(&c);
    client_greet(&c, s);
    client_say(&c, "{\"op\":\"end\"}");
    assert_int_equal(client_close_code(&c), 4004);
    client_shut(&c);
    server_destroy(closed);
    server_destroy(s);
}

static void a_frame_that_must_not_be_decoded_is_refused_and_the_connection_stays(void **state)
{
    (void)state;
    /* An EXR header that names PIZ; a Radiance file that is in truth an EXR; a file of a layout not taken upside down.
     */
    static const uint8_t piz[] = "\x76\x2f\x31\x01\x02\0\0\0compression\0compression\0\x01\0\0\0\x04";
    const struct protocol_environment files[] = {
        { .encoding = PROTOCOL_FILE_EXR, .payload = sizeof(piz), .frame = 1 },
        { .encoding = PROTOCOL_FILE_HDR, .payload = sizeof(piz), .frame = 2 },
        { .encoding = PROTOCOL_FILE_EXR, .payload = 7, .frame = 3 },
        { .encoding = PROTOCOL_FILE_HDR,
          .layout = PROTOCOL_CUBE,
          .flags = PROTOCOL_BOTTOM_FIRST,
          .payload = 2,
          .frame = 4 },
    };
    static const char *const words[] = { "PIZ", "Radiance", "ends", "lat-long" };
    struct server *s = push_server();
    struct frame f = { 0 };
    struct server_ticket t;
    struct test_client c;

    produce_live(&c, s);
    for (size_t i = 0; i < 4; i++) {
        payload_send(&c, files[i], i == 3 ? (const uint8_t *)"#?" : piz);
        json_t *m = client_await(&c, "frame");
        assert_non_null(m);
        assert_int_equal(json_integer_value(json_object_get(m, "number")), i + 1);
        assert_string_equal(json_string_value(json_object_get(m, "fate")), "refused");
        assert_string_equal(json_string_value(json_object_get(m, "code")), "bad_frame");
        assert_string_equal(json_string_value(json_object_get(m, "clause")), "7.10");
        assert_non_null(strstr(json_string_value(json_object_get(m, "message")), words[i]));
        json_decref(m);
        assert_int_equal(credit_comes(&c), 1);
    }
    assert_false(server_take_frame(s, &f, &t, true, 20));
    frame_send(&c, 5);
    take(s, &f, &t, 5);
    server_frame_fate(s, &t, SERVER_REFUSED, "100 % of its sun is square");
    json_t *m = client_await(&c, "frame");
    assert_non_null(m);
    assert_string_equal(json_string_value(json_object_get(m, "message")), "100 % of its sun is square");
    json_decref(m);
    COUNTER_BECOMES(s, frames_refused, 5);
    client_shut(&c);
    frame_finish(&f);
    server_destroy(s);
}

static void a_second_producer_waits_until_the_first_is_gone(void **state)
{
    (void)state;
    struct server *s = push_server();
    struct server_demand demand;
    struct test_client first, second;

    produce_live(&first, s);
    server_demand(s, &demand);
    assert_true(demand.producer);
    client_open(&second, s);
    assert_int_equal(client_handshake(&second, NULL), 101);
    client_say(&second, "{\"op\":\"hello\",\"role\":\"producer\",\"version\":{\"major\":1}}");
    assert_int_equal(client_close_code(&second), 4012);
    client_shut(&second);
    client_shut(&first); /* vanishes */
    COUNTER_BECOMES(s, open, 0);
    server_demand(s, &demand);
    assert_false(demand.producer);
    produce_live(&second, s);
    client_shut(&second);
    server_destroy(s);
}

static void a_producer_that_sends_pings_keeps_its_place(void **state)
{
    (void)state;
    struct server *s = push_server();
    struct test_client first, second;

    produce_live(&first, s);
    for (int i = 0; i < 11; i++) {
        sleep_ms(500);
        client_say(&first, "{\"op\":\"ping\",\"id\":1}");
        client_expect(&first, "pong");
    }
    client_open(&second, s);
    assert_int_equal(client_handshake(&second, NULL), 101);
    client_say(&second, "{\"op\":\"hello\",\"role\":\"producer\",\"version\":{\"major\":1}}");
    assert_int_equal(client_close_code(&second), 4012);
    client_shut(&first);
    client_shut(&second);
    server_destroy(s);
}

static void a_silent_producer_gives_way(void **state)
{
    (void)state;
    struct server *s = push_server();
    struct test_client first, second;

    produce_live(&first, s);
    for (int i = 0; i < 26; i++) { /* pings of WebSocket do not count (4.1.7) */
        sleep_ms(200);
        client_frame(&first, OP_PING, true, "x", 1);
    }
    produce_live(&second, s);
    assert_int_equal(client_close_code(&first), 4011);
    frame_send(&second, 1);
    COUNTER_BECOMES(s, frames_received, 1);
    client_shut(&first);
    client_shut(&second);
    server_destroy(s);
}

static void a_producer_that_vanishes_in_the_middle_leaves_nothing_behind(void **state)
{
    (void)state;
    const struct server_desc desc = { .push = true };
    struct server *s = server_start(&desc);
    struct frame f = { 0 };
    struct server_ticket t;
    struct test_client c;
    uint8_t head[PROTOCOL_ENVIRONMENT_BYTES];
    static uint8_t some[100000];
    const struct protocol_environment e = { .encoding = PROTOCOL_FILE_EXR, .payload = 200000000, .frame = 1 };
    long before = 0;

    protocol_environment_encode(&e, head);
    for (int i = 1; i <= 60; i++) {
        produce_live(&c, s);
        client_frame(&c, OP_BINARY, false, head, sizeof(head));
        client_frame(&c, OP_CONTINUE, false, some, sizeof(some));
        client_shut(&c);
        COUNTER_BECOMES(s, frames_cut, i);
        COUNTER_BECOMES(s, open, 0);
        if (i == 5)
            before = resident_kib();
    }
    assert_true(resident_kib() - before < 4096);
    assert_false(server_take_frame(s, &f, &t, true, 20));
    produce_live(&c, s);
    frame_send(&c, 2);
    take(s, &f, &t, 2);
    client_shut(&c);
    frame_finish(&f);
    server_destroy(s);
}

static void a_frame_that_never_completes_costs_its_connection(void **state)
{
    (void)state;
    const struct server_desc desc = { .push = true, .frame_ms = 300 };
    struct server *s = server_start(&desc);
    uint8_t bytes[FRAME_SIZE];
    struct test_client c;

    produce_live(&c, s);
    frame_make(1, bytes);
    client_frame(&c, OP_BINARY, false, bytes, FRAME_SIZE - 1);
    json_t *error = client_await(&c, "error");
    assert_non_null(error);
    assert_string_equal(json_string_value(json_object_get(error, "code")), "too_slow");
    assert_string_equal(json_string_value(json_object_get(error, "clause")), "7.9");
    json_decref(error);
    assert_int_equal(client_close_code(&c), 4013);
    COUNTER_BECOMES(s, frames_cut, 1);
    client_shut(&c);
    server_destroy(s);
}

static void the_end_is_told_until_frames_come_again(void **state)
{
    (void)state;
    struct server *s = push_server();
    struct server_demand demand = { 0 };
    struct frame f = { 0 };
    struct server_ticket t;
    struct test_client c;

    produce_live(&c, s);
    client_say(&c, "{\"op\":\"end\"}");
    for (int i = 0; i < CLIENT_WAIT_MS / 10 && !demand.ended; i++) {
        sleep_ms(10);
        server_demand(s, &demand);
    }
    assert_true(demand.ended);
    frame_send(&c, 1);
    take(s, &f, &t, 1);
    server_demand(s, &demand);
    assert_false(demand.ended);
    client_shut(&c);
    frame_finish(&f);
    server_destroy(s);
}

static void every_role_has_its_own_token(void **state)
{
    (void)state;
    static const char *const roles[] = { "viewer", "controller", "producer" };
    static const char *const tokens[] = { "one", "two", "three", "thre", "threee", "" };
    const struct server_desc desc = { .push = true, .tokens = { "one", "two", "three" } };

    for (int role = 0; role < 3; role++) {
        struct server *s = server_start(&desc); /* each its own: ten wrong tokens would be too many */
        for (size_t token = 0; token < sizeof(tokens) / sizeof(tokens[0]); token++) {
            char text[200];
            struct test_client c;
            client_open(&c, s);
            assert_int_equal(client_handshake(&c, NULL), 101);
            snprintf(text, sizeof(text),
                     "{\"op\":\"hello\",\"role\":\"%s\",\"version\":{\"major\":1},\"token\":\"%s\"}", roles[role],
                     tokens[token]);
            client_say(&c, text);
            if ((int)token == role)
                client_expect(&c, "welcome");
            else
                assert_int_equal(client_close_code(&c), 4006);
            client_shut(&c);
        }
        COUNTER_BECOMES(s, open, 0);
        server_destroy(s);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_raw_frame_arrives_bit_for_bit_and_its_fate_is_told),
    cmocka_unit_test(halves_alpha_and_rows_from_the_bottom_are_put_right),
    cmocka_unit_test(the_newest_frame_wins_and_the_other_is_told),
    cmocka_unit_test(a_frame_may_come_in_pieces_of_any_size),
    cmocka_unit_test(an_offence_costs_its_own_connection_only),
    cmocka_unit_test(more_frames_than_credit_are_not_taken),
    cmocka_unit_test(only_producers_push_and_only_where_they_may),
    cmocka_unit_test(a_frame_that_must_not_be_decoded_is_refused_and_the_connection_stays),
    cmocka_unit_test(a_second_producer_waits_until_the_first_is_gone),
    cmocka_unit_test(a_producer_that_sends_pings_keeps_its_place),
    cmocka_unit_test(a_silent_producer_gives_way),
    cmocka_unit_test(a_producer_that_vanishes_in_the_middle_leaves_nothing_behind),
    cmocka_unit_test(a_frame_that_never_completes_costs_its_connection),
    cmocka_unit_test(the_end_is_told_until_frames_come_again),
    cmocka_unit_test(every_role_has_its_own_token),
};
UNIT_MAIN(tests)
