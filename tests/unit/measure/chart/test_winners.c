/* Who wins, on made-up panels: whoever computes beforehand stands beside the others. */
#include "measure/chart/winners.h"

#include "support/unit.h"

#include <math.h>

enum { MIS, CACHED, PATH, RULES, DENOISED, CURVES, BUDGETS = 2, SEEDS = 2 };

static const struct technique *direct_technique(const char *name)
{
    size_t count;
    const struct technique *all = technique_all(&count);

    for (size_t k = 0; k < count; k++)
        if (all[k].light_class == LIGHT_DIRECT && strcmp(all[k].name, name) == 0)
            return &all[k];
    fail_msg("no technique is called %s", name);
    return NULL;
}

struct made { /* a panel of `count` of the curves, the same under each seed */
    struct panel panel;
    struct panel_curve curves[CURVES];
    double seconds[CURVES][BUDGETS][SEEDS], errors[CURVES][ERROR_KINDS][BUDGETS][SEEDS];
};

static void make(struct made *m, const int *which, size_t count)
{
    static const char *const names[CURVES] = { "mis", "cached", "path", "rules", "denoised" };
    static const double seconds[CURVES][BUDGETS] = {
        { 0.1, 0.4 }, { 0.02, 0.04 }, { 1.0, 4.0 }, { 0.1, 0.4 }, { 0.2, 0.4 },
    };
    static const double errors[CURVES][BUDGETS] = {
        { 4e-3, 1e-3 }, { 5e-4, 4e-4 }, { 4e-3, 1e-3 }, { 4e-3, 1e-3 }, { 1e-3, 9e-4 },
    };

    *m =
        (struct made){ .panel = { .seeds = SEEDS, .budget_count = BUDGETS, .curve_count = count, .gbuffer_ms = 1000 } };
    m->panel.curves = m->curves;
    for (size_t c = 0; c < count; c++) {
        const int k = which[c];
        m->curves[c] = (struct panel_curve){ .technique = direct_technique(names[k]),
                                             .seconds = m->seconds[c][0],
                                             .errors = m->errors[c][0][0],
                                             .prepared_ms = k == CACHED ? 8000.0 : 0.0 };
        for (int b = 0; b < BUDGETS; b++)
            for (int s = 0; s < SEEDS; s++) {
                m->seconds[c][b][s] = seconds[k][b];
                m->errors[c][ERROR_REL_MSE][b][s] = errors[k][b];
                m->errors[c][ERROR_FLIP][b][s] = sqrt(errors[k][b]);
            }
    }
}

/* Half way is 1 s, from the other two's 0.1, 0.4, 1 and 4; there mis is through with an error of 1e-3, which took it
 * 0.4 s and paths 4 s. */
static void who_computes_beforehand_sets_no_mark_and_wins_nothing(void **state)
{
    static const int all[] = { MIS, CACHED, PATH };
    struct made m;
    struct winners w;
    struct ranking r[TECHNIQUES_MAX];
    (void)state;

    make(&m, all, 3);
    assert_int_equal(winners_find(&m.panel, ERROR_REL_MSE, 10, &w), ERR_OK);
    assert_true(w.seconds[MARK_MIDDLE] == 1.0 && w.error[MARK_MIDDLE] == 1e-3);
    for (int k = 0; k < MARKS; k++)
        assert_true(w.by_error[k] != CACHED && w.by_seconds[k] != CACHED);
    assert_int_equal(w.by_seconds[MARK_MIDDLE], MIS);
    assert_true(w.of[CACHED].has_error[MARK_MIDDLE] && w.of[CACHED].error[MARK_MIDDLE] == 4e-4);
    const struct panel *panels[] = { &m.panel };
    assert_int_equal(winners_rank(panels, &w, 1, LIGHT_DIRECT, r), 2);
}

static void what_is_computed_beforehand_is_won_back_frame_by_frame(void **state)
{
    static const int all[] = { MIS, CACHED, PATH };
    struct made m;
    struct winners w;
    (void)state;

    make(&m, all, 3);
    assert_int_equal(winners_find(&m.panel, ERROR_REL_MSE, 10, &w), ERR_OK);
    assert_true(w.of[CACHED].break_even == 22.0); /* 8 s / 0.38 s */
    assert_true(w.of[MIS].break_even == 0.0);
}

static void alone_it_is_judged_by_itself(void **state)
{
    static const int one[] = { CACHED };
    struct made m;
    struct winners w;
    (void)state;

    make(&m, one, 1);
    assert_int_equal(winners_find(&m.panel, ERROR_REL_MSE, 10, &w), ERR_OK);
    assert_int_equal(w.by_error[MARK_MIDDLE], 0);
    assert_true(w.seconds[MARK_MIDDLE] > 0.0);
}

/* At 0.2 s the unfiltered line, straight in log-log from (0.1, 4e-3) to (0.4, 1e-3), is at 2e-3: a ratio of 1/2, and
 * 0.9 at 0.4 s. FLIP is its square root here. */
static void a_filter_is_held_against_the_same_samples_without_it(void **state)
{
    static const int both[] = { RULES, DENOISED }, lone[] = { MIS, DENOISED };
    struct made m;
    struct winners w;
    struct ranking r[TECHNIQUES_MAX];
    (void)state;

    make(&m, both, 2);
    assert_int_equal(winners_find(&m.panel, ERROR_REL_MSE, 10, &w), ERR_OK);
    assert_true(w.filtered[ERROR_REL_MSE].known && fabs(w.filtered[ERROR_REL_MSE].worst - 0.9) < 1e-9);
    assert_true(fabs(w.filtered[ERROR_FLIP].worst - sqrt(0.9)) < 1e-9);
    assert_true(w.filtered[ERROR_FLIP].worst_seconds == 0.4 && w.filtered[ERROR_FLIP].within);
    assert_int_equal(w.by_error[MARK_MIDDLE], 0); /* less error, but it is not ranked */
    const struct panel *panels[] = { &m.panel };
    assert_int_equal(winners_rank(panels, &w, 1, LIGHT_DIRECT, r), 1);

    make(&m, lone, 2);
    assert_int_equal(winners_find(&m.panel, ERROR_REL_MSE, 10, &w), ERR_OK);
    assert_false(w.filtered[ERROR_FLIP].known);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(who_computes_beforehand_sets_no_mark_and_wins_nothing),
    cmocka_unit_test(what_is_computed_beforehand_is_won_back_frame_by_frame),
    cmocka_unit_test(alone_it_is_judged_by_itself),
    cmocka_unit_test(a_filter_is_held_against_the_same_samples_without_it),
};
UNIT_MAIN(tests)
