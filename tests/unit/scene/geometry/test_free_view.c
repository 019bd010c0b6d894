#include "scene/geometry/view.h"

#include "support/unit.h"

#include <math.h>

static void text_and_view_are_the_same(void **state)
{
    (void)state;
    static const char *const texts[] = { "@4,2,-4;0,1,0;40", "@0.1235,-12.5,1e+06;-1e+06,0,3.25;170",
                                         "@0,0,0;0,0,1;1" };
    struct reason why = { "" };
    char again[FREE_VIEW_TEXT];
    struct camera c;

    for (size_t i = 0; i < sizeof(texts) / sizeof(texts[0]); i++) {
        assert_int_equal(free_view_read(texts[i], &c, &why), ERR_OK);
        assert_string_equal(c.name, texts[i]);
        free_view_write(&c, again);
        assert_string_equal(again, texts[i]);
    }
    assert_int_equal(free_view_read(&" @4,2,-4;0,1,0;40"[1], &c, &why), ERR_OK);
    assert_true(c.position.x == 4.0f && c.position.z == -4.0f && c.look_at.y == 1.0f &&
                fabsf(c.fov_y - 0.698132f) < 1e-5f);
    assert_true(c.up.y == 1.0f);
    /* the longest text fits */
    c.position = c.look_at = (struct vec3){ -123456.7f, -0.12345f, -99999.9f };
    c.fov_y = 0.123456f;
    free_view_write(&c, again);
    assert_int_equal(again[strlen(again) - 1], '4');
}

static void what_is_no_view_is_refused(void **state)
{
    (void)state;
    static const char *const bad[] = { "@",
                                       "@1,2,3",
                                       "@1,2;3,4,5;40",
                                       "@1,2,3;4,5,6",
                                       "@1,2,3;4,5,6;",
                                       "@1,2,3;4,5,6;40x",
                                       "@1,2,3;4,5,6;0.5",
                                       "@1,2,3;4,5,6;171",
                                       "@nan,2,3;4,5,6;40",
                                       "@1e7,2,3;4,5,6;40",
                                       "@inf,2,3;4,5,6;40",
                                       "@1,2,3;4,5,6;nan",
                                       "@1,2,3;1,2,3;40",
                                       "@1,2,3,4;5,6,7;40" };
    struct camera c;

    for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
        struct reason why = { "" };
        if (free_view_read(bad[i], &c, &why) != ERR_USAGE)
            fail_msg("%s is taken", bad[i]);
        assert_true(strstr(why.text, "is not a view such as") || strstr(why.text, "the point that it looks at"));
    }
}

static void straight_up_and_down_have_an_up(void **state)
{
    (void)state;
    struct reason why = { "" };
    struct camera c;

    assert_int_equal(free_view_read("@0,5,0;0,0,0;40", &c, &why), ERR_OK);
    assert_true(c.up.z == 1.0f);
    assert_int_equal(free_view_read("@0,-5,0;0,0,0;40", &c, &why), ERR_OK);
    assert_true(c.up.z == 1.0f);
}

static void flags_change_what_they_name(void **state)
{
    (void)state;
    struct camera c = { .position = { 1, 2, 3 }, .look_at = { 0, 0, 0 }, .up = { 0, 1, 0 }, .fov_y = 0.5f };
    struct reason why = { "" };
    struct view_change change;
    const struct scene here = { .origin = { 0.0 } }, far = { .origin = { 500000.0, 4500000.0, 0.0 } };

    assert_int_equal(view_change_read(NULL, "4,5,6", 0.0, &change, &why), ERR_OK);
    assert_int_equal(view_change_apply(&change, &here, &c, &why), ERR_OK);
    assert_true(c.position.x == 1.0f && c.look_at.x == 4.0f && c.fov_y == 0.5f);
    assert_int_equal(view_change_read("-1,-2,-3", NULL, 90.0, &change, &why), ERR_OK);
    assert_int_equal(view_change_apply(&change, &here, &c, &why), ERR_OK);
    assert_true(c.position.x == -1.0f && c.look_at.x == 4.0f && fabsf(c.fov_y - 1.570796f) < 1e-5f);
    assert_int_equal(view_change_read("4,5,6", NULL, 0.0, &change, &why), ERR_OK);
    assert_int_equal(view_change_apply(&change, &here, &c, &why), ERR_USAGE);
    /* flags have the coordinates of the file, whose model may lie far away */
    assert_int_equal(view_change_read("500001.25,4500002.5,3", NULL, 0.0, &change, &why), ERR_OK);
    assert_int_equal(view_change_apply(&change, &far, &c, &why), ERR_OK);
    assert_true(c.position.x == 1.25f && c.position.y == 2.5f && c.position.z == 3.0f);
    assert_int_equal(view_change_read("4,5", NULL, 0.0, &change, &why), ERR_USAGE);
    assert_non_null(strstr(why.text, "--position 4,5: expected three numbers"));
    assert_int_equal(view_change_read(NULL, "a,b,c", 0.0, &change, &why), ERR_USAGE);
    assert_non_null(strstr(why.text, "--look-at a,b,c"));
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(text_and_view_are_the_same),
    cmocka_unit_test(what_is_no_view_is_refused),
    cmocka_unit_test(straight_up_and_down_have_an_up),
    cmocka_unit_test(flags_change_what_they_name),
};
UNIT_MAIN(tests)
