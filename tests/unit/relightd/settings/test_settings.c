/* The table of settings, as a command line gives them. */
#include "relightd/settings/settings.h"

#include "support/unit.h"

#include <math.h>

struct read {
    struct setup setup;
    struct reason why;
};

/* Arguments as one string, split at blanks, for a program with these defaults. */
static enum err read_line(const char *line, struct read *out)
{
    static struct command c;
    static char copy[256]; /* what was read points into it */
    char *argv[16] = { "test" };
    int argc = 1;
    bool done = false;

    *out = (struct read){ .why = { "" } };
    c = (struct command){ .program = FOR_RENDER | FOR_MOVIES, .lists = { { settings_table, &out->setup } } };
    command_begin(&c);
    command_default(&c, "samples", "24");
    command_default(&c, "paths", "caustics");
    snprintf(copy, sizeof(copy), "%s", line);
    for (char *word = strtok(copy, " "); word; word = strtok(NULL, " "))
        argv[argc++] = word;
    enum err e = command_parse(&c, argc, argv, &done, &out->why);
    assert_false(done);
    if (!e)
        e = command_read(&c, &out->why);
    return e ? e : setup_complete(&out->setup, &out->why);
}

static void defaults_are_those_of_the_program(void **state)
{
    struct read r;
    const struct setup *s = &r.setup;
    (void)state;

    assert_int_equal(read_line("", &r), ERR_OK);
    assert_int_equal(s->light.direct.method, METHOD_AUTO);
    assert_int_equal(s->light.direct.samples, 24);
    assert_int_equal(s->light.classes, PATH_CAUSTICS);
    assert_int_equal(s->light.caustics, PLAN_AUTO);
    assert_int_equal(s->light.indirect, PLAN_AUTO);
    assert_int_equal(s->light.start, START_FACES);
    assert_int_equal(s->light.direct.cells, 1);
    assert_int_equal(s->light.cache_bytes, 1024000000);
    assert_int_equal(s->light.stored_paths, 0);
    assert_int_equal(s->light.renew, 512);
    assert_string_equal(s->light.cache_file, "");
    assert_int_equal(s->light.direct.compensate, COMPENSATE_OFF);
    assert_false(s->light.direct.sun || s->light.direct.no_visibility);
    assert_int_equal(s->initial.tone, TONE_FILMIC);
    assert_true(s->initial.exposure_stops == EXPOSURE_FOLLOW);
    assert_null(s->set_desc.camera);
    assert_int_equal(s->set_desc.width, 640);
    assert_int_equal(s->set_desc.height, 360);
    assert_non_null(s->kernels);
}

static void each_flag_arrives_where_it_is_meant(void **state)
{
    struct read r;
    const struct setup *s = &r.setup;
    (void)state;

    assert_int_equal(read_line("--method mis --samples 7 --paths all --caustics eye --indirect light --seed 9", &r),
                     ERR_OK);
    assert_int_equal(s->light.direct.method, METHOD_MIS);
    assert_int_equal(s->light.direct.samples, 7);
    assert_int_equal(s->light.classes, PATH_ALL);
    assert_int_equal(s->light.caustics, PLAN_EYE);
    assert_int_equal(s->light.indirect, PLAN_LIGHT);
    assert_int_equal(s->light.direct.seed, 9);
    assert_int_equal(read_line("--seed 18446744073709551615 --rotate -90.5 --scale 3 --layout ball --source a.hdr", &r),
                     ERR_OK);
    assert_true(s->light.direct.seed == UINT64_MAX);
    assert_true(s->environment.rotation_degrees == -90.5 && s->environment.scale_stops == 3.0);
    assert_int_equal(s->environment.layout, LAYOUT_BALL);

    assert_int_equal(read_line("--particles 1000 --eye-paths 5 --tune start=disc,cells=4,sun --compensate auto", &r),
                     ERR_OK);
    assert_int_equal(s->light.particles, 1000);
    assert_int_equal(s->light.eye_paths, 5);
    assert_int_equal(s->light.start, START_DISC);
    assert_int_equal(s->light.direct.cells, 4);
    assert_true(s->light.direct.sun);
    assert_int_equal(s->light.direct.compensate, COMPENSATE_AUTO);

    assert_int_equal(read_line("--caustics stored --tune stored-paths=123 --tune renew=8", &r), ERR_OK);
    assert_int_equal(s->light.caustics, PLAN_STORED);
    assert_int_equal(s->light.stored_paths, 123);
    assert_int_equal(s->light.renew, 8);

    assert_int_equal(read_line("--method cached --cache-memory 7", &r), ERR_OK);
    assert_int_equal(s->light.direct.method, METHOD_CACHED);
    assert_int_equal(s->light.cache_bytes, 7000000);
    assert_int_equal(read_line("--cache-dir off", &r), ERR_OK);
    assert_null(s->light.cache_file);
    assert_int_equal(read_line("--cache-dir here", &r), ERR_OK);
    assert_string_equal(s->light.cache_file, "");
    assert_string_equal(s->light.cache_dir, "here");
    assert_int_equal(read_line("--cache-dir off --cache-file there", &r), ERR_OK);
    assert_string_equal(s->light.cache_file, "there");
    assert_int_equal(read_line("--cache-file off", &r), ERR_OK);
    assert_null(s->light.cache_file);
    assert_int_equal(read_line("--cache-file there --frames 3-66 --camera roof --size 3x4", &r), ERR_OK);
    assert_string_equal(s->light.cache_file, "there");
    assert_true(s->source_desc.frames.given && s->source_desc.frames.first == 3 && s->source_desc.frames.last == 66);
    assert_string_equal(s->set_desc.camera, "roof");
    assert_true(s->set_desc.width == 3 && s->set_desc.height == 4);

    assert_int_equal(read_line("--tune no-visibility --paths direct", &r), ERR_OK);
    assert_true(s->light.direct.no_visibility);
    assert_int_equal(s->light.classes, PATH_BACKGROUND | PATH_DIRECT);
}

static void what_cannot_be_is_refused_by_its_name(void **state)
{
    static const char *const wrong[][2] = {
        { "--paths most", "--paths 'most' is unknown; expected direct, caustics, indirect or all" },
        { "--caustics both", "--caustics 'both' is unknown; expected auto, none, light, eye or stored" },
        { "--indirect both", "--indirect 'both' is unknown; expected auto, none, light or eye" },
        { "--tune start=ring", "--tune start 'ring' is unknown; expected faces, quad or disc" },
        { "--tune compensate=yes", "--tune compensate 'yes' is unknown; expected off, on or auto" },
        { "--tone aces", "--tone 'aces' is unknown; expected filmic, reinhard, linear, false-colour or pq" },
        { "--tune cells=3", "--tune cells '3' is not a power of two" },
        { "--samples 0", "--samples '0' is not a whole number from 1 to 1048576" },
        { "--rotate 1e9", "--rotate '1e9' is not a number from -3600 to 3600" },
    };
    static const char *const flags[][2] = {
        /* the sentence is another room's; it names flag and value */
        { "--method guess", "guess" },
        { "--tune cells=16", "--tune cells" },
        { "--eye-paths many", "--eye-paths" },
        { "--particles -1", "--particles" },
        { "--cache-memory 0", "--cache-memory" },
        { "--cpu v9", "--cpu" },
    };
    struct read r;
    char line[100], want[100];
    (void)state;

    for (size_t k = 0; k < sizeof(wrong) / sizeof(wrong[0]); k++) {
        assert_int_equal(read_line(wrong[k][0], &r), ERR_USAGE);
        assert_string_equal(r.why.text, wrong[k][1]);
    }
    for (size_t k = 0; k < sizeof(flags) / sizeof(flags[0]); k++) {
        assert_int_equal(read_line(flags[k][0], &r), ERR_USAGE);
        assert_non_null(strstr(r.why.text, flags[k][1]));
    }
    memset(line, 0, sizeof(line));
    snprintf(line, sizeof(line), "--camera %064d", 0);
    assert_int_equal(read_line(line, &r), ERR_USAGE);
    snprintf(want, sizeof(want), "--camera: longer than 63 bytes");
    assert_string_equal(r.why.text, want);
}

/* Every enumerated value has one name, and a line about it. */
static void choices_read_back_and_say_what_they_are(void **state)
{
    int got = -1;
    struct reason why;
    (void)state;

    for (const struct setting *s = settings_table; !setting_ends(s); s++) {
        if (s->type != SETTING_CHOICE)
            continue;
        for (const struct setting_choice *c = s->choices; c->name; c++) {
            assert_true(c->about && c->about[0]);
            assert_string_equal(choice_name(s->choices, c->value), c->name);
            assert_int_equal(choice_parse(s->choices, FOR_RENDER | FOR_MOVIES, "x", c->name, &got, &why), ERR_OK);
            assert_int_equal(got, c->value);
        }
    }
    for (int m = 0; m < METHOD_COUNT; m++) {
        assert_int_equal(choice_parse(method_choices, FOR_RENDER, "x", method_name((enum method)m), &got, &why),
                         ERR_OK);
        assert_int_equal(got, m);
        const enum err live = choice_parse(method_choices, FOR_RELIGHTD, "x", method_name((enum method)m), &got, &why);
        assert_int_equal(live, method_is_reference((enum method)m) && m != METHOD_COMPONENTS ? ERR_USAGE : ERR_OK);
    }
}

/* What base/setting.h asks of a table. */
static void rows_with_a_key_come_first_and_lie_within_the_settings(void **state)
{
    size_t keys = 0;
    bool over = false;
    (void)state;

    for (const struct setting *s = settings_table; !setting_ends(s); s++) {
        over |= !s->key;
        assert_false(over && s->key);
        keys += s->key != NULL;
        if (!s->key)
            continue;
        assert_true(s->offset + s->size <= sizeof(struct settings));
        assert_true(s->clause || !(s->use & SETTING_ASKED));
    }
    assert_true(keys > 10 && keys <= SETTING_KEYS_MAX);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(defaults_are_those_of_the_program),
    cmocka_unit_test(each_flag_arrives_where_it_is_meant),
    cmocka_unit_test(what_cannot_be_is_refused_by_its_name),
    cmocka_unit_test(choices_read_back_and_say_what_they_are),
    cmocka_unit_test(rows_with_a_key_come_first_and_lie_within_the_settings),
};
UNIT_MAIN(tests)
