/* The lists of relight-chart's flags. */
#include "measure/chart/chart.h"
#include "support/unit.h"

/* A name stands for one technique in each class of light, and fits into lists and files. */
static void techniques_are_told_by_their_names(void **state)
{
    size_t count;
    const struct technique *all = technique_all(&count);
    (void)state;

    for (size_t i = 0; i < count; i++) {
        assert_null(strpbrk(all[i].name, " ,;\"'\\"));
        assert_true(technique_samples(&all[i], 1) >= 1 &&
                    technique_samples(&all[i], 64) > technique_samples(&all[i], 16));
        for (size_t k = 0; k < i; k++)
            assert_false(all[i].light_class == all[k].light_class && strcmp(all[i].name, all[k].name) == 0);
    }
    struct reason why = { "" };
    assert_true(technique_listed("faces,mis", &all[7]) == (strcmp(all[7].name, "mis") == 0));
    assert_int_equal(technique_check_list("faces,mis", &why), ERR_OK);
    assert_int_equal(technique_check_list("faces,mi", &why), ERR_USAGE);
    assert_non_null(strstr(why.text, "'mi'"));
}

static void budgets_must_ascend(void **state)
{
    static const char *const bad[] = { "", "4", "4,4", "8,4", "4,x", "0,4", "4,-8", "4 8", "4,8 ", "4,99999999999" };
    uint32_t out[4], count;
    struct reason why;
    (void)state;

    assert_int_equal(chart_read_budgets("4,8,16", out, 4, &count, &why), ERR_OK);
    assert_true(count == 3 && out[0] == 4 && out[2] == 16);
    for (size_t k = 0; k < sizeof(bad) / sizeof(bad[0]); k++)
        assert_int_equal(chart_read_budgets(bad[k], out, 4, &count, &why), ERR_USAGE);
    assert_int_equal(chart_read_budgets("1,2,3,4,5", out, 4, &count, &why), ERR_USAGE);
}

static void lists_give_titles_and_specs(void **state)
{
    static const char *const want[][2] = { { "noon", "sky:hour=12,turbidity=3" },
                                           { "sky:hour=6", "sky:hour=6" },
                                           { "dawn_1k", "env/dawn_1k.hdr" },
                                           { "grey", "env/a b.exr" },
                                           { "builtin", "builtin" } };
    const char *list = "noon=sky:hour=12,turbidity=3;sky:hour=6; env/dawn_1k.hdr;grey=env/a b.exr;;builtin;";
    char title[128], spec[4096];
    (void)state;

    for (size_t k = 0; k < 5; k++) {
        assert_true(chart_next_item(&list, title, spec));
        assert_string_equal(title, want[k][0]);
        assert_string_equal(spec, want[k][1]);
        list += *list == ';' && list[1] == ';';
    }
    assert_false(chart_next_item(&list, title, spec));
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(techniques_are_told_by_their_names),
    cmocka_unit_test(budgets_must_ascend),
    cmocka_unit_test(lists_give_titles_and_specs),
};
UNIT_MAIN(tests)
