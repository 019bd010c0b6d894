/* The text messages: PROTOCOL.md sections 3 and 4, each fault by its clause. */
#include "support/unit.h"

#include "net/message/message.h"

struct row {
    const char *text;
    enum fault_code code;
    const char *clause;
};

static const struct row rows[] = {
    { "", FAULT_BAD_JSON, "3.1" },
    { "{", FAULT_BAD_JSON, "3.1" },
    { "[]", FAULT_BAD_JSON, "3.1" },
    { "17", FAULT_BAD_JSON, "3.1" },
    { "{\"op\":\"ping\",\"id\":1}x", FAULT_BAD_JSON, "3.1" },
    { "{\"op\":\"ping\",\"id\":1,\"id\":2}", FAULT_BAD_JSON, "3.1" },
    { "{\"op\":\"ping\",\"id\":1e999}", FAULT_BAD_JSON, "3.1" },
    { "{\"op\":\"\\ud800\"}", FAULT_BAD_JSON, "3.1" },
    { "{\"op\":\"\xff\"}", FAULT_BAD_UTF8, "3.1" },
    { "{\"op\":\"pi\\u0000ng\"}", FAULT_BAD_JSON, "3.1" },
    { "{}", FAULT_BAD_FIELD, "3.2" },
    { "{\"op\":1}", FAULT_BAD_FIELD, "3.2" },
    { "{\"op\":\"dance\"}", FAULT_UNKNOWN_OP, "3.4" },
    { "{\"op\":\"hello\",\"version\":{\"major\":1}}", FAULT_BAD_FIELD, "4.1.1" },
    { "{\"op\":\"hello\",\"role\":\"king\",\"version\":{\"major\":1}}", FAULT_BAD_FIELD, "4.1.1" },
    { "{\"op\":\"hello\",\"role\":7,\"version\":{\"major\":1}}", FAULT_BAD_FIELD, "4.1.1" },
    { "{\"op\":\"hello\",\"role\":\"viewer\"}", FAULT_BAD_FIELD, "4.1.2" },
    { "{\"op\":\"hello\",\"role\":\"viewer\",\"version\":1}", FAULT_BAD_FIELD, "4.1.2" },
    { "{\"op\":\"hello\",\"role\":\"viewer\",\"version\":{\"minor\":1}}", FAULT_BAD_FIELD, "4.1.2" },
    { "{\"op\":\"hello\",\"role\":\"viewer\",\"version\":{\"major\":1.5}}", FAULT_BAD_FIELD, "4.1.2" },
    { "{\"op\":\"hello\",\"role\":\"viewer\",\"version\":{\"major\":-1}}", FAULT_BAD_FIELD, "4.1.2" },
    { "{\"op\":\"hello\",\"role\":\"viewer\",\"version\":{\"major\":1},\"token\":5}", FAULT_BAD_FIELD, "4.1.3" },
    { "{\"op\":\"subscribe\"}", FAULT_BAD_FIELD, "4.3.1" },
    { "{\"op\":\"subscribe\",\"format\":\"gif\"}", FAULT_BAD_FIELD, "4.3.1" },
    { "{\"op\":\"subscribe\",\"format\":\"jpeg\",\"quality\":0}", FAULT_BAD_FIELD, "4.3.2" },
    { "{\"op\":\"subscribe\",\"format\":\"jpeg\",\"quality\":101}", FAULT_BAD_FIELD, "4.3.2" },
    { "{\"op\":\"subscribe\",\"format\":\"jpeg\",\"quality\":\"90\"}", FAULT_BAD_FIELD, "4.3.2" },
    { "{\"op\":\"subscribe\",\"format\":\"jpeg\",\"max_rate\":0}", FAULT_BAD_FIELD, "4.3.3" },
    { "{\"op\":\"subscribe\",\"format\":\"jpeg\",\"max_rate\":-1.5}", FAULT_BAD_FIELD, "4.3.3" },
    { "{\"op\":\"subscribe\",\"format\":\"jpeg\",\"max_rate\":1001}", FAULT_BAD_FIELD, "4.3.3" },
    { "{\"op\":\"subscribe\",\"format\":\"jpeg\",\"max_rate\":null}", FAULT_BAD_FIELD, "4.3.3" },
    { "{\"op\":\"subscribe\",\"format\":\"jpeg\",\"paused\":1}", FAULT_BAD_FIELD, "4.3.4" },
    { "{\"op\":\"subscribe\",\"format\":\"jpeg\",\"request\":-1}", FAULT_BAD_FIELD, "4.3.5" },
    { "{\"op\":\"ack\"}", FAULT_BAD_FIELD, "4.5.1" },
    { "{\"op\":\"ack\",\"sequence\":0}", FAULT_BAD_FIELD, "4.5.1" },
    { "{\"op\":\"ack\",\"sequence\":9007199254740992}", FAULT_BAD_FIELD, "4.5.1" },
    { "{\"op\":\"ack\",\"sequence\":1,\"displayed_us\":1.5}", FAULT_BAD_FIELD, "4.5.2" },
    { "{\"op\":\"ping\"}", FAULT_BAD_FIELD, "4.6.1" },
    { "{\"op\":\"ping\",\"id\":-1}", FAULT_BAD_FIELD, "4.6.1" },
    { "{\"op\":\"ping\",\"id\":1.0}", FAULT_BAD_FIELD, "4.6.1" }, /* clause 1.5 */
    { "{\"op\":\"ping\",\"id\":1e0}", FAULT_BAD_FIELD, "4.6.1" },
    { "{\"op\":\"probe\"}", FAULT_BAD_FIELD, "4.15.2" },
    { "{\"op\":\"probe\",\"x\":16384,\"y\":0}", FAULT_BAD_FIELD, "4.15.2" },
    { "{\"op\":\"probe\",\"x\":0,\"y\":0,\"samples\":257}", FAULT_BAD_FIELD, "4.15.3" },
    { "{\"op\":\"probe\",\"x\":16383,\"y\":0,\"samples\":256,\"preset\":null}", FAULT_NONE, "" },
    { "{\"op\":\"probe\",\"follow\":false}", FAULT_NONE, "" },
    { "{\"op\":\"probe\",\"sky\":true}", FAULT_NONE, "" },
    { "{\"op\":\"probe\",\"sky\":false}", FAULT_BAD_FIELD, "4.15.2" },
    { "{\"op\":\"probe\",\"sky\":true,\"follow\":true}", FAULT_BAD_FIELD, "4.15.2" },
    { "{\"op\":\"probe\",\"sky\":true,\"x\":1}", FAULT_BAD_FIELD, "4.15.2" },
    { "{\"op\":\"hello\",\"role\":\"viewer\",\"version\":{\"major\":1}}", FAULT_NONE, "" },
    { "{\"op\":\"ping\",\"id\":0,\"colour\":\"green\"}", FAULT_NONE, "" },
    { "{\"op\":\"ack\",\"sequence\":9007199254740991}", FAULT_NONE, "" },
};

static void parse_names_the_clause_that_was_broken(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        struct message m;
        struct fault fault;
        const enum fault_code code = message_parse(rows[i].text, strlen(rows[i].text), NULL, &m, &fault);
        if (code != rows[i].code || fault.code != code || strcmp(fault.clause, rows[i].clause) != 0)
            fail_msg("%s: %s (%s) instead of %s (%s)", rows[i].text, fault_name(code), fault.clause,
                     fault_name(rows[i].code), rows[i].clause);
        assert_true(code == FAULT_NONE || fault.text[0] != 0);
    }
}

static void parse_refuses_what_is_cut_at_any_byte(void **state)
{
    (void)state;
    static const char text[] =
        "{\"op\":\"subscribe\",\"request\":7,\"format\":\"jpeg\",\"quality\":90,\"max_rate\":12.5,"
        "\"paused\":true}";
    struct message m;
    struct fault fault;

    for (size_t length = 0; length < strlen(text); length++) {
        char *exact = malloc(length ? length : 1);
        memcpy(exact, text, length);
        assert_int_equal(message_parse(exact, length, NULL, &m, &fault), FAULT_BAD_JSON);
        free(exact);
    }
    assert_int_equal(message_parse(text, strlen(text), NULL, &m, &fault), FAULT_NONE);
    assert_int_equal(m.op, MESSAGE_SUBSCRIBE);
    assert_int_equal(m.subscribe.request, 7);
    assert_int_equal(m.subscribe.format, PROTOCOL_JPEG);
    assert_int_equal(m.subscribe.quality, 90);
    assert_true(m.subscribe.max_rate == 12.5);
    assert_true(m.subscribe.paused);
}

static void parse_survives_deep_nesting(void **state)
{
    (void)state;
    char text[PROTOCOL_TEXT_MAX];
    struct message m;
    struct fault fault;

    memset(text, '[', sizeof(text));
    assert_int_equal(message_parse(text, sizeof(text), NULL, &m, &fault), FAULT_BAD_JSON);
    for (size_t i = 0; i + 5 <= sizeof(text); i += 5)
        memcpy(text + i, "{\"a\":", 5);
    assert_int_equal(message_parse(text, sizeof(text), NULL, &m, &fault), FAULT_BAD_JSON);
}

static void parse_refuses_a_token_too_long(void **state)
{
    (void)state;
    char text[600];
    struct message m;
    struct fault fault;

    for (int length = 255; length <= 256; length++) {
        snprintf(text, sizeof(text),
                 "{\"op\":\"hello\",\"role\":\"viewer\",\"version\":{\"major\":1},\"token\":\"%0*d\"}", length, 7);
        assert_int_equal(message_parse(text, strlen(text), NULL, &m, &fault),
                         length == 255 ? FAULT_NONE : FAULT_BAD_FIELD);
    }
}

static void status_survives_words_that_are_not_utf8(void **state)
{
    (void)state;
    const struct server_figures status = { .scene = "a \xff scene", .last_refusal = "\xc3", .fps = 1.0 / 0.0 };
    char *shared = message_status_shared(&status, NULL);

    assert_non_null(shared);
    assert_non_null(strstr(shared, "(not UTF-8)"));
    assert_non_null(strstr(shared, "\"fps\":0.0"));
    char *text = message_status(shared, 5, 1, 2, 3);
    assert_non_null(text);
    assert_non_null(strstr(text, "\"sent\":2,\"skipped\":3,\"scene\""));
    message_free(text);
    message_free(shared);
}

static void close_reasons_fit_a_close_frame(void **state)
{
    (void)state;
    struct fault fault;
    char text[400];

    memset(text, 'x', sizeof(text) - 1);
    text[sizeof(text) - 1] = 0;
    fault_say(&fault, FAULT_BAD_FIELD, "4.3.2", "%s", text);
    char reason[FAULT_REASON];
    assert_true(strlen(fault_reason(&fault, reason)) <= 123); /* 125 less the code [RFC 6455, 5.5] */
    assert_non_null(strstr(reason, "clause 4.3.2: xxx"));
    memset(text, 0xc3, sizeof(text) - 1);
    fault_say(&fault, FAULT_BAD_FIELD, "4.3.2", "%s", text);
    assert_non_null(strstr(fault_reason(&fault, reason), "clause 4.3.2: ???"));
}

/* The table of PROTOCOL.md section 8, by hand. */
static void close_codes_are_those_of_the_protocol(void **state)
{
    static const struct {
        enum fault_code code;
        const char *name;
        uint16_t close;
    } want[] = {
        { FAULT_BAD_UTF8, "bad_utf8", 1007 },
        { FAULT_TOO_BIG, "too_big", 1009 },
        { FAULT_BAD_JSON, "bad_json", 4001 },
        { FAULT_BAD_FIELD, "bad_field", 4002 },
        { FAULT_BAD_ORDER, "bad_order", 4003 },
        { FAULT_WRONG_ROLE, "wrong_role", 4004 },
        { FAULT_BAD_VERSION, "bad_version", 4005 },
        { FAULT_BAD_TOKEN, "bad_token", 4006 },
        { FAULT_FULL, "full", 4007 },
        { FAULT_NO_HELLO, "no_hello", 4008 },
        { FAULT_STALLED, "stalled", 4009 },
        { FAULT_TOO_FAST, "too_fast", 4010 },
        { FAULT_SUPERSEDED, "superseded", 4011 },
        { FAULT_BUSY, "busy", 4012 },
        { FAULT_TOO_SLOW, "too_slow", 4013 },
        { FAULT_NO_CREDIT, "no_credit", 4014 },
        { FAULT_UNKNOWN_OP, "unknown_op", 0 },
        { FAULT_NOT_OFFERED, "not_offered", 0 },
        { FAULT_BAD_FRAME, "bad_frame", 0 },
    };
    (void)state;
    assert_int_equal(sizeof(want) / sizeof(want[0]), FAULT_CODES - 1); /* all but FAULT_NONE */
    for (size_t i = 0; i < sizeof(want) / sizeof(want[0]); i++) {
        struct fault fault;
        fault_say(&fault, want[i].code, "1", "x");
        assert_string_equal(fault_name(want[i].code), want[i].name);
        assert_int_equal(fault_close_code(&fault), want[i].close);
    }
}

static void welcome_says_what_it_is_told(void **state)
{
    const struct welcome w = { .session = "s",
                               .id = 7,
                               .max_connections = 9,
                               .controllers = true,
                               .producers = true,
                               .producer = true,
                               .has_after = true,
                               .after = 11,
                               .credit = 4,
                               .frame_bytes = 123 };
    static const char *const parts[] = {
        "\"op\":\"welcome\"",
        "\"version\":{\"major\":1,\"minor\":",
        "\"session\":\"s\"",
        "\"id\":\"7\"",
        "\"connections\":9}",
        "\"formats\":[\"jpeg\",\"exr_half\",\"exr_float\",\"changes\"]",
        "\"roles\":[\"viewer\",\"controller\",\"producer\"]",
        "\"producer\":{\"resume_after\":11,\"credit\":4,\"frame_bytes\":123,\"raw\":true}",
    };
    char *text = message_welcome(&w);
    (void)state;
    for (size_t i = 0; i < sizeof(parts) / sizeof(parts[0]); i++)
        if (!strstr(text, parts[i]))
            fail_msg("%s is not in %s", parts[i], text);
    message_free(text);
}

static void status_has_every_place_where_images_are_published(void **state)
{
    const struct server_figures status = { .publish_count = 2,
                                           .publish = { { .to = "rtmp://a/",
                                                          .state = SERVER_PUBLISH_RETRYING,
                                                          .detail = "no route",
                                                          .frames = 3,
                                                          .dropped = 5,
                                                          .retries = 7 },
                                                        { .to = "srt://b/", .frames = 9 } } };
    char *shared = message_status_shared(&status, NULL);
    (void)state;
    assert_non_null(
        strstr(shared, "\"publish\":[{\"to\":\"rtmp://a/\",\"state\":\"retrying\",\"detail\":\"no route\","));
    assert_non_null(strstr(shared, "\"frames\":3,\"dropped\":5,\"retries\":7},{\"to\":\"srt://b/\""));
    assert_non_null(strstr(shared, "\"frames\":9,\"dropped\":0,\"retries\":0}]"));
    message_free(shared);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(parse_names_the_clause_that_was_broken),
    cmocka_unit_test(parse_refuses_what_is_cut_at_any_byte),
    cmocka_unit_test(parse_survives_deep_nesting),
    cmocka_unit_test(parse_refuses_a_token_too_long),
    cmocka_unit_test(status_survives_words_that_are_not_utf8),
    cmocka_unit_test(close_reasons_fit_a_close_frame),
    cmocka_unit_test(close_codes_are_those_of_the_protocol),
    cmocka_unit_test(welcome_says_what_it_is_told),
    cmocka_unit_test(status_has_every_place_where_images_are_published),
};
UNIT_MAIN(tests)
