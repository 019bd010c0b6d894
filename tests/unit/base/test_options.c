#include "support/unit.h"

#include "base/options.h"

#include <unistd.h>

struct given {
    struct option_row rows[8];
    struct options o;
    struct reason why;
    bool done;
};

/* Parses a command line of at most seven words behind the program's name. */
static enum err give(struct given *g, size_t operand_max, const char *const *words)
{
    static char copies[8][64];
    char *argv[9] = { copies[0] };
    int argc = 1;
    static const struct option_row rows[] = {
        { "", NULL, "what goes in", NULL },   { "size", "WxH", "the picture's size", "640x360" },
        { "samples", "N", "how many", "64" }, { "gain", "X", "a factor", NULL },
        { "fast", NULL, "a switch", NULL },   { NULL, NULL, NULL, NULL },
    };

    memset(g, 0, sizeof(*g));
    memcpy(g->rows, rows, sizeof(rows));
    g->o = (struct options){ .program = "relight-test",
                             .synopsis = "[flags] FILE",
                             .about = "A program of the tests.",
                             .rows = g->rows,
                             .operand_max = operand_max };
    snprintf(copies[0], sizeof(copies[0]), "relight-test");
    for (; words && words[argc - 1]; argc++) {
        snprintf(copies[argc], sizeof(copies[argc]), "%s", words[argc - 1]);
        argv[argc] = copies[argc];
    }
    return options_parse(&g->o, argc, argv, &g->done, &g->why);
}

#define GIVE(g, max, ...) give(g, max, (const char *const[]){ __VA_ARGS__, NULL })

static void defaults_hold_until_something_is_given(void **state)
{
    struct given g;
    uint64_t n = 0;
    uint32_t w = 0, h = 0;

    (void)state;
    assert_int_equal(give(&g, 0, NULL), ERR_OK);
    assert_false(g.done);
    assert_int_equal(options_u64(&g.o, "samples", 1, 1000, &n, &g.why), ERR_OK);
    assert_int_equal(n, 64);
    assert_int_equal(options_size(&g.o, "size", &w, &h, &g.why), ERR_OK);
    assert_true(w == 640 && h == 360);
    assert_null(options_get(&g.o, "gain"));
    assert_false(options_on(&g.o, "fast"));
}

static void values_follow_a_space_or_an_equals_sign(void **state)
{
    struct given g;
    uint64_t n = 0;
    double x = 0.0;

    (void)state;
    assert_int_equal(GIVE(&g, 2, "--samples=7", "in.exr", "--gain", "-2.5e1", "--fast", "-"), ERR_OK);
    assert_int_equal(options_u64(&g.o, "samples", 1, 1000, &n, &g.why), ERR_OK);
    assert_int_equal(n, 7);
    assert_int_equal(options_double(&g.o, "gain", -100.0, 100.0, &x, &g.why), ERR_OK);
    assert_true(x == -25.0);
    assert_true(options_on(&g.o, "fast"));
    assert_int_equal(g.o.operand_count, 2);
    assert_string_equal(g.o.operands[0], "in.exr");
    assert_string_equal(g.o.operands[1], "-");
}

static void last_of_two_wins(void **state)
{
    struct given g;

    (void)state;
    assert_int_equal(GIVE(&g, 0, "--size", "1x1", "--size", "2x2"), ERR_OK);
    assert_string_equal(options_get(&g.o, "size"), "2x2");
}

static void bad_command_lines_are_named(void **state)
{
    struct given g;

    (void)state;
    assert_int_equal(GIVE(&g, 0, "--sizes", "1x1"), ERR_USAGE);
    assert_string_equal(g.why.text, "unknown flag '--sizes' (see relight-test --help)");
    assert_int_equal(GIVE(&g, 0, "--siz", "1x1"), ERR_USAGE); /* no abbreviations */
    assert_int_equal(GIVE(&g, 0, "--=3"), ERR_USAGE);         /* nor the heading's empty name */
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
    uint64_t n = 12345;

    (void)state;
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        char want[128];
        assert_int_equal(GIVE(&g, 0, "--samples", bad[i]), ERR_OK);
        assert_int_equal(options_u64(&g.o, "samples", 1, 1000, &n, &g.why), ERR_USAGE);
        snprintf(want, sizeof(want), "--samples '%s' is not a whole number from 1 to 1000", bad[i]);
        assert_string_equal(g.why.text, want);
        assert_int_equal(n, 12345); /* untouched */
    }
    assert_int_equal(options_u64(&g.o, "gain", 1, 2, &n, &g.why), ERR_USAGE);
    assert_string_equal(g.why.text, "--gain is missing");
    assert_int_equal(GIVE(&g, 0, "--samples", "18446744073709551615"), ERR_OK);
    assert_int_equal(options_u64(&g.o, "samples", 0, UINT64_MAX, &n, &g.why), ERR_OK);
    assert_true(n == UINT64_MAX);
    assert_int_equal(GIVE(&g, 0, "--samples", "-1"), ERR_OK); /* which C would read as the largest number */
    assert_int_equal(options_u64(&g.o, "samples", 0, UINT64_MAX, &n, &g.why), ERR_USAGE);
}

static void whole_numbers_are_decimal_whatever_zeros_lead(void **state)
{
    struct given g;
    uint64_t n = 0;

    (void)state;
    assert_int_equal(GIVE(&g, 0, "--samples", "010"), ERR_OK);
    assert_int_equal(options_u64(&g.o, "samples", 1, 1000, &n, &g.why), ERR_OK);
    assert_int_equal(n, 10);
    assert_int_equal(GIVE(&g, 0, "--samples", "0089"), ERR_OK); /* no octal number at all */
    assert_int_equal(options_u64(&g.o, "samples", 1, 1000, &n, &g.why), ERR_OK);
    assert_int_equal(n, 89);
}

static void bad_numbers_are_named(void **state)
{
    static const char *const bad[] = { "nan", "inf", "-inf", "1e999", "2.5", "-0.5", "", "one", "1,5" };
    struct given g;
    double x = 0.25;

    (void)state;
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        char want[128];
        assert_int_equal(GIVE(&g, 0, "--gain", bad[i]), ERR_OK);
        assert_int_equal(options_double(&g.o, "gain", 0.0, 2.0, &x, &g.why), ERR_USAGE);
        snprintf(want, sizeof(want), "--gain '%s' is not a number from 0 to 2", bad[i]);
        assert_string_equal(g.why.text, want);
        assert_true(x == 0.25);
    }
    assert_int_equal(give(&g, 0, NULL), ERR_OK);
    assert_int_equal(options_double(&g.o, "gain", 0.0, 2.0, &x, &g.why), ERR_USAGE);
    assert_string_equal(g.why.text, "--gain is missing");
}

static void bad_sizes_are_named(void **state)
{
    static const char *const bad[] = { "640",     "640x",      "x360", "0x360",   "640x0", "640x16385",
                                       "16385x1", "640x360x2", "-1x5", "640*360", "",      "99999999x1" };
    struct given g;
    uint32_t w = 1, h = 2;

    (void)state;
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        char want[128];
        assert_int_equal(GIVE(&g, 0, "--size", bad[i]), ERR_OK);
        assert_int_equal(options_size(&g.o, "size", &w, &h, &g.why), ERR_USAGE);
        snprintf(want, sizeof(want), "--size '%s' is not WIDTHxHEIGHT with sides from 1 to 16384", bad[i]);
        assert_string_equal(g.why.text, want);
        assert_true(w == 1 && h == 2);
    }
    assert_int_equal(GIVE(&g, 0, "--size", "16384x1"), ERR_OK);
    assert_int_equal(options_size(&g.o, "size", &w, &h, &g.why), ERR_OK);
    assert_true(w == 16384 && h == 1);
    assert_int_equal(options_size(&g.o, "gain", &w, &h, &g.why), ERR_USAGE);
    assert_string_equal(g.why.text, "--gain is missing");
}

/* What give() printed on standard output. */
static const char *printed_by(struct given *g, const char *word)
{
    static char text[4096];
    FILE *file = tmpfile();

    assert_non_null(file);
    fflush(stdout);
    const int old = dup(STDOUT_FILENO);
    dup2(fileno(file), STDOUT_FILENO);
    const enum err e = GIVE(g, 0, word);
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
    uint64_t first = 7, last = 8;
    bool is = true;
    struct given g;

    (void)state;
    assert_int_equal(give(&g, 0, NULL), ERR_OK);
    assert_int_equal(options_range(&g.o, "gain", &is, &first, &last, &g.why), ERR_OK);
    assert_false(is);
    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        assert_int_equal(give(&g, 0, (const char *const[]){ "--samples", bad[i], NULL }), ERR_OK);
        if (options_range(&g.o, "samples", &is, &first, &last, &g.why) != ERR_USAGE || is)
            fail_msg("taken: %s", bad[i]);
        assert_non_null(strstr(g.why.text, "--samples"));
    }
    assert_int_equal(first, 7);
    for (size_t i = 0; i < sizeof(good) / sizeof(good[0]); i++) {
        assert_int_equal(give(&g, 0, (const char *const[]){ "--samples", good[i].text, NULL }), ERR_OK);
        assert_int_equal(options_range(&g.o, "samples", &is, &first, &last, &g.why), ERR_OK);
        assert_true(is && first == good[i].first && last == good[i].last);
    }
}

static void help_tells_every_flag_and_its_default(void **state)
{
    static const char *const told[] = { "usage: relight-test [flags] FILE\n",
                                        "A program of the tests.",
                                        "\nwhat goes in\n",
                                        "--size WxH",
                                        "the picture's size [640x360]",
                                        "--samples N",
                                        "how many [64]",
                                        "a factor\n",
                                        "--fast ",
                                        "--help",
                                        "--version" };
    struct given g;

    (void)state;
    for (int k = 0; k < 2; k++) {
        const char *text = printed_by(&g, k ? "-h" : "--help");
        assert_true(g.done);
        for (size_t i = 0; i < sizeof(told) / sizeof(told[0]); i++)
            if (!strstr(text, told[i]))
                fail_msg("--help does not say '%s':\n%s", told[i], text);
    }
}

static void version_is_told_in_one_line(void **state)
{
    struct given g;

    (void)state;
    assert_string_equal(printed_by(&g, "--version"), "relight-test " RELIGHT_VERSION "\n");
    assert_true(g.done);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(defaults_hold_until_something_is_given),
    cmocka_unit_test(values_follow_a_space_or_an_equals_sign),
    cmocka_unit_test(last_of_two_wins),
    cmocka_unit_test(bad_command_lines_are_named),
    cmocka_unit_test(bad_whole_numbers_are_named),
    cmocka_unit_test(whole_numbers_are_decimal_whatever_zeros_lead),
    cmocka_unit_test(bad_numbers_are_named),
    cmocka_unit_test(bad_sizes_are_named),
    cmocka_unit_test(ranges_are_read_and_bad_ones_named),
    cmocka_unit_test(help_tells_every_flag_and_its_default),
    cmocka_unit_test(version_is_told_in_one_line),
};

UNIT_MAIN(tests)
