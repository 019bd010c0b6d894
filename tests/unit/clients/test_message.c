#include "support/unit.h"

#include "clients/common/message.h"

static json_t *read_text(const char *text, const char **op)
{
    return message_read((const uint8_t *)text, strlen(text), op);
}

static void only_objects_with_an_op_are_messages(void **state)
{
    static const char *const bad[] = {
        "", "nonsense", "[]", "5", "{}", "{\"op\":5}", "{\"op\":\"", "{\"op\":\"a\"}{}", "{\"op\":\"a\",\"op\":\"b\"}"
    };
    const char *op;

    (void)state;
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++)
        assert_null(read_text(bad[i], &op));
    json_t *m = read_text("{\"op\":\"credit\",\"frames\":2}", &op);
    assert_non_null(m);
    assert_string_equal(op, "credit");
    json_decref(m);
}

static void numbers_are_whole_and_within_limits(void **state)
{
    const char *op;
    uint64_t n = 77;
    int64_t t = 77;
    json_t *m = read_text("{\"op\":\"x\",\"a\":9007199254740991,\"b\":9007199254740992,\"c\":-1,\"d\":1.5,\"e\":\"5\","
                          "\"f\":-9007199254740991,\"g\":-9007199254740992,\"h\":null}",
                          &op);

    (void)state;
    assert_non_null(m);
    assert_true(message_number(m, "a", &n));
    assert_int_equal(n, 9007199254740991);
    n = 77;
    for (const char *name = "bcdeghz"; *name; name++) {
        const char one[2] = { *name, '\0' };
        assert_false(message_number(m, one, &n));
    }
    assert_int_equal(n, 77);
    assert_true(message_time(m, "c", &t));
    assert_int_equal(t, -1);
    assert_true(message_time(m, "f", &t));
    assert_false(message_time(m, "g", &t));
    assert_false(message_time(m, "b", &t));
    json_decref(m);
}

/* What a server says must not move a terminal's cursor. */
static void texts_are_cut_and_plain(void **state)
{
    const char *op;
    char out[8];
    json_t *m = read_text("{\"op\":\"x\",\"a\":\"\\u001b[2J\\u00e9\",\"b\":\"0123456789\",\"c\":5}", &op);

    (void)state;
    assert_non_null(m);
    assert_string_equal(message_plain(m, "a", out, sizeof(out)), "?[2J??");
    assert_string_equal(message_plain(m, "b", out, sizeof(out)), "0123456");
    assert_string_equal(message_plain(m, "c", out, sizeof(out)), "");
    assert_string_equal(message_plain(m, "d", out, sizeof(out)), "");
    json_decref(m);
}

static void sequence_names_are_as_the_protocol_says(void **state)
{
    char name[66];

    (void)state;
    assert_true(message_is_sequence_name("day-1_B.x"));
    assert_false(message_is_sequence_name(""));
    assert_false(message_is_sequence_name("a b"));
    assert_false(message_is_sequence_name("a/b"));
    assert_false(message_is_sequence_name("\xc3\xa9"));
    memset(name, 'a', sizeof(name));
    name[65] = '\0';
    assert_false(message_is_sequence_name(name));
    name[64] = '\0';
    assert_true(message_is_sequence_name(name));
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(only_objects_with_an_op_are_messages),
    cmocka_unit_test(numbers_are_whole_and_within_limits),
    cmocka_unit_test(texts_are_cut_and_plain),
    cmocka_unit_test(sequence_names_are_as_the_protocol_says),
};

UNIT_MAIN(tests)
