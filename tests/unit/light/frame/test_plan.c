#include "light/frame/frame_plan.h"

#include "support/unit.h"

/* A court with a mirror ball under a sunny sky, asked for in full. */
static const struct plan_facts court = {
    .casters = 2, .points = 5000, .behind = 40, .pixels = 4000, .albedo = 0.5, .peakedness = 1e4
};
static const struct relight_desc everything = { .classes = PATH_CAUSTICS | PATH_INDIRECT,
                                               .direct = { .samples = 64 } };

static struct plan planned_stored(const struct plan_facts *f, const struct relight_desc *w, bool stored)
{
    struct plan p;
    plan_make(f, w, stored, &p);
    return p;
}

static struct plan planned(const struct plan_facts *f, const struct relight_desc *w)
{
    return planned_stored(f, w, false);
}

static void assert_left_out(const struct plan *p, uint32_t count, const char *first)
{
    assert_int_equal(p->left_out_count, count);
    if (count)
        assert_string_equal(p->left_out[0], first);
}

static void a_scene_without_casters_has_no_caustics(void **state)
{
    struct plan_facts f = court;
    struct relight_desc w = everything;
    (void)state;

    f.casters = 0;
    f.behind = 0;
    for (int by = PLAN_AUTO; by <= PLAN_STORED; by++) { /* whoever is wished for */
        w.caustics = (enum plan_estimator)by;
        const struct plan p = planned(&f, &w);
        assert_int_equal(p.caustics, PLAN_NONE);
        assert_int_equal(p.indirect, PLAN_EYE);
        assert_int_equal(p.indirect_caustics, PLAN_EYE);
        assert_int_equal(p.particles, 0);
        assert_int_equal(p.eye_paths, 8);
        assert_left_out(&p, 1,
                        by == PLAN_NONE ? "caustics: switched off" : "caustics: the scene has no mirror and no glass");
    }
}

static void the_sky_decides_who_finds_caustics(void **state)
{
    struct plan_facts f = court;
    (void)state;

    struct plan p = planned(&f, &everything);
    assert_int_equal(p.caustics, PLAN_LIGHT);
    assert_int_equal(p.indirect, PLAN_EYE);
    assert_int_equal(p.indirect_caustics, PLAN_LIGHT); /* by the same particles */
    assert_int_equal(p.particles, 8 * 4000);
    assert_left_out(&p, 0, NULL);

    f.peakedness = 1.3;
    p = planned(&f, &everything);
    assert_int_equal(p.caustics, PLAN_EYE);
    assert_int_equal(p.indirect_caustics, PLAN_EYE);
    assert_int_equal(p.particles, 0);

    f.peakedness = 0.0; /* black, or not known yet */
    assert_int_equal(planned(&f, &everything).caustics, PLAN_EYE);
}

static void dark_surfaces_need_no_indirect_light(void **state)
{
    struct plan_facts f = court;
    struct relight_desc w = everything;
    (void)state;

    f.albedo = 0.02;
    const struct plan p = planned(&f, &w);
    assert_int_equal(p.indirect, PLAN_NONE);
    assert_int_equal(p.indirect_caustics, PLAN_NONE);
    assert_false(p.behind_indirect);
    assert_true(p.behind_caustics);
    assert_left_out(&p, 1, "indirect light: the surfaces are too dark for it to be seen");

    w.indirect = PLAN_LIGHT; /* a named estimator is used */
    assert_int_equal(planned(&f, &w).indirect, PLAN_LIGHT);
}

/* The light tracer cannot reach points that are seen in a mirror; eye paths serve them whoever takes the rest. */
static void what_is_behind_mirrors_is_left_to_eye_paths(void **state)
{
    struct relight_desc w = everything;
    struct plan_facts f = court;
    (void)state;

    w.caustics = w.indirect = PLAN_LIGHT;
    struct plan p = planned(&f, &w);
    assert_true(p.behind_caustics && p.behind_indirect);
    assert_int_equal(p.eye_paths, 8);
    f.behind = 0;
    p = planned(&f, &w);
    assert_false(p.behind_caustics || p.behind_indirect);
    assert_int_equal(p.eye_paths, 0);
    assert_int_equal(p.particles, 8 * 4000);
}

static void what_was_not_asked_for_is_not_done(void **state)
{
    const struct relight_desc direct_alone = { .classes = PATH_DIRECT, .direct = { .samples = 64 } };
    struct relight_desc w = everything;
    (void)state;

    struct plan p = planned(&court, &direct_alone);
    assert_true(p.caustics == PLAN_NONE && p.indirect == PLAN_NONE && p.indirect_caustics == PLAN_NONE);
    assert_true(p.particles == 0 && p.eye_paths == 0 && !p.behind_caustics && !p.behind_indirect);
    assert_left_out(&p, 2, "caustics: not requested");
    assert_string_equal(p.left_out[1], "indirect light: not requested");

    w.indirect = PLAN_NONE;
    p = planned(&court, &w);
    assert_int_equal(p.indirect_caustics, PLAN_NONE);
    assert_left_out(&p, 1, "indirect light: switched off");

    w = everything; /* indirect light alone, of caustics too, by whom it is done */
    w.classes = PATH_INDIRECT;
    assert_int_equal(planned(&court, &w).indirect_caustics, PLAN_EYE);
}

static void counts_follow_the_samples_unless_they_are_given(void **state)
{
    struct relight_desc w = everything;
    (void)state;

    w.direct.samples = 1;
    struct plan p = planned(&court, &w);
    assert_int_equal(p.particles, 4000);
    assert_int_equal(p.eye_paths, 1);
    w.direct.samples = 256;
    p = planned(&court, &w);
    assert_int_equal(p.particles, 32 * 4000);
    assert_int_equal(p.eye_paths, 32);
    w.particles = 12;
    w.eye_paths = 3;
    p = planned(&court, &w);
    assert_int_equal(p.particles, 12);
    assert_int_equal(p.eye_paths, 3);
}

/* Under whatever sky; what caustics throw on comes by the same paths, the rest of indirect light does not. */
static void what_is_stored_takes_caustics_unless_another_is_asked(void **state)
{
    struct plan_facts f = court;
    struct relight_desc w = everything;
    (void)state;

    for (int k = 0; k < 2; k++) {
        f.peakedness = k ? 1.3 : 0.0;
        const struct plan p = planned_stored(&f, &w, true);
        assert_int_equal(p.caustics, PLAN_STORED);
        assert_int_equal(p.indirect, PLAN_EYE);
        assert_int_equal(p.indirect_caustics, PLAN_STORED);
        assert_int_equal(p.particles, 8 * 4000); /* for the sun */
    }
    w.caustics = PLAN_LIGHT;
    assert_int_equal(planned_stored(&f, &w, true).caustics, PLAN_LIGHT);
    w.caustics = PLAN_STORED; /* a named estimator is used */
    assert_int_equal(planned(&f, &w).caustics, PLAN_STORED);
    w.classes = PATH_CAUSTICS;
    assert_int_equal(planned(&f, &w).indirect_caustics, PLAN_NONE);
    f.casters = 0;
    assert_int_equal(planned(&f, &w).caustics, PLAN_NONE);
    assert_int_equal(planned(&f, &w).particles, 0);
}

static void names_are_read_and_others_refused(void **state)
{
    static const char *const names[] = { "auto", "none", "light", "eye", "stored" };
    int by = PLAN_EYE;
    struct reason why;
    (void)state;

    for (int k = 0; k < 5; k++) {
        assert_int_equal(choice_parse(caustics_choices, 0, "--caustics", names[k], &by, &why), ERR_OK);
        assert_int_equal(by, k);
    }
    assert_int_equal(choice_parse(indirect_choices, 0, "--indirect", "eye", &by, &why), ERR_OK);
    assert_int_equal(choice_parse(indirect_choices, 0, "--indirect", "stored", &by, &why), ERR_USAGE);
    assert_string_equal(why.text, "--indirect 'stored' is unknown; expected auto, none, light or eye");
    assert_int_equal(choice_parse(caustics_choices, 0, "--caustics", "lights", &by, &why), ERR_USAGE);
    assert_string_equal(why.text, "--caustics 'lights' is unknown; expected auto, none, light, eye or stored");
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_scene_without_casters_has_no_caustics),
    cmocka_unit_test(the_sky_decides_who_finds_caustics),
    cmocka_unit_test(dark_surfaces_need_no_indirect_light),
    cmocka_unit_test(what_is_behind_mirrors_is_left_to_eye_paths),
    cmocka_unit_test(what_was_not_asked_for_is_not_done),
    cmocka_unit_test(counts_follow_the_samples_unless_they_are_given),
    cmocka_unit_test(what_is_stored_takes_caustics_unless_another_is_asked),
    cmocka_unit_test(names_are_read_and_others_refused),
};
UNIT_MAIN(tests)
