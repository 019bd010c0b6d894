#include "support/unit.h"

#include "base/setting_table.h"

#include <unistd.h>

#define IN .section = "what goes in"

static const struct setting_choice curves[] = { { .name = "soft" }, { .name = "hard" }, { .name = NULL } };
static const struct setting rows[] = {
    { "scene", "FILE", ".json, or 'json' \\ both", NULL, IN, TEXT },
    { "out-dir", "DIR", "where to", "a-b", IN, TEXT },
    { "samples", "N", "how many", "64", IN, TEXT },
    { "tone", "T", "which [curve]", "soft", IN, .type = SETTING_CHOICE, .choices = curves },
    { "knob", "K", "a detail", "3", TUNE, TEXT },
    { "wild", NULL, "another", NULL, TUNE, SWITCH },
    { "tune", "KEY=VALUE", "details", NULL, EXPERT, IN, .type = SETTING_KEYS },
    { .name = NULL },
};
static const struct setting shared[] = {
    { "map", "FILE", "a picture", NULL, IN, TEXT },
    { "fast", NULL, "a switch", NULL, IN, SWITCH },
    { .name = NULL },
};

/* What the program prints when it is given that word. */
static const char *printed(const char *word, size_t operand_max)
{
    static char text[8192];
    struct command c = { .name = "relight-test",
                         .synopsis = "[flags] FILE",
                         .about = "Tests x.y and\nmore. Not this.",
                         .epilogue_title = "keys",
                         .epilogue = ".first = 1\n  second\n",
                         .lists = { { rows, NULL }, { shared, NULL } },
                         .operand_max = operand_max };
    char copy[64], *argv[] = { copy, copy };
    struct reason why;
    bool done = false;
    FILE *to = tmpfile();
    const int keep = dup(STDOUT_FILENO);

    snprintf(copy, sizeof(copy), "%s", word);
    fflush(stdout);
    dup2(fileno(to), STDOUT_FILENO);
    command_begin(&c);
    const enum err e = command_parse(&c, 2, argv, &done, &why);
    fflush(stdout);
    dup2(keep, STDOUT_FILENO);
    close(keep);
    rewind(to);
    text[fread(text, 1, sizeof(text) - 1, to)] = '\0';
    fclose(to);
    assert_int_equal(e, ERR_OK);
    assert_true(done);
    return text;
}

static void the_manual_has_every_part_and_escapes_what_roff_obeys(void **state)
{
    static const char *const parts[] = {
        ".TH RELIGHT-TEST 1 \"\" \"relightd " RELIGHT_VERSION "\"",
        ".SH NAME\nrelight-test \\- tests x.y and more\n",
        ".SH SYNOPSIS\n.B relight-test\n[flags] FILE\n",
        ".SH DESCRIPTION\nTests x.y and more. Not this.\n",
        ".SS \"What goes in\"\n",
        ".TP\n\\fB\\-\\-scene\\fR \\fIFILE\\fR\n\\&.json, or 'json' \\e both\n",
        ".TP\n\\fB\\-\\-out\\-dir\\fR \\fIDIR\\fR\nwhere to [a\\-b]\n",
        ".TP\n\\fB\\-\\-fast\\fR\na switch\n",
        ".TP\n\\fBknob\\fR=\\fIK\\fR\na detail [3]\n",
        ".TP\n\\fBwild\\fR\nanother\n",
        ".SH \"KEYS\"\n.nf\n\\&.first = 1\n  second\n.fi\n",
    };

    (void)state;
    const char *text = printed("--print-manual", 1);
    for (size_t i = 0; i < sizeof(parts) / sizeof(parts[0]); i++)
        if (!strstr(text, parts[i]))
            fail_msg("no '%s' in\n%s", parts[i], text);
}

static void expect_all(const char *text, const char *const *parts, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (!strstr(text, parts[i]))
            fail_msg("no '%s' in\n%s", parts[i], text);
}

static void bash_completes_files_folders_choices_and_flags_of_both_tables(void **state)
{
    static const char *const parts[] = {
        "\n_relight_test()\n",
        "    --scene|--map) compopt -o filenames; mapfile -t COMPREPLY < <(compgen -f ",
        "    --out-dir) compopt -o filenames; mapfile -t COMPREPLY < <(compgen -d ",
        "    --samples) ",
        "    --tone) mapfile -t COMPREPLY < <(compgen -W 'soft hard help' -- ",
        "    --tune) compopt -o nospace; mapfile -t COMPREPLY < <(compgen -W 'knob= wild help' -- ",
        "' --scene --out-dir --samples --tone --tune --map --fast --help --version'",
        "complete -F _relight_test relight-test\n",
    };

    (void)state;
    const char *text = printed("--print-completion-bash", 0);
    expect_all(text, parts, sizeof(parts) / sizeof(parts[0]));
    assert_null(strstr(text, "    else\n")); /* operands, of which there are none, */
    assert_non_null(strstr(printed("--print-completion-bash", 1), "    else\n"));
}

static void zsh_completes_the_same(void **state)
{
    static const char *const parts[] = {
        "#compdef relight-test\n",
        "'--scene=[.json, or '\\''json'\\'' \\\\ both]:FILE:_files' \\\n",
        "'--out-dir=[where to]:DIR:_files -/' \\\n",
        "'--samples=[how many]:N: ' \\\n",
        "'--tone=[which \\[curve\\]]:T:(soft hard help)' \\\n",
        "'--fast[a switch]' \\\n",
        "'*--tune=[details]:KEY=VALUE:(knob= wild help)' \\\n",
    };

    (void)state;
    const char *text = printed("--print-completion-zsh", 0);
    expect_all(text, parts, sizeof(parts) / sizeof(parts[0]));
    assert_null(strstr(text, "'*:file:_files'"));
    assert_non_null(strstr(printed("--print-completion-zsh", 1), "'*:file:_files'"));
}

static void fish_completes_the_same(void **state)
{
    static const char *const parts[] = {
        "complete -c relight-test -f\n",
        " -l scene -d '.json, or '\\''json'\\'' \\\\ both' -rF\n",
        " -l out-dir -d 'where to' -xa '(__fish_complete_directories)'\n",
        " -l samples -d 'how many' -x\n",
        " -l tone -d 'which [curve]' -xa 'soft hard help'\n",
        " -l fast -d 'a switch'\n",
        " -l tune -d 'details' -xa 'knob= wild help'\n",
    };

    (void)state;
    const char *text = printed("--print-completion-fish", 0);
    expect_all(text, parts, sizeof(parts) / sizeof(parts[0]));
    assert_null(strstr(printed("--print-completion-fish", 1), " -f\n"));
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(the_manual_has_every_part_and_escapes_what_roff_obeys),
    cmocka_unit_test(bash_completes_files_folders_choices_and_flags_of_both_tables),
    cmocka_unit_test(zsh_completes_the_same),
    cmocka_unit_test(fish_completes_the_same),
};

UNIT_MAIN(tests)
