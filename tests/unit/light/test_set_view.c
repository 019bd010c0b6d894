/* Another camera's view of a set that is there already. */
#include "support/unit.h"

#include "base/progress.h"
#include "light/relight.h"

enum { WIDTH = 64, HEIGHT = 36 };

static const char *const other = "gallery"; /* of the built-in scene */

static struct set *whole(const char *camera)
{
    struct set *s = NULL;
    struct reason why = { "" };

    assert_int_equal(set_create(&(struct set_desc){ .camera = camera, .width = WIDTH, .height = HEIGHT }, &s, &why),
                     ERR_OK);
    return s;
}

static void a_view_is_what_a_set_of_that_camera_has(void **state)
{
    (void)state;
    struct set *first = whole(NULL), *want = whole(other), *got = NULL;
    struct progress line;
    struct reason why = { "" };

    progress_begin(&line, "view", HEIGHT, NULL);
    assert_int_equal(set_create_view(first, &(struct set_desc){ .camera = other, .width = WIDTH, .height = HEIGHT },
                                     &line, &got, &why),
                     ERR_OK);
    progress_end(&line);
    assert_true(first->bvh_ms >= 0.0 && first->bvh_ms < 6e4); /* a span, not a time since the machine started */
    assert_int_equal(line.done, HEIGHT);                      /* counted, though nothing is drawn */
    assert_string_equal(got->camera, other);
    assert_string_equal(got->name, first->name);
    assert_ptr_equal(got->scene, first->scene);
    const struct gbuffer *a = got->gbuffer, *b = want->gbuffer;
    assert_int_equal(a->packet_count, b->packet_count);
    assert_memory_equal(a->packets, b->packets, a->packet_count * sizeof(a->packets[0]));
    assert_memory_equal(a->entry_first, b->entry_first, (WIDTH * HEIGHT + 1) * sizeof(a->entry_first[0]));
    assert_memory_equal(&got->view, &want->view, sizeof(want->view));
    assert_memory_equal(&got->facts, &want->facts, sizeof(want->facts));
    set_destroy(got); /* the scene is the first one's, which goes on */
    assert_non_null(scene_camera(first->scene, other));
    set_destroy(want);
    set_destroy(first);
}

static void an_unknown_camera_is_named(void **state)
{
    (void)state;
    struct set *first = whole(NULL), *got = first;
    struct progress line;
    struct reason why = { "" };

    progress_begin(&line, "view", HEIGHT, NULL);
    assert_int_equal(set_create_view(first, &(struct set_desc){ .camera = "nobody", .width = WIDTH, .height = HEIGHT },
                                     &line, &got, &why),
                     ERR_USAGE);
    assert_null(got);
    assert_non_null(strstr(why.text, "nobody"));
    set_destroy(first);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_view_is_what_a_set_of_that_camera_has),
    cmocka_unit_test(an_unknown_camera_is_named),
};
UNIT_MAIN(tests)
