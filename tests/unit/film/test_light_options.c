/* The flags of light, as a command line gives them. */
#include "light_options.h"

#include "unit.h"

struct read {
    struct relight_desc light;
    struct set_desc set;
    struct environment_desc environment;
    struct reason why;
};

/* Arguments as one string, split at blanks. */
static enum err read_line(const char *line, struct read *out)
{
    struct option_row none[] = { { NULL, NULL, NULL, NULL } }, rows[LIGHT_OPTIONS];
    struct options o = { .program = "test", .rows = none, .shared = rows };
    static char copy[256]; /* what was read points into it */
    char *argv[16] = { "test" };
    int argc = 1;
    bool done = false;

    light_options_init(rows, "24", "caustics");
    snprintf(copy, sizeof(copy), "%s", line);
    for (char *word = strtok(copy, " "); word; word = strtok(NULL, " "))
        argv[argc++] = word;
    *out = (struct read){ .why = { "" } };
    const enum err e = options_parse(&o, argc, argv, &done, &out->why);
    assert_false(done);
    return e ? e : light_options_read(&o, &out->light, &out->set, &out->environment, &out->why);
}

static void defaults_are_those_of_the_program(void **state)
{
    struct read r;
    (void)state;

    assert_int_equal(read_line("", &r), ERR_OK);
    assert_int_equal(r.light.direct.method, METHOD_AUTO);
    assert_int_equal(r.light.direct.samples, 24);
    assert_int_equal(r.light.classes, PATH_CAUSTICS);
    assert_int_equal(r.light.caustics, PLAN_AUTO);
    assert_int_equal(r.light.indirect, PLAN_AUTO);
    assert_int_equal(r.light.start, START_FACES);
    assert_int_equal(r.light.direct.cells, 1);
    assert_int_equal(r.light.direct.interleave, 1);
    assert_int_equal(r.light.cache_bytes, 1024000000);
    assert_int_equal(r.light.stored_paths, 0);
    assert_int_equal(r.light.renew, 512);
    assert_string_equal(r.light.cache_file, "");
    assert_int_equal(r.light.direct.compensate, COMPENSATE_OFF);
    assert_false(r.light.direct.sun || r.light.direct.no_visibility);
    assert_int_equal(r.environment.importance, IMPORTANCE_LUMINANCE);
}

static void each_flag_arrives_where_it_is_meant(void **state)
{
    struct read r;
    (void)state;

    assert_int_equal(read_line("--method mis --samples 7 --paths all --caustics eye --indirect light --seed 9", &r),
                     ERR_OK);
    assert_int_equal(r.light.direct.method, METHOD_MIS);
    assert_int_equal(r.light.direct.samples, 7);
    assert_int_equal(r.light.classes, PATH_ALL);
    assert_int_equal(r.light.caustics, PLAN_EYE);
    assert_int_equal(r.light.indirect, PLAN_LIGHT);
    assert_int_equal(r.light.direct.seed, 9);

    assert_int_equal(read_line("--particles 1000 --eye-paths 5 --start disc --cells 4 --sun --compensate auto", &r),
                     ERR_OK);
    assert_int_equal(r.light.particles, 1000);
    assert_int_equal(r.light.eye_paths, 5);
    assert_int_equal(r.light.start, START_DISC);
    assert_int_equal(r.light.direct.cells, 4);
    assert_true(r.light.direct.sun);
    assert_int_equal(r.light.direct.compensate, COMPENSATE_AUTO);

    assert_int_equal(read_line("--caustics stored --stored-paths 123 --renew 8", &r), ERR_OK);
    assert_int_equal(r.light.caustics, PLAN_STORED);
    assert_int_equal(r.light.stored_paths, 123);
    assert_int_equal(r.light.renew, 8);

    assert_int_equal(read_line("--method cached --cache-memory 7", &r), ERR_OK);
    assert_int_equal(r.light.direct.method, METHOD_CACHED);
    assert_int_equal(r.light.cache_bytes, 7000000);
    assert_int_equal(read_line("--cache-file off", &r), ERR_OK);
    assert_null(r.light.cache_file);
    assert_int_equal(read_line("--cache-file there", &r), ERR_OK);
    assert_string_equal(r.light.cache_file, "there");

    assert_int_equal(read_line("--interleave 2 --importance max --no-visibility --paths direct", &r), ERR_OK);
    assert_int_equal(r.light.direct.interleave, 2);
    assert_int_equal(r.set.interleave, 2);
    assert_int_equal(r.environment.importance, IMPORTANCE_MAX);
    assert_true(r.light.direct.no_visibility);
    assert_int_equal(r.light.classes, PATH_BACKGROUND | PATH_DIRECT);
}

static void what_cannot_be_is_refused_by_its_name(void **state)
{
    static const char *const wrong[][2] = {
        { "--paths most", "--paths 'most' is not known; there are direct, caustics, indirect and all" },
        { "--caustics both", "--caustics 'both' is not known; there are auto, none, light, eye and stored" },
        { "--indirect both", "--indirect 'both' is not known; there are auto, none, light and eye" },
        { "--start ring", "--start 'ring' is not known; there are faces, quad and disc" },
        { "--compensate yes", "--compensate 'yes' is not known; there are off, on and auto" },
        { "--cells 3", "--cells '3' is no power of two" },
        { "--interleave 3", "--interleave '3' is no power of two" },
    };
    static const char *const flags[][2] = {
        /* the sentence is another room's; it names flag and value */
        { "--method guess", "guess" },       { "--samples 0", "--samples" },
        { "--cells 16", "--cells" },         { "--interleave 8", "--interleave" },
        { "--importance least", "least" },   { "--eye-paths many", "--eye-paths" },
        { "--particles -1", "--particles" }, { "--cache-memory 0", "--cache-memory" },
    };
    struct read r;
    (void)state;

    for (size_t k = 0; k < sizeof(wrong) / sizeof(wrong[0]); k++) {
        assert_int_equal(read_line(wrong[k][0], &r), ERR_USAGE);
        assert_string_equal(r.why.text, wrong[k][1]);
    }
    for (size_t k = 0; k < sizeof(flags) / sizeof(flags[0]); k++) {
        assert_int_equal(read_line(flags[k][0], &r), ERR_USAGE);
        assert_non_null(strstr(r.why.text, flags[k][1]));
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(defaults_are_those_of_the_program),
    cmocka_unit_test(each_flag_arrives_where_it_is_meant),
    cmocka_unit_test(what_cannot_be_is_refused_by_its_name),
};
UNIT_MAIN(tests)
