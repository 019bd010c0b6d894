/* PROTOCOL.md sections 2 and 3: who is let in, and what happens to those who speak wrongly. */
#include "net/stream/client.h"
#include "relightd/settings/settings.h"

static void handshakes_that_break_section_2_are_turned_away(void **state)
{
    (void)state;
    static const struct handshake bad[] = {
        { .protocol = "" },
        { .protocol = "relight.v2" },
        { .protocol = "http" },
        { .path = "/" },
        { .path = "/ws/" },
        { .path = "/ws/../w" },
        { .path = "/?path=/ws" },
        { .version = "7" },
        { .version = "" },
        { .host = "evil.example" },
        { .origin = "http://evil.example" },
        { .origin = "null" },
        { .origin = "http://127.0.0.1.evil.example" },
        { .origin = "http://127.0.0.1:1" },
        { .host = "evil.example", .origin = "http://evil.example" },
    };
    struct server *s = server_start(NULL);
    struct server_counters counters;

    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        struct test_client c;
        client_open(&c, s);
        const int status = client_handshake(&c, &bad[i]);
        if (status == 101)
            fail_msg("handshake %zu was accepted", i);
        client_rest(&c); /* and the connection ends */
        client_shut(&c);
    }
    server_counters(s, &counters);
    assert_int_equal(counters.connections, 0);
    assert_true(counters.refused >= 10);
    server_destroy(s);
}

static void handshakes_that_obey_are_let_in(void **state)
{
    (void)state;
    static const struct handshake good[] = {
        { 0 },
        { .host = "localhost:9000", .origin = "http://localhost:9000" },
        { .host = "[::1]:80", .origin = "http://[::1]:80" },
        { .host = "LOCALHOST", .origin = "https://localhost" },
        { .protocol = "other.v9, relight.v1" },
        { .path = "/ws?token=x" },
        { .path = "/%77s" },
        { .path = "/x/../ws" },
        { .extra = "Sec-WebSocket-Extensions: permessage-deflate; client_max_window_bits\r\n" },
    };
    struct server *s = server_start(NULL);

    for (size_t i = 0; i < sizeof(good) / sizeof(good[0]); i++) {
        struct test_client c;
        client_open(&c, s);
        if (client_handshake(&c, &good[i]) != 101)
            fail_msg("handshake %zu was refused", i);
        for (char *p = (char *)c.message; *p; p++)
            *p = (char)tolower((unsigned char)*p);
        assert_non_null(strstr((char *)c.message, "sec-websocket-protocol: relight.v1\r\n"));
        assert_null(strstr((char *)c.message, "permessage-deflate"));
        client_shut(&c);
    }
    server_destroy(s);
}

static void hello_is_answered_by_welcome_and_status(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client c;

    client_open(&c, s);
    assert_int_equal(client_handshake(&c, NULL), 101);
    client_say(&c, "{\"op\":\"hello\",\"role\":\"viewer\",\"version\":{\"major\":1,\"minor\":7},\"later\":[1,2]}");
    json_t *welcome = client_await(&c, "welcome");
    assert_non_null(welcome);
    assert_int_equal(json_integer_value(json_object_get(json_object_get(welcome, "version"), "major")), 1);
    assert_int_equal(strlen(json_string_value(json_object_get(welcome, "session"))), 16);
    assert_string_equal(json_string_value(json_array_get(json_object_get(welcome, "formats"), 0)), "jpeg");
    json_decref(welcome);
    assert_int_equal(client_next(&c, CLIENT_WAIT_MS), OP_TEXT);
    assert_non_null(strstr((char *)c.message, "\"op\":\"status\""));
    assert_non_null(strstr((char *)c.message, "\"waiting\""));
    client_shut(&c);
    server_destroy(s);
}

struct offence {
    const char *text; /* NULL: four bytes of binary */
    bool greeted;
    int close_code;
    const char *clause;
};

static void offences_are_answered_with_their_clause_and_close_code(void **state)
{
    (void)state;
    static const struct offence offences[] = {
        { "{\"op\":\"ping\",\"id\":1}", false, 4003, "4.1" },
        { "{\"op\":\"subscribe\",\"format\":\"jpeg\"}", false, 4003, "4.1" },
        { "{\"op\":\"dance\"}", false, 4003, "4.1" },
        { "{\"op\":\"ping\",\"id\":\"x\"}", false, 4003, "4.1" },
        { "{\"op\":\"control\",\"samples\":0}", false, 4003, "4.1" },
        { "{\"op\":7}", false, 4002, "3.2" },
        { "{\"op\":\"hello\",\"role\":\"viewer\",\"version\":{\"major\":2}}", false, 4005, "4.1.2" },
        { "{\"op\":\"hello\",\"role\":\"producer\",\"version\":{\"major\":1}}", false, 4004, "4.1.1" },
        { "{\"op\":\"hello\",\"role\":\"controller\",\"version\":{\"major\":1},\"recorder\":\"r\"}", false, 4004,
          "4.1.6" },
        { "{\"op\":\"hello\",\"role\":\"viewer\"}", false, 4002, "4.1.2" },
        { "nonsense", false, 4001, "3.1" },
        { NULL, false, 4004, "3.5" },
        { "{\"op\":\"hello\",\"role\":\"viewer\",\"version\":{\"major\":1}}", true, 4003, "4.1" },
        { "{\"op\":\"ack\",\"sequence\":1}", true, 4003, "4.5.1" },
        { "{\"op\":\"control\",\"samples\":0}", true, 4004, "4.13" }, /* the role counts before the fields */
        { "{\"op\":\"hello\"}", true, 4003, "4.1" },
        { "{\"op\":\"ack\",\"sequence\":\"1\"}", true, 4002, "4.5.1" },
        { "{\"op\":\"subscribe\",\"format\":\"jpeg\",\"quality\":1000}", true, 4002, "4.3.2" },
        { "[", true, 4001, "3.1" },
        { NULL, true, 4004, "3.5" },
    };
    struct server *s = server_start(NULL);

    for (size_t i = 0; i < sizeof(offences) / sizeof(offences[0]); i++) {
        const struct offence *o = &offences[i];
        struct test_client c;
        if (o->greeted) {
            client_greet(&c, s);
        } else {
            client_open(&c, s);
            assert_int_equal(client_handshake(&c, NULL), 101);
        }
        if (o->text)
            client_say(&c, o->text);
        else
            client_frame(&c, OP_BINARY, true, "RLE1", 4);
        json_t *error = client_await(&c, "error");
        if (!error)
            fail_msg("offence %zu: no error came", i);
        assert_string_equal(json_string_value(json_object_get(error, "clause")), o->clause);
        assert_true(json_is_true(json_object_get(error, "fatal")));
        json_decref(error);
        assert_int_equal(client_close_code(&c), o->close_code);
        assert_non_null(strstr(c.reason, o->clause));
        client_shut(&c);
    }
    server_destroy(s);
}

static void the_rest_is_let_pass(void **state)
{
    (void)state;
    const struct server_desc desc = { .controls = settings_table };
    struct server *s = server_start(&desc);
    struct test_client c;

    client_open(&c, s);
    assert_int_equal(client_handshake(&c, NULL), 101);
    client_say(&c, "{\"op\":\"hello\",\"role\":\"controller\",\"version\":{\"major\":1}}");
    client_say(&c, "{\"op\":\"dance\"}");
    json_t *error = client_await(&c, "error");
    assert_non_null(error);
    assert_string_equal(json_string_value(json_object_get(error, "code")), "unknown_op");
    assert_true(json_is_false(json_object_get(error, "fatal")));
    json_decref(error);
    client_say(&c, "{\"op\":\"control\",\"samples\":0}"); /* a slip of the hand */
    error = client_await(&c, "error");
    assert_non_null(error);
    assert_string_equal(json_string_value(json_object_get(error, "clause")), "4.13.5");
    assert_true(json_is_false(json_object_get(error, "fatal")));
    assert_true(json_is_integer(json_object_get(error, "request"))); /* 0, although the message had none */
    json_decref(error);
    client_say(&c, "{\"op\":\"ping\",\"id\":77,\"new\":{}}");
    json_t *pong = client_await(&c, "pong");
    assert_non_null(pong);
    assert_int_equal(json_integer_value(json_object_get(pong, "id")), 77);
    assert_true(json_integer_value(json_object_get(pong, "server_us")) > 1500000000000000);
    json_decref(pong);
    client_shut(&c);
    server_destroy(s);
}

static void a_message_may_come_in_pieces_up_to_its_limit(void **state)
{
    (void)state;
    char text[PROTOCOL_TEXT_MAX + 2];
    struct server *s = server_start(NULL);
    struct test_client c;

    client_greet(&c, s);
    client_frame(&c, OP_TEXT, false, "{\"op\":", 6);
    client_frame(&c, OP_CONTINUE, false, "", 0);
    client_frame(&c, OP_PING, true, "hm", 2); /* a control frame may stand between */
    client_frame(&c, OP_CONTINUE, false, "\"ping\"", 6);
    client_frame(&c, OP_CONTINUE, true, ",\"id\":5}", 8);
    client_expect(&c, "pong");
    memset(text, ' ', sizeof(text));
    memcpy(text, "{\"op\":\"ping\",\"id\":6}", 20);
    client_frame(&c, OP_TEXT, true, text, PROTOCOL_TEXT_MAX);
    client_expect(&c, "pong");
    client_frame(&c, OP_TEXT, true, text, PROTOCOL_TEXT_MAX + 1);
    assert_int_equal(client_close_code(&c), 1009);
    client_shut(&c);
    server_destroy(s);
}

static void a_size_that_lies_is_refused_before_it_arrives(void **state)
{
    (void)state;
    static const uint8_t huge[] = { 0x81, 0xff, 0, 0, 0, 0, 0xff, 0xff, 0xff, 0xff, 1, 2, 3, 4, 'x' };
    struct server *s = server_start(NULL);
    struct test_client c;

    client_greet(&c, s);
    client_write(&c, huge, sizeof(huge));
    assert_int_equal(client_close_code(&c), 1009);
    client_shut(&c);
    server_destroy(s);
}

static void endless_empty_pieces_are_refused(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client c;

    client_greet(&c, s);
    client_frame(&c, OP_TEXT, false, "{", 1);
    for (int i = 0; i < 6000; i++)
        client_frame(&c, OP_CONTINUE, false, " ", 1);
    assert_int_equal(client_close_code(&c), 1009);
    client_shut(&c);
    server_destroy(s);
}

static void malformed_frames_cost_only_their_connection(void **state)
{
    (void)state;
    static const struct {
        uint8_t bytes[20];
        size_t size;
    } frames[] = {
        { { 0xf1, 0x80, 0, 0, 0, 0 }, 6 },                             /* reserved bits */
        { { 0x83, 0x80, 0, 0, 0, 0 }, 6 },                             /* reserved opcode */
        { { 0x80, 0x80, 0, 0, 0, 0 }, 6 },                             /* continues nothing */
        { { 0x09, 0x80, 0, 0, 0, 0 }, 6 },                             /* a ping in pieces */
        { { 0x89, 0xfe, 0x01, 0x00, 0, 0, 0, 0 }, 8 },                 /* a ping of 256 bytes */
        { { 0x81, 0xff, 0x80, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0 }, 14 }, /* a length of 2^63 */
        { { 0x81, 0x82, 0, 0, 0, 0, 0xc3, 0x28 }, 8 },                 /* not UTF-8 */
        { { 0x81, 0x85, 0, 0, 0 }, 5 },                                /* ends in the mask */
    };
    struct server *s = server_start(NULL);
    struct test_client other;

    client_greet(&other, s);
    for (size_t i = 0; i < sizeof(frames) / sizeof(frames[0]); i++) {
        struct test_client c;
        client_greet(&c, s);
        client_write(&c, frames[i].bytes, frames[i].size);
        shutdown(c.fd, SHUT_WR);
        client_close_code(&c);
        client_shut(&c);
    }
    client_say(&other, "{\"op\":\"ping\",\"id\":1}");
    client_expect(&other, "pong");
    client_shut(&other);
    server_destroy(s);
}

static void text_that_is_not_utf8_is_closed_by_1007(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client c;

    client_greet(&c, s);
    client_frame(&c, OP_TEXT, true, "\xc3\x28", 2);
    assert_int_equal(client_close_code(&c), 1007);
    client_shut(&c);
    server_destroy(s);
}

static void floods_are_cut_off(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client c;

    client_greet(&c, s);
    for (int i = 0; i < 2000; i++)
        client_say(&c, "{\"op\":\"ping\",\"id\":1}");
    assert_int_equal(client_close_code(&c), 4010);
    client_shut(&c);
    server_destroy(s);
}

static void one_connection_too_many_is_told_so(void **state)
{
    (void)state;
    const struct server_desc desc = { .max_connections = 2 };
    struct server *s = server_start(&desc);
    struct test_client first, second, third;

    client_greet(&first, s);
    client_greet(&second, s);
    client_open(&third, s);
    assert_int_equal(client_handshake(&third, NULL), 101);
    assert_int_equal(client_close_code(&third), 4007);
    client_shut(&third);
    /* a place that becomes free can be taken */
    client_shut(&first);
    for (int i = 0; i < CLIENT_WAIT_MS / 20; i++) {
        client_open(&third, s);
        assert_int_equal(client_handshake(&third, NULL), 101);
        client_say(&third, "{\"op\":\"hello\",\"role\":\"viewer\",\"version\":{\"major\":1}}");
        json_t *welcome = client_await(&third, "welcome");
        client_shut(&third);
        json_decref(welcome);
        if (welcome)
            break;
        assert_true(i + 1 < CLIENT_WAIT_MS / 20);
        sleep_ms(20);
    }
    client_shut(&second);
    server_destroy(s);
}

static void silence_after_the_handshake_ends_in_no_hello(void **state)
{
    (void)state;
    struct server *s = server_start(NULL);
    struct test_client c;

    client_open(&c, s);
    assert_int_equal(client_handshake(&c, NULL), 101);
    assert_int_equal(client_close_code(&c), 4008);
    client_shut(&c);
    server_destroy(s);
}

static void a_token_is_asked_for_where_one_is_set(void **state)
{
    (void)state;
    const struct server_desc desc = { .tokens = { [SERVER_VIEWER] = "open sesame" } };
    static const char *const wrong[] = { "", ",\"token\":\"\"", ",\"token\":\"open sesam\"",
                                         ",\"token\":\"open sesame!\"", ",\"token\":\"open sesamE\"" };
    struct server *s = server_start(&desc);
    struct test_client c;
    char text[200];

    for (size_t i = 0; i <= sizeof(wrong) / sizeof(wrong[0]); i++) {
        const bool right = i == sizeof(wrong) / sizeof(wrong[0]);
        client_open(&c, s);
        assert_int_equal(client_handshake(&c, NULL), 101);
        snprintf(text, sizeof(text), "{\"op\":\"hello\",\"role\":\"viewer\",\"version\":{\"major\":1}%s}",
                 right ? ",\"token\":\"open sesame\"" : wrong[i]);
        client_say(&c, text);
        if (right)
            client_expect(&c, "welcome");
        else
            assert_int_equal(client_close_code(&c), 4006);
        client_shut(&c);
    }
    server_destroy(s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(handshakes_that_break_section_2_are_turned_away),
    cmocka_unit_test(handshakes_that_obey_are_let_in),
    cmocka_unit_test(hello_is_answered_by_welcome_and_status),
    cmocka_unit_test(offences_are_answered_with_their_clause_and_close_code),
    cmocka_unit_test(the_rest_is_let_pass),
    cmocka_unit_test(a_message_may_come_in_pieces_up_to_its_limit),
    cmocka_unit_test(a_size_that_lies_is_refused_before_it_arrives),
    cmocka_unit_test(endless_empty_pieces_are_refused),
    cmocka_unit_test(malformed_frames_cost_only_their_connection),
    cmocka_unit_test(text_that_is_not_utf8_is_closed_by_1007),
    cmocka_unit_test(floods_are_cut_off),
    cmocka_unit_test(one_connection_too_many_is_told_so),
    cmocka_unit_test(silence_after_the_handshake_ends_in_no_hello),
    cmocka_unit_test(a_token_is_asked_for_where_one_is_set),
};
UNIT_MAIN(tests)
