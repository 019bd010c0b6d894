#include "support/unit.h"

#include "base/setting_table.h"

#include <unistd.h>

struct values {
    uint32_t size[2];
    uint64_t samples;
    double gain;
    bool fast;
    struct setting_frames frames;
    struct setting_texts to;
    uint32_t knob;
    bool wild;
};

struct given {
    struct values v;
    struct command c;
    struct reason why;
    bool done;
};

#define IN .section = "what goes in"
#define AT(field) SETTING_AT(values, field)

static struct setting rows[] = {
    { "size", "WxH", "the image's size", "640x360", IN, .type = SETTING_SIZE, AT(size) },
    { "samples", "N", "how many", "64", IN, WHOLE(1, 1000), AT(samples) },
    { "gain", "X", "a factor", NULL, IN, REAL(-100.0, 2.0), AT(gain) },
    { "fast", NULL, "a switch", NULL, IN, SWITCH, AT(fast) },
    { "frames", "A-B", "which", NULL, IN, .type = SETTING_FRAMES, AT(frames) },
    { "to", "URL", "where to", NULL, IN, TEXTS, AT(to) },
    { "out", "FILE", "result", NULL, IN, TEXT },
    { "fine", "N", "for experts", NULL, EXPERT, IN, TEXT },
    { "knob", "K", "a detail", "2", TUNE, POWER(8), AT(knob) },
    { "wild", NULL, "another", NULL, TUNE, SWITCH, AT(wild) },
    { "tune", "KEY=VALUE,...", "details", NULL, IN, .type = SETTING_KEYS },
    { .name = NULL },
};

/* Parses a command line of at most seven words behind the program's name. */
static enum err give(struct given *g, size_t operand_max, const char *const *words)
{
    static char copies[8][64];
    char *argv[9] = { copies[0] };
    int argc = 1;

    memset(g, 0, sizeof(*g));
    g->c = (struct command){ .name = "relight-test",
                             .synopsis = "[flags] FILE",
                             .about = "A program of the tests.",
                             .lists = { { rows, &g->v } },
                             .operand_max = operand_max };
    snprintf(copies[0], sizeof(copies[0]), "relight-test");
    for (; words && words[argc - 1]; argc++) {
        snprintf(copies[argc], sizeof(copies[argc]), "%s", words[argc - 1]);
        argv[argc] = copies[argc];
    }
    command_begin(&g->c);
    const enum err e = command_parse(&g->c, argc, argv, &g->done, &g->why);
    return e || g->done ? e : command_read(&g->c, &g->why);
}

#define GIVE(g, max, ...) give(g, max, (const char *const[]){ __VA_ARGS__, NULL })

static void defaults_hold_until_something_is_given(void **state)
{
    struct given g;

    (void)state;
    assert_int_equal(give(&g, 0, NULL), ERR_OK);
    assert_false(g.done);
    assert_int_equal(g.v.samples, 64);
    assert_true(g.v.size[0] == 640 && g.v.size[1] == 360);
    assert_null(command_get(&g.c, "gain"));
    assert_true(g.v.gain == 0.0 && !g.v.fast && !g.v.frames.given);
    assert_false(command_given(&g.c, "samples"));
}

static void values_follow_a_space_or_an_equals_sign(void **state)
{
    struct given g;

    (void)state;
    assert_int_equal(GIVE(&g, 2, "--samples=7", "in.exr", "--gain", "-2.5e1", "--fast", "-"), ERR_OK);
    assert_int_equal(g.v.samples, 7);
    assert_true(g.v.gain == -25.0);
    assert_true(g.v.fast);
    assert_true(command_given(&g.c, "samples") && !command_given(&g.c, "size"));
    assert_int_equal(g.c.operand_count, 2);
    assert_string_equal(g.c.operands[0], "in.exr");
    assert_string_equal(g.c.operands[1], "-");
}

static void last_of_two_wins(void **state)
{
    struct given g;

    (void)state;
    assert_int_equal(GIVE(&g, 0, "--size", "1x1", "--size", "2x2"), ERR_OK);
    assert_true(g.v.size[0] == 2);
}

static void flags_that_add_up_keep_all_their_values(void **state)
{
    static const char *const words[] = { "--to", "a", "--to=b", "--to", "c", NULL };
    struct given g;
    struct command_flag again;

    (void)state;
    assert_int_equal(give(&g, 0, words), ERR_OK);
    assert_int_equal(g.v.to.count, 3);
    for (uint32_t k = 0; k < 3; k++)
        assert_int_equal(g.v.to.text[k][0], 'a' + k);
    again = *command_flag(&g.c, "to");
    assert_true(command_flag_equals(&again, command_flag(&g.c, "to")));
    again.texts.text[0] = "A"; /* not the last alone */
    assert_false(command_flag_equals(&again, command_flag(&g.c, "to")));
    again = *command_flag(&g.c, "to");
    again.texts.count = 2;
    assert_false(command_flag_equals(&again, command_flag(&g.c, "to")));
    assert_int_equal(give(&g, 0, NULL), ERR_OK);
    assert_int_equal(g.v.to.count, 0);
}

static void flags_that_add_up_have_a_limit(void **state)
{
    struct given g;
    struct reason why;

    (void)state;
    assert_int_equal(give(&g, 0, NULL), ERR_OK);
    for (int k = 0; k < SETTING_TEXTS_MAX; k++)
        assert_int_equal(command_give(&g.c, command_flag(&g.c, "to"), "x", &why), ERR_OK);
    assert_int_equal(command_give(&g.c, command_flag(&g.c, "to"), "x", &why), ERR_USAGE);
    assert_string_equal(why.text, "--to: given more than 8 times");
}

static void keys_of_tune_are_given_together_or_apart_and_by_their_old_names(void **state)
{
    struct given g;

    (void)state;
    assert_int_equal(give(&g, 0, NULL), ERR_OK);
    assert_true(g.v.knob == 2 && !g.v.wild);
    assert_int_equal(GIVE(&g, 0, "--tune", "wild,knob=4"), ERR_OK);
    assert_true(g.v.knob == 4 && g.v.wild && command_given(&g.c, "knob"));
    assert_int_equal(GIVE(&g, 0, "--tune=knob=8", "--tune", "wild"), ERR_OK);
    assert_true(g.v.knob == 8 && g.v.wild);
    assert_int_equal(GIVE(&g, 0, "--knob", "2", "--wild"), ERR_OK);
    assert_true(g.v.knob == 2 && g.v.wild);
}

static void bad_keys_and_values_of_tune_are_named(void **state)
{
    static const char *const bad[][2] = {
        { "knobs=2", "--tune has no key 'knobs'; it has knob, wild" },
        { "", "--tune has no key ''; it has knob, wild" },
        { "wild,", "--tune has no key ''; it has knob, wild" },
        { "samples=2", "--tune has no key 'samples'; it has knob, wild" },
        { "knob", "--tune knob needs a value: K" },
        { "wild=1", "--tune wild takes no value" },
        { "knob=3", "--tune knob '3' is not a power of two" },
        { "knob=", "--tune knob '' is not a whole number from 1 to 8" },
        { "knob=9,wild", "--tune knob '9' is not a whole number from 1 to 8" },
    };
    static char full[COMMAND_TUNE_BYTES + 8] = "knob=";
    struct given g;
    struct reason why;

    (void)state;
    for (size_t k = 0; k < sizeof(bad) / sizeof(bad[0]); k++) {
        assert_int_equal(GIVE(&g, 0, "--tune", bad[k][0]), ERR_USAGE);
        assert_string_equal(g.why.text, bad[k][1]);
    }
    assert_int_equal(GIVE(&g, 0, "--knobs", "2"), ERR_USAGE);
    assert_non_null(strstr(g.why.text, "did you mean --tune knob?"));
    assert_int_equal(give(&g, 0, NULL), ERR_OK);
    memset(full + 5, '1', COMMAND_TUNE_BYTES - 1);
    assert_int_equal(command_give(&g.c, command_flag(&g.c, "tune"), full, &why), ERR_OK);
    assert_int_equal(command_give(&g.c, command_flag(&g.c, "tune"), "knob=1", &why), ERR_USAGE);
    assert_string_equal(why.text, "--tune: more than 1024 bytes of values");
}

static void bad_command_lines_are_named(void **state)
{
    struct given g;

    (void)state;
    assert_int_equal(GIVE(&g, 0, "--sizes", "1x1"), ERR_USAGE);
    assert_string_equal(g.why.text, "unknown flag '--sizes': did you mean --size? (see relight-test --help all)");
    assert_int_equal(GIVE(&g, 0, "--siz", "1x1"), ERR_USAGE); /* no abbreviations */
    assert_int_equal(GIVE(&g, 0, "--=3"), ERR_USAGE);
    assert_int_equal(GIVE(&g, 0, "--fast=1"), ERR_USAGE);
    assert_string_equal(g.why.text, "--fast takes no value");
    assert_int_equal(GIVE(&g, 0, "--samples"), ERR_USAGE);
    assert_string_equal(g.why.text, "--samples needs a value: N");
    assert_int_equal(GIVE(&g, 0, "stray"), ERR_USAGE);
    assert_string_equal(g.why.text, "unexpected argument 'stray' (see relight-test --help)");
    assert_int_equal(GIVE(&g, 1, "one", "two"), ERR_USAGE);
    assert_non_null(strstr(g.why.text, "'two'"));
}

static void bad_whole_numbers_are_named(void **state)
{
    static const char *const bad[] = { "-1", " -1", "0", "1001", "ten", "", "7.5", "7 ", "99999999999999999999",
                                       "0x", "0x10" };
    struct given g;

    (void)state;
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        char want[128];
        assert_int_equal(GIVE(&g, 0, "--samples", bad[i]), ERR_USAGE);
        snprintf(want, sizeof(want), "--samples '%s' is not a whole number from 1 to 1000", bad[i]);
        assert_string_equal(g.why.text, want);
        assert_int_equal(g.v.samples, 0); /* untouched */
    }
    rows[1].least = 0;
    rows[1].most = 0x1p64;
    assert_int_equal(GIVE(&g, 0, "--samples", "18446744073709551615"), ERR_OK);
    assert_true(g.v.samples == UINT64_MAX);
    assert_int_equal(GIVE(&g, 0, "--samples", "-1"), ERR_USAGE); /* which C would read as the largest number */
    rows[1].least = 1;
    rows[1].most = 1000;
}

static void whole_numbers_are_decimal_whatever_zeros_lead(void **state)
{
    struct given g;

    (void)state;
    assert_int_equal(GIVE(&g, 0, "--samples", "010"), ERR_OK);
    assert_int_equal(g.v.samples, 10);
    assert_int_equal(GIVE(&g, 0, "--samples", "0089"), ERR_OK); /* no octal number at all */
    assert_int_equal(g.v.samples, 89);
}

static void bad_numbers_are_named(void **state)
{
    static const char *const bad[] = { "nan", "inf", "-inf", "1e999", "2.5", "-100.5", "", "one", "1,5" };
    struct given g;

    (void)state;
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        char want[128];
        assert_int_equal(GIVE(&g, 0, "--gain", bad[i]), ERR_USAGE);
        snprintf(want, sizeof(want), "--gain '%s' is not a number from -100 to 2", bad[i]);
        assert_string_equal(g.why.text, want);
        assert_true(g.v.gain == 0.0);
    }
}

static void bad_sizes_are_named(void **state)
{
    static const char *const bad[] = { "640",     "640x",      "x360", "0x360",   "640x0", "640x16385",
                                       "16385x1", "640x360x2", "-1x5", "640*360", "",      "99999999x1" };
    struct given g;

    (void)state;
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        char want[128];
        assert_int_equal(GIVE(&g, 0, "--size", bad[i]), ERR_USAGE);
        snprintf(want, sizeof(want), "--size '%s' is not WIDTHxHEIGHT with sides from 1 to 16384", bad[i]);
        assert_string_equal(g.why.text, want);
        assert_true(g.v.size[0] == 0 && g.v.size[1] == 0);
    }
    assert_int_equal(GIVE(&g, 0, "--size", "16384x1"), ERR_OK);
    assert_true(g.v.size[0] == 16384 && g.v.size[1] == 1);
}

/* What give() printed on standard output. */
static const char *printed_by(struct given *g, const char *word, const char *next)
{
    static char text[4096];
    FILE *file = tmpfile();

    assert_non_null(file);
    fflush(stdout);
    const int old = dup(STDOUT_FILENO);
    dup2(fileno(file), STDOUT_FILENO);
    const enum err e = GIVE(g, 0, word, next);
    fflush(stdout);
    dup2(old, STDOUT_FILENO);
    close(old);
    assert_int_equal(e, ERR_OK);
    rewind(file);
    text[fread(text, 1, sizeof(text) - 1, file)] = '\0';
    fclose(file);
    return text;
}

static void ranges_are_read_and_bad_ones_named(void **state)
{
    static const char *const bad[] = {
        "", "-", "5-", "-5", "9-3", "3--5", "3- 5", " 3", "+3-5", "3-5x", "a-b", "3-5-7", "12345678901234567890"
    };
    static const struct {
        const char *text;
        uint64_t first, last;
    } good[] = {
        { "17", 17, 17 }, { "3-66", 3, 66 }, { "0-0", 0, 0 }, { "0-9999999999999999999", 0, 9999999999999999999u }
    };
    struct given g;

    (void)state;
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        if (GIVE(&g, 0, "--frames", bad[i]) != ERR_USAGE || g.v.frames.given)
            fail_msg("taken: %s", bad[i]);
        assert_non_null(strstr(g.why.text, "--frames"));
    }
    for (size_t i = 0; i < sizeof(good) / sizeof(good[0]); i++) {
        assert_int_equal(GIVE(&g, 0, "--frames", good[i].text), ERR_OK);
        assert_true(g.v.frames.given && g.v.frames.first == good[i].first && g.v.frames.last == good[i].last);
    }
}

static void help_tells_every_common_flag_and_its_default(void **state)
{
    static const char *const told[] = { "usage: relight-test [flags] FILE\n",
                                        "A program of the tests.",
                                        "\nwhat goes in\n",
                                        "--size WxH",
                                        "the image's size [640x360]",
                                        "--samples N",
                                        "how many [64]",
                                        "a factor\n",
                                        "--fast ",
                                        "--help",
                                        "--version" };
    struct given g;

    (void)state;
    for (int k = 0; k < 2; k++) {
        const char *text = printed_by(&g, k ? "-h" : "--help", NULL);
        assert_true(g.done);
        for (size_t i = 0; i < sizeof(told) / sizeof(told[0]); i++)
            if (!strstr(text, told[i]))
                fail_msg("--help does not say '%s':\n%s", told[i], text);
        assert_true(!strstr(text, "for experts") && !strstr(text, "knob=K"));
    }
}

static void help_all_tells_the_rest(void **state)
{
    struct given g;

    (void)state;
    const char *text = printed_by(&g, "--help", "all");
    assert_true(strstr(text, "how many [64]") && strstr(text, "  --fine N ") && strstr(text, "for experts\n"));
    assert_non_null(strstr(text, "\nKeys of --tune\n  knob=K                     a detail [2]\n  wild "));
    text = printed_by(&g, "--tune", "help");
    assert_non_null(strstr(text, "details:\n  knob=K                     a detail [2]\n  wild "));
}

static void version_is_told_in_one_line(void **state)
{
    struct given g;

    (void)state;
    assert_string_equal(printed_by(&g, "--version", NULL), "relight-test " RELIGHT_VERSION "\n");
    assert_true(g.done);
}

/* -o is what other programs call it; -- ends the flags. */
static void short_out_and_the_end_of_flags_are_known(void **state)
{
    struct given g;
    (void)state;

    assert_int_equal(give(&g, 0, (const char *[]){ "-o", "a.png", NULL }), ERR_OK);
    assert_string_equal(command_get(&g.c, "out"), "a.png");
    assert_int_equal(give(&g, 2, (const char *[]){ "--fast", "--", "--help", "-o", NULL }), ERR_OK);
    assert_false(g.done);
    assert_string_equal(g.c.operands[0], "--help");
    assert_string_equal(g.c.operands[1], "-o");
    assert_null(command_get(&g.c, "out"));
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(short_out_and_the_end_of_flags_are_known),
    cmocka_unit_test(defaults_hold_until_something_is_given),
    cmocka_unit_test(values_follow_a_space_or_an_equals_sign),
    cmocka_unit_test(last_of_two_wins),
    cmocka_unit_test(flags_that_add_up_keep_all_their_values),
    cmocka_unit_test(flags_that_add_up_have_a_limit),
    cmocka_unit_test(keys_of_tune_are_given_together_or_apart_and_by_their_old_names),
    cmocka_unit_test(bad_keys_and_values_of_tune_are_named),
    cmocka_unit_test(bad_command_lines_are_named),
    cmocka_unit_test(bad_whole_numbers_are_named),
    cmocka_unit_test(whole_numbers_are_decimal_whatever_zeros_lead),
    cmocka_unit_test(bad_numbers_are_named),
    cmocka_unit_test(bad_sizes_are_named),
    cmocka_unit_test(ranges_are_read_and_bad_ones_named),
    cmocka_unit_test(help_tells_every_common_flag_and_its_default),
    cmocka_unit_test(help_all_tells_the_rest),
    cmocka_unit_test(version_is_told_in_one_line),
};

UNIT_MAIN(tests)
