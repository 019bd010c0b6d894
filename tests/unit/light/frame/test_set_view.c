/* Another camera's view of a set that is there already. */
#include "support/unit.h"

#include "base/progress.h"
#include "light/frame/relight.h"

enum { WIDTH = 64, HEIGHT = 36 };

static const char *const other = "gallery"; /* of the built-in scene */

static struct prepared_scene *whole(const char *camera)
{
    struct prepared_scene *s = NULL;
    struct reason why = { "" };

    assert_int_equal(
        set_create(&(struct prepared_scene_desc){ .camera = camera, .width = WIDTH, .height = HEIGHT }, &s, &why),
        ERR_OK);
    return s;
}

static void a_view_is_what_a_set_of_that_camera_has(void **state)
{
    (void)state;
    struct prepared_scene *first = whole(NULL), *want = whole(other), *got = NULL;
    struct progress line;
    struct reason why = { "" };

    progress_begin(&line, "view", HEIGHT, NULL);
    assert_int_equal(set_create_view(first,
                                     &(struct prepared_scene_desc){ .camera = other, .width = WIDTH, .height = HEIGHT },
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
    struct prepared_scene *first = whole(NULL), *got = first;
    struct progress line;
    struct reason why = { "" };

    progress_begin(&line, "view", HEIGHT, NULL);
    assert_int_equal(
        set_create_view(first, &(struct prepared_scene_desc){ .camera = "nobody", .width = WIDTH, .height = HEIGHT },
                        &line, &got, &why),
        ERR_USAGE);
    assert_null(got);
    assert_non_null(strstr(why.text, "nobody"));
    set_destroy(first);
}

static struct prepared_scene *first_of(struct prepared_scene_desc d)
{
    struct prepared_scene *s = NULL;
    struct reason why = { "" };

    d.width = WIDTH;
    d.height = HEIGHT;
    if (set_create(&d, &s, &why))
        fail_msg("%s", why.text);
    return s;
}

/* Of a view that is moved, as by --position and --fov. */
static void a_coarse_view_of_glass_becomes_complete(void **state)
{
    (void)state;
    const struct view_change moved = { .has_position = true, .position = { 1.5f, 2.0f, 3.0f }, .fov_y = 0.5f };
    const struct prepared_scene_desc desc = { .scene = RING, .change = moved, .width = WIDTH, .height = HEIGHT };
    struct prepared_scene_desc soon = desc;
    struct prepared_scene *coarse, *complete = NULL, *want = first_of(desc);
    struct progress line;
    struct reason why = { "" };

    soon.soon = true;
    coarse = first_of(soon);
    assert_true(coarse->coarse && coarse->gbuffer->edge_pixels == 0 && !want->coarse);
    progress_begin(&line, "view", HEIGHT, NULL);
    assert_int_equal(set_create_complete(coarse, &desc, &line, &complete, &why), ERR_OK);
    progress_end(&line);
    set_hand_over(coarse, complete);
    set_destroy(coarse);
    assert_false(complete->coarse || complete->borrowed);
    const struct gbuffer *a = complete->gbuffer, *b = want->gbuffer;
    assert_true(a->edge_pixels > 0 && a->packet_count == b->packet_count);
    assert_memory_equal(a->packets, b->packets, a->packet_count * sizeof(a->packets[0]));
    assert_string_equal(complete->placed, want->placed);
    assert_string_equal(complete->file, want->file);
    assert_non_null(scene_camera(complete->scene, NULL)); /* the scene is there */
    set_destroy(complete);
    set_destroy(want);
}

static void only_glass_makes_it_coarse(void **state)
{
    (void)state;
    struct prepared_scene *plain = first_of((struct prepared_scene_desc){ .soon = true });
    struct prepared_scene *every =
        first_of((struct prepared_scene_desc){ .scene = RING, .soon = true, .every_pixel = true });

    assert_true(!plain->coarse && plain->gbuffer->edge_pixels > 0);
    assert_true(!every->coarse && every->gbuffer->edge_pixels > 0);
    set_destroy(plain);
    set_destroy(every);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_view_is_what_a_set_of_that_camera_has),
    cmocka_unit_test(an_unknown_camera_is_named),
    cmocka_unit_test(a_coarse_view_of_glass_becomes_complete),
    cmocka_unit_test(only_glass_makes_it_coarse),
};
UNIT_MAIN(tests)
