/* Going to another place of a source: seek, step, and the hours of a computed sky. */
#include "support/unit.h"

#include "sky/source/folder.h"
#include "sky/daylight/sky.h"
#include "sky/source/source.h"

#include <math.h>

static struct source *opened(const struct source_desc *desc)
{
    struct source *s = NULL;
    struct reason why = { "" };

    assert_int_equal(source_open(desc, &s, &why), ERR_OK);
    return s;
}

/* The next frame's number; its place must be the one that the source tells. */
static uint64_t next(struct source *s, struct frame *f, uint64_t place)
{
    struct reason why = { "" };

    assert_int_equal(source_next(s, f, &why), ERR_OK);
    assert_int_equal(source_position(s), place);
    return f->number;
}

static struct source *three_files(struct folder *folder, bool loop)
{
    folder_make(folder);
    folder_put(folder, "a.004.exr", "four");
    folder_put(folder, "a.007.exr", "seven");
    folder_put(folder, "a.009.exr", "nine");
    return opened(&(struct source_desc){ .spec = folder_path(folder, "a.%03d.exr"), .loop = loop });
}

static void a_place_counts_files_and_not_their_numbers(void **state)
{
    (void)state;
    struct folder folder;
    struct source *s = three_files(&folder, false);
    struct frame f = { .kind = FRAME_NONE };

    assert_int_equal(source_kind(s), SOURCE_FILES);
    assert_int_equal(next(s, &f, 0), 4);
    assert_true(source_seek(s, 2));
    assert_int_equal(next(s, &f, 2), 9);
    assert_false(source_seek(s, 3)); /* there is none, and what was to come next still is */
    assert_true(source_seek(s, 1));
    assert_int_equal(next(s, &f, 1), 7);
    assert_int_equal(next(s, &f, 2), 9);
    frame_finish(&f);
    source_close(s);
    folder_remove(&folder);
}

static void a_step_goes_on_from_the_frame_that_was_given(void **state)
{
    (void)state;
    struct folder folder;
    struct source *s = three_files(&folder, false);
    struct frame f = { .kind = FRAME_NONE };

    assert_int_equal(next(s, &f, 0), 4);
    assert_true(source_step(s, 1));
    assert_int_equal(next(s, &f, 1), 7);
    assert_true(source_step(s, -1));
    assert_int_equal(next(s, &f, 0), 4);
    assert_true(source_step(s, -1)); /* no further than the ends */
    assert_int_equal(next(s, &f, 0), 4);
    assert_true(source_step(s, 100));
    assert_int_equal(next(s, &f, 2), 9);
    frame_finish(&f);
    source_close(s);
    folder_remove(&folder);
}

static void a_step_goes_round_the_end_of_what_loops(void **state)
{
    (void)state;
    struct folder folder;
    struct source *s = three_files(&folder, true);
    struct frame f = { .kind = FRAME_NONE };

    assert_int_equal(next(s, &f, 0), 4);
    assert_true(source_step(s, -1));
    assert_int_equal(next(s, &f, 2), 9);
    assert_true(source_step(s, 1));
    assert_int_equal(next(s, &f, 0), 4);
    assert_true(source_step(s, -7));
    assert_int_equal(next(s, &f, 2), 9);
    frame_finish(&f);
    source_close(s);
    folder_remove(&folder);
}

/* Solar time of the last frame returned, which is frame `number` of the sky. */
static double hour_at(const struct source *s, uint64_t number)
{
    const struct sky_desc *sky = source_sky(s);
    return fmod(sky->hour + sky->speed_hours * (double)number, 24.0);
}

static void a_range_of_the_sky_has_its_places_from_0(void **state)
{
    (void)state;
    struct source *s =
        opened(&(struct source_desc){ .spec = "sky:size=32x16,speed=30,time=06:00", .frames = { true, 10, 12 } });
    struct frame f = { .kind = FRAME_NONE };
    struct reason why;

    assert_int_equal(next(s, &f, 0), 10);
    assert_true(fabs(hour_at(s, 10) - 11.0) < 1e-9);
    assert_true(source_seek(s, 2));
    assert_int_equal(next(s, &f, 2), 12);
    assert_int_equal(source_next(s, &f, &why), ERR_END);
    assert_true(source_step(s, -1)); /* from the end as well */
    assert_int_equal(next(s, &f, 1), 11);
    assert_false(source_seek(s, 3));
    frame_finish(&f);
    source_close(s);
}

static void an_hour_is_the_next_frames_and_the_numbers_go_on(void **state)
{
    (void)state;
    struct source *s = opened(&(struct source_desc){ .spec = "sky:size=32x16,speed=30,time=06:00" });
    struct source *other = opened(&(struct source_desc){ .spec = "sky:size=32x16,speed=30,time=20:30" });
    struct frame f = { .kind = FRAME_NONE }, g = { .kind = FRAME_NONE };

    next(s, &f, 0);
    next(s, &f, 1);
    assert_true(source_set_hour(s, 21.5));
    assert_int_equal(next(s, &f, 2), 2);
    assert_true(fabs(hour_at(s, 2) - 21.5) < 1e-9);
    /* The same day's, to the bit but for the rounding of an hour. */
    assert_true(source_seek(other, 2));
    next(other, &g, 2);
    for (size_t i = 0; i < (size_t)3 * f.width * f.height; i++)
        assert_true(fabsf(f.rgb[i] - g.rgb[i]) <= 1e-5f * fabsf(g.rgb[i]));
    next(s, &f, 3);
    assert_true(fabs(hour_at(s, 3) - 22.0) < 1e-9);
    for (int i = 0; i < 10; i++) /* past midnight */
        next(s, &f, (uint64_t)(4 + i));
    assert_true(fabs(hour_at(s, 13) - 3.0) < 1e-9);
    assert_true(source_set_hour(s, 1.0));
    next(s, &f, 14);
    assert_true(fabs(hour_at(s, 14) - 1.0) < 1e-9);
    assert_true(source_sky(s)->hour + 0.5 * 14 > 24.0); /* of the second day, not the first */
    frame_finish(&f);
    frame_finish(&g);
    source_close(s);
    source_close(other);
}

static void files_have_no_hours_and_folders_no_places(void **state)
{
    (void)state;
    struct folder folder;
    struct source *files = three_files(&folder, false);
    char spec[1100];

    snprintf(spec, sizeof(spec), "watch:%s", folder.path);
    struct source *watched = opened(&(struct source_desc){ .spec = spec });
    assert_false(source_set_hour(files, 12.0));
    assert_null(source_sky(files));
    assert_false(source_seek(watched, 0));
    assert_false(source_step(watched, 1));
    source_close(watched);
    source_close(files);
    folder_remove(&folder);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_place_counts_files_and_not_their_numbers),
    cmocka_unit_test(a_step_goes_on_from_the_frame_that_was_given),
    cmocka_unit_test(a_step_goes_round_the_end_of_what_loops),
    cmocka_unit_test(a_range_of_the_sky_has_its_places_from_0),
    cmocka_unit_test(an_hour_is_the_next_frames_and_the_numbers_go_on),
    cmocka_unit_test(files_have_no_hours_and_folders_no_places),
};
UNIT_MAIN(tests)
