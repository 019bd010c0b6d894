/* A setting and a tone curve that are added to a copy of the table are known everywhere: as flag, in the configuration
 * file, in control messages and what is sent about them, in the state file and in --help. */
#include "base/command.h"
#include "base/setting_table.h"
#include "net/message/message.h"
#include "relightd/settings/settings.h"

#include "support/unit.h"

#include <jansson.h>
#include <unistd.h>

struct wide {
    struct settings settings;
    double grain;
};
_Static_assert(sizeof(struct wide) <= SERVER_CONTROL_BYTES, "a control message carries it");

#define TONE_ACES 77

static struct setting rows[SETTING_KEYS_MAX + 2];
static struct setting_choice curves[16];

/* The rows of control messages, with one more, and one more curve. */
static void copy_table(void)
{
    size_t n = 1, k = 0;

    rows[0] = (struct setting){ .name = "grain",
                                .unit = "PERCENT",
                                .help = "film grain",
                                .initial = "1.5",
                                .section = "Output",
                                REAL(0.0, 8.0),
                                SETTING_AT(wide, grain),
                                .key = "grain_percent",
                                .clause = "4.13.99",
                                .use = SETTING_STATE };
    for (; tone_choices[k].name; k++)
        curves[k] = tone_choices[k];
    curves[k] = (struct setting_choice){ "aces", TONE_ACES, "the curve of films", 0 };
    curves[k + 1] = (struct setting_choice){ .name = NULL };
    for (const struct setting *s = settings_table; s->key; s++, n++) {
        rows[n] = *s;
        if (s->choices == tone_choices)
            rows[n].choices = curves;
    }
    rows[n] = (struct setting){ .name = NULL };
}

static struct command command;
static struct wide wide;

static struct command *begin(void)
{
    copy_table();
    wide = (struct wide){ .grain = -1.0 };
    command = (struct command){
        .name = "relight-test", .synopsis = "", .about = "", .program = FOR_RELIGHTD, .lists = { { rows, &wide } }
    };
    command_begin(&command);
    return &command;
}

static enum err give(char *flag, char *value, bool *done)
{
    char *argv[] = { "relight-test", flag, value };
    struct reason why;

    begin();
    const enum err e = command_parse(&command, value ? 3 : flag ? 2 : 1, argv, done, &why);
    return e || *done ? e : command_read(&command, &why);
}

static void they_are_flags(void **state)
{
    bool done;
    (void)state;

    assert_int_equal(give(NULL, NULL, &done), ERR_OK);
    assert_true(wide.grain == 1.5 && wide.settings.tone == TONE_FILMIC);
    assert_int_equal(give("--grain", "3", &done), ERR_OK);
    assert_true(wide.grain == 3.0);
    assert_int_equal(give("--grain", "9", &done), ERR_USAGE);
    assert_int_equal(give("--tone", "aces", &done), ERR_OK);
    assert_int_equal(wide.settings.tone, TONE_ACES);
}

static void they_are_keys_of_the_configuration(void **state)
{
    static const char text[] = "{\"grain\": 2.25, \"tone\": \"aces\"}";
    struct config *c;
    struct reason why;
    (void)state;

    struct command *o = begin();
    assert_int_equal(config_parse("f", text, strlen(text), &c, &why), ERR_OK);
    for (size_t k = 0; k < config_count(c); k++)
        assert_int_equal(config_apply(c, k, o, &why), ERR_OK);
    assert_int_equal(command_read(&command, &why), ERR_OK);
    assert_true(wide.grain == 2.25 && wide.settings.tone == TONE_ACES);
    config_destroy(c);
}

static enum fault_code control(const char *fields, struct message *m, struct fault *fault)
{
    char text[200];

    snprintf(text, sizeof(text), "{\"op\":\"control\",\"request\":3,%s}", fields);
    return message_parse(text, strlen(text), rows, m, fault);
}

static void control_messages_ask_for_them(void **state)
{
    struct message m;
    struct fault fault;
    struct wide asked;
    (void)state;

    begin();
    assert_int_equal(control("\"grain_percent\":4,\"tone\":\"aces\"", &m, &fault), FAULT_NONE);
    memcpy(&asked, m.control.values, sizeof(asked));
    assert_true(m.control.asked & 1);
    assert_true(asked.grain == 4.0 && asked.settings.tone == TONE_ACES);
    assert_int_equal(control("\"grain_percent\":9", &m, &fault), FAULT_BAD_FIELD);
    assert_string_equal(fault.clause, "4.13.99");
    assert_string_equal(fault.text, "grain_percent must be a number from 0 to 8");
    assert_int_equal(fault.request, 3);
    assert_int_equal(control("\"tone\":\"magic\"", &m, &fault), FAULT_BAD_FIELD);
    assert_string_equal(fault.clause, "4.13.6");
    assert_non_null(strstr(fault.text, "or aces"));
}

static void expect_text(char *text, const char *wanted)
{
    assert_non_null(text);
    if (!strstr(text, wanted))
        fail_msg("no %s in %s", wanted, text);
    message_free(text);
}

static void everyone_is_sent_what_they_are_and_may_be(void **state)
{
    const struct welcome w = { .session = "s", .controls = rows };
    const struct server_figures status = { .scene = "a scene" };
    (void)state;

    begin();
    wide.grain = 5.5;
    wide.settings.tone = (enum tone_curve)TONE_ACES;
    expect_text(message_control_shared(rows, &wide), "\"grain_percent\":5.5");
    expect_text(message_control_shared(rows, &wide), "\"tone\":\"aces\"");
    expect_text(message_welcome(&w), "\"grain_percent\":{\"least\":0.0,\"most\":8.0}");
    expect_text(message_welcome(&w), "\"aces\":\"the curve of films\"");
    expect_text(message_status_shared(&status, rows),
                "\"tones\":[\"filmic\",\"reinhard\",\"linear\",\"false-colour\",\"aces\"]");
}

static void the_state_file_keeps_them(void **state)
{
    uint32_t asked;
    const char *clause;
    struct reason why;
    struct wide back = { .grain = 0.0 };
    (void)state;

    begin();
    wide.grain = 5.5;
    wide.settings.fps = 30.0;
    wide.settings.tone = (enum tone_curve)TONE_ACES;
    wide.settings.classes = PATH_ALL;
    snprintf(wide.settings.camera, sizeof(wide.settings.camera), "roof");
    json_t *kept = settings_to_json(rows, SETTING_KEPT, &wide);
    assert_int_equal(settings_from_json(rows, FOR_RELIGHTD, kept, &asked, &back, &clause, &why), ERR_OK);
    assert_true(back.grain == 5.5 && back.settings.tone == TONE_ACES && back.settings.classes == PATH_ALL);
    assert_string_equal(back.settings.camera, "roof");
    json_decref(kept);
}

/* What the program prints. */
static const char *printed(char *flag, char *value)
{
    static char text[8192];
    bool done = false;
    FILE *to = tmpfile();
    const int keep = dup(STDOUT_FILENO);

    fflush(stdout);
    dup2(fileno(to), STDOUT_FILENO);
    const enum err e = give(flag, value, &done);
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

static void help_and_manual_show_them(void **state)
{
    (void)state;

    assert_non_null(strstr(printed("--help", NULL), "--grain PERCENT            film grain [1.5]\n"));
    assert_non_null(
        strstr(printed("--help", NULL), "tone curve: filmic, reinhard, linear, false-colour or aces [filmic]\n"));
    assert_non_null(strstr(printed("--tone", "help"), "aces             the curve of films\n"));
    assert_non_null(strstr(printed("--print-manual", NULL), "\\fIPERCENT\\fR\nfilm grain [1.5]\n"));
    assert_non_null(strstr(printed("--print-completion-bash", NULL), " --grain "));
    assert_null(strstr(printed("--method", "help"), "vpl")); /* nor what the program refuses */
}

/* Several requests that were not taken yet are as one: a sample count and an error exclude each other, as do places. */
static void requests_join_as_if_obeyed_in_turn(void **state)
{
    struct message m, then;
    struct fault fault;
    struct settings s;
    (void)state;

    begin();
    assert_int_equal(control("\"samples\":8,\"step\":2,\"grain_percent\":1", &m, &fault), FAULT_NONE);
    assert_int_equal(control("\"error\":0.5,\"step\":-5", &then, &fault), FAULT_NONE);
    settings_join(rows, &m.control.asked, m.control.values, then.control.asked, then.control.values);
    json_t *both = settings_to_json(rows, SETTING_ASKED, m.control.values);
    memcpy(&s, m.control.values, sizeof(s));
    assert_true(s.error == 0.5 && s.step == -3);
    for (uint32_t k = 0; rows[k].key; k++)
        if (strcmp(rows[k].key, "samples") == 0)
            assert_false(m.control.asked >> k & 1);
        else if (strcmp(rows[k].key, "error") == 0 || strcmp(rows[k].key, "step") == 0 || k == 0)
            assert_true(m.control.asked >> k & 1);
    json_decref(both);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(they_are_flags),
    cmocka_unit_test(they_are_keys_of_the_configuration),
    cmocka_unit_test(control_messages_ask_for_them),
    cmocka_unit_test(everyone_is_sent_what_they_are_and_may_be),
    cmocka_unit_test(the_state_file_keeps_them),
    cmocka_unit_test(help_and_manual_show_them),
    cmocka_unit_test(requests_join_as_if_obeyed_in_turn),
};
UNIT_MAIN(tests)
