#include "support/unit.h"

#include "base/command.h"
#include "base/setting_table.h"

static uint64_t samples;
static const struct setting rows[] = {
    { "size", "WxH", "the image's size", "640x360", .section = "in", TEXT },
    { "samples", "N", "how many", "64", .section = "in", WHOLE(1, 9), .size = sizeof(samples) },
    { "to", "URL", "where to", NULL, .section = "in", TEXTS },
    { "gain", "X", "a factor", NULL, .section = "in", TEXT },
    { "fast", NULL, "a switch", NULL, .section = "in", SWITCH },
    { "knob", "K", "a detail", NULL, TUNE, TEXT },
    { "tune", "KEY=VALUE,...", "details", NULL, .section = "in", .type = SETTING_KEYS },
    { .name = NULL },
};
static struct command command = { .name = "relight-test", .lists = { { rows, &samples } } };

/* The flags at their defaults, and the text as "f". */
static enum err parse(const char *text, struct config **c, struct reason *why)
{
    command_begin(&command);
    return config_parse("f", text, strlen(text), c, why);
}

/* The line that a reason about key i names. */
static unsigned line_of(const struct config *c, size_t i)
{
    struct reason why = { "" };

    (void)config_add_location(c, i, ERR_USAGE, &why);
    return (unsigned)strtoul(why.text + strlen("f:"), NULL, 10);
}

static void values_become_what_a_command_line_would_have_said(void **state)
{
    struct config *c;
    struct reason why;

    (void)state;
    assert_int_equal(parse("{\"size\": \"3x4\", \"samples\": 7, \"gain\": -2.5e-5, \"fast\": true}", &c, &why), ERR_OK);
    assert_int_equal(config_count(c), 4);
    for (size_t i = 0; i < 4; i++)
        assert_int_equal(config_apply(c, i, &command, &why), ERR_OK);
    assert_string_equal(command_get(&command, "size"), "3x4");
    assert_string_equal(command_get(&command, "samples"), "7");
    assert_string_equal(command_get(&command, "gain"), "-2.5e-05");
    assert_non_null(command_get(&command, "fast"));
    config_destroy(c);
    config_destroy(NULL);
    assert_int_equal(parse("{\"fast\": false, \"gain\": 0.1, \"samples\": 1e400}", &c, &why), ERR_FORMAT);
    assert_int_equal(parse("{\"fast\": false, \"gain\": 0.1, \"samples\": 18446744073709551615}", &c, &why),
                     ERR_FORMAT);
    assert_int_equal(parse("{\"fast\": false, \"gain\": 0.30000000000000004}", &c, &why), ERR_OK);
    for (size_t i = 0; i < 2; i++)
        assert_int_equal(config_apply(c, i, &command, &why), ERR_OK);
    assert_null(command_get(&command, "fast"));
    assert_true(strtod(command_get(&command, "gain"), NULL) == 0.30000000000000004);
    config_destroy(c);
}

static void keys_of_tune_are_given_by_it_or_by_their_old_names(void **state)
{
    struct config *c;
    struct reason why;

    (void)state;
    assert_int_equal(parse("{\"tune\": \"knob=3\"}", &c, &why), ERR_OK);
    assert_int_equal(config_apply(c, 0, &command, &why), ERR_OK);
    config_destroy(c);
    assert_string_equal(command_get(&command, "knob"), "3");
    assert_int_equal(parse("{\"knob\": 4, \"tune\": \"nob=3\"}", &c, &why), ERR_OK);
    assert_int_equal(config_apply(c, 0, &command, &why), ERR_OK);
    assert_string_equal(command_get(&command, "knob"), "4");
    assert_int_equal(config_apply(c, 1, &command, &why), ERR_USAGE);
    assert_string_equal(why.text, "f:1: tune: --tune has no key 'nob'; it has knob");
    err_say(&why, ERR_USAGE, "--tune knob '4' is bad");
    assert_int_equal(config_add_location(c, 0, ERR_USAGE, &why), ERR_USAGE);
    assert_string_equal(why.text, "f:1: knob: '4' is bad");
    config_destroy(c);
}

static void arrays_are_for_flags_that_add_up(void **state)
{
    static char line[] = "--to", c_text[] = "c";
    char *argv[] = { NULL, line, c_text };
    struct config *c;
    struct reason why;
    bool done;

    (void)state;
    assert_int_equal(parse("{\"to\": [\"a\", \"b\"]}", &c, &why), ERR_OK);
    assert_int_equal(config_apply(c, 0, &command, &why), ERR_OK);
    const struct setting_texts *to = &command_flag(&command, "to")->texts;
    assert_int_equal(to->count, 2);
    assert_string_equal(to->text[0], "a");
    assert_string_equal(to->text[1], "b");
    assert_int_equal(command_parse(&command, 3, argv, &done, &why), ERR_OK); /* overrides the file */
    assert_int_equal(to->count, 1);
    assert_string_equal(to->text[0], "c");
    config_destroy(c);
    assert_int_equal(parse("{\"to\": \"a\"}", &c, &why), ERR_OK);
    assert_int_equal(config_apply(c, 0, &command, &why), ERR_OK);
    assert_int_equal(to->count, 1);
    config_destroy(c);
    assert_int_equal(parse("{\"to\": [\"a\", 1]}", &c, &why), ERR_OK);
    assert_int_equal(config_apply(c, 0, &command, &why), ERR_USAGE);
    assert_string_equal(why.text, "f:1: to: expected a string or an array of strings: URL");
    config_destroy(c);
    assert_int_equal(parse("{\"to\": [1,1,1,1,1,1,1,1,1], \"size\": [\"a\"]}", &c, &why), ERR_OK);
    assert_int_equal(config_apply(c, 1, &command, &why), ERR_USAGE);
    config_destroy(c);
    assert_int_equal(parse("{\"to\": [\"1\",\"2\",\"3\",\"4\",\"5\",\"6\",\"7\",\"8\",\"9\"]}", &c, &why), ERR_OK);
    assert_int_equal(config_apply(c, 0, &command, &why), ERR_USAGE);
    assert_string_equal(why.text, "f:1: to: more than 8");
    config_destroy(c);
}

/* Braces, commas and quotes inside strings and inner objects must not be counted. */
static void every_key_knows_its_line(void **state)
{
    static const char text[] =
        "\n{\"a\": \"x\\\"}, \\\\\",\n\"b\": {\"a\":\n 1, \"c\": [\"d\", \"e\"]}\n,\"c\"\n:\n[1,\n\"z\"], \n"
        "\"\\u0064\\\"\": \"{\\n\"}\n";
    static const unsigned lines[] = { 2, 3, 5, 9 };
    static const char *const keys[] = { "a", "b", "c", "d\"" };
    struct config *c;
    struct reason why;

    (void)state;
    assert_int_equal(parse(text, &c, &why), ERR_OK);
    assert_int_equal(config_count(c), 4);
    for (size_t i = 0; i < 4; i++) {
        assert_string_equal(config_key(c, i), keys[i]);
        assert_int_equal(line_of(c, i), lines[i]);
    }
    config_destroy(c);
}

static void what_no_flag_takes_is_refused_with_file_line_and_key(void **state)
{
    static const struct {
        const char *value, *says;
    } bad[] = {
        { "\"sise\": 3", "f:2: sise: relight-test has no such flag" },
        { "\"\": 3", "f:2: : relight-test has no such flag" },
        { "\"--size\": \"3x3\"", "f:2: --size: relight-test has no such flag" },
        { "\"fast\": 1", "f:2: fast: is a switch; expected true or false" },
        { "\"fast\": \"true\"", "f:2: fast: is a switch; expected true or false" },
        { "\"fast\": null", "f:2: fast: is a switch; expected true or false" },
        { "\"samples\": true", "f:2: samples: expected a string or a number: N" },
        { "\"samples\": null", "f:2: samples: expected a string or a number: N" },
        { "\"samples\": [3]", "f:2: samples: expected a string or a number: N" },
        { "\"samples\": {\"n\": 3}", "f:2: samples: expected a string or a number: N" },
    };
    struct config *c;
    struct reason why;
    char text[128];

    (void)state;
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        snprintf(text, sizeof(text), "{\n%s}", bad[i].value);
        assert_int_equal(parse(text, &c, &why), ERR_OK);
        assert_int_equal(config_apply(c, 0, &command, &why), ERR_USAGE);
        assert_string_equal(why.text, bad[i].says);
        assert_string_equal(command_get(&command, "samples"), "64"); /* untouched */
        config_destroy(c);
    }
}

static void what_is_no_json_object_is_refused_with_its_line(void **state)
{
    static const struct {
        const char *text, *says;
    } bad[] = {
        { "", "f:1: " },
        { "[1]", "f:1: not a JSON object" },
        { "{\"a\": 1,\n\"a\": 2}", "f:2: duplicate object key" },
        { "{\"a\": 1,\n\n\"b\" 2}", "f:3: " },
        { "{\"a\": 1,\n}", "f:2: " },
        { "{\"a\": 1} x", "f:1: " },
        { "{\"a\": \"\\u0000\"}", "f:1: " },
        { "{\"a\": \"\xff\"}", "f:1: " },
    };
    struct config *c;
    struct reason why;

    (void)state;
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        assert_int_equal(parse(bad[i].text, &c, &why), ERR_FORMAT);
        assert_null(c);
        if (strncmp(why.text, bad[i].says, strlen(bad[i].says)) != 0)
            fail_msg("'%s' says: %s", bad[i].text, why.text);
    }
}

/* Whatever a file is cut down to, or wherever a byte is another, it is taken or refused, and nothing else. */
static void any_bytes_are_taken_or_refused(void **state)
{
    static const char whole[] = "{\n \"size\": \"3x\\\"4\",\n \"gain\": [1, {\"x\": \"y\"}], \"fast\": true\n}\n";
    struct config *c;
    struct reason why;
    char text[sizeof(whole)];

    (void)state;
    for (size_t size = 0; size < sizeof(whole); size++) {
        for (int byte = -1; byte<256; byte += size> 0 ? 1 : 300) {
            memcpy(text, whole, sizeof(whole));
            if (byte >= 0)
                text[size - 1] = (char)byte;
            const enum err e = config_parse("f", text, byte >= 0 ? sizeof(whole) - 1 : size, &c, &why);
            assert_true(e == ERR_OK || e == ERR_FORMAT);
            for (size_t i = 0; !e && i < config_count(c); i++) {
                assert_in_range(line_of(c, i), 1, 5);
                (void)!config_apply(c, i, &command, &why);
            }
            config_destroy(c);
        }
    }
}

static void blame_says_the_key_once(void **state)
{
    struct config *c;
    struct reason why;

    (void)state;
    assert_int_equal(parse("{\"samples\": 0}", &c, &why), ERR_OK);
    assert_int_equal(config_apply(c, 0, &command, &why), ERR_OK);
    const enum err e = command_read(&command, &why);
    assert_int_equal(config_add_location(c, 0, e, &why), ERR_USAGE);
    assert_string_equal(why.text, "f:1: samples: '0' is not a whole number from 1 to 9");
    err_say(&why, ERR_USAGE, "--samples-file x");
    assert_int_equal(config_add_location(c, 0, ERR_USAGE, &why), ERR_USAGE);
    assert_string_equal(why.text, "f:1: samples: --samples-file x");
    why.text[0] = '\0';
    assert_int_equal(config_add_location(c, 0, ERR_NOMEM, &why), ERR_NOMEM);
    assert_string_equal(why.text, "f:1: samples: out of memory");
    config_destroy(c);
}

static void a_file_that_cannot_be_read_is_named(void **state)
{
    struct config *c;
    struct reason why;

    (void)state;
    assert_int_equal(config_read("/nonexistent/x.json", &c, &why), ERR_IO);
    assert_null(c);
    assert_non_null(strstr(why.text, "/nonexistent/x.json: cannot read the file: No such"));
    assert_int_equal(config_read("/", &c, &why), ERR_IO);
    assert_int_equal(config_read("/dev/zero", &c, &why), ERR_RANGE);
    assert_non_null(strstr(why.text, "larger than 1048576 bytes"));
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(values_become_what_a_command_line_would_have_said),
    cmocka_unit_test(keys_of_tune_are_given_by_it_or_by_their_old_names),
    cmocka_unit_test(arrays_are_for_flags_that_add_up),
    cmocka_unit_test(every_key_knows_its_line),
    cmocka_unit_test(what_no_flag_takes_is_refused_with_file_line_and_key),
    cmocka_unit_test(what_is_no_json_object_is_refused_with_its_line),
    cmocka_unit_test(any_bytes_are_taken_or_refused),
    cmocka_unit_test(blame_says_the_key_once),
    cmocka_unit_test(a_file_that_cannot_be_read_is_named),
};

UNIT_MAIN(tests)
