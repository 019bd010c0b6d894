#include "support/unit.h"

#include "sky/source/folder.h"
#include "sky/source/source.h"

static struct source *watch(struct folder *f, const struct source_desc *more)
{
    struct source_desc d = more ? *more : (struct source_desc){ .spec = NULL };
    struct source *s = NULL;
    struct reason why = { "" };
    char spec[128];

    snprintf(spec, sizeof(spec), "watch:%s", f->path);
    d.spec = spec;
    assert_int_equal(source_open(&d, &s, &why), ERR_OK);
    return s;
}

/* The next file is this one; NULL: nothing comes. */
static void expect(struct source *s, struct frame *frame, const char *name, const char *text)
{
    struct reason why = { "" };

    assert_int_equal(source_next(s, frame, &why), ERR_OK);
    if (!name) {
        assert_int_equal(frame->kind, FRAME_NONE);
        return;
    }
    assert_int_equal(frame->kind, FRAME_FILE);
    const size_t n = strlen(frame->name);
    assert_true(n > strlen(name));
    assert_string_equal(frame->name + n - strlen(name), name);
    assert_int_equal(frame->size, strlen(text));
    assert_memory_equal(frame->bytes, text, strlen(text));
}

static void files_already_there_come_first_in_order(void **state)
{
    struct folder f;
    struct frame frame = { .kind = FRAME_NONE };

    (void)state;
    folder_make(&f);
    folder_put(&f, "b.exr", "b");
    folder_put(&f, "c10.hdr", "c");
    folder_put(&f, "c9.exr", "a");
    struct source *s = watch(&f, NULL);
    assert_int_equal(source_count(s), 0);
    folder_put(&f, "0.exr", "new");
    expect(s, &frame, "/b.exr", "b");
    assert_int_equal(frame.number, 0);
    expect(s, &frame, "/c9.exr", "a");
    expect(s, &frame, "/c10.hdr", "c");
    expect(s, &frame, "/0.exr", "new");
    assert_int_equal(frame.number, 3);
    expect(s, &frame, NULL, NULL);
    source_close(s);
    frame_finish(&frame);
    folder_remove(&f);
}

static void half_written_file_is_not_read(void **state)
{
    struct folder f;
    struct frame frame = { .kind = FRAME_NONE };

    (void)state;
    folder_make(&f);
    struct source *s = watch(&f, NULL);
    FILE *out = fopen(folder_path(&f, "a.exr"), "wb");
    assert_non_null(out);
    fputs("first half, ", out);
    assert_int_equal(fflush(out), 0);
    expect(s, &frame, NULL, NULL);
    fputs("second half", out);
    assert_int_equal(fclose(out), 0);
    expect(s, &frame, "/a.exr", "first half, second half");
    source_close(s);
    frame_finish(&frame);
    folder_remove(&f);
}

static void file_moved_in_arrives_and_hidden_names_do_not(void **state)
{
    struct folder f;
    struct frame frame = { .kind = FRAME_NONE };

    (void)state;
    folder_make(&f);
    struct source *s = watch(&f, NULL);
    folder_put(&f, ".a.exr", "whole");
    folder_put(&f, "a.exr.part", "whole too");
    folder_put(&f, "readme.txt", "no frame");
    expect(s, &frame, NULL, NULL);
    assert_int_equal(rename(folder_path(&f, ".a.exr"), folder_path(&f, "a.exr")), 0);
    assert_int_equal(rename(folder_path(&f, "a.exr.part"), folder_path(&f, "b.exr")), 0);
    expect(s, &frame, "/a.exr", "whole");
    assert_int_equal(frame.number, 0);
    expect(s, &frame, "/b.exr", "whole too");
    assert_int_equal(frame.number, 1);
    source_close(s);
    frame_finish(&frame);
    folder_remove(&f);
}

static void file_written_twice_before_its_turn_comes_once(void **state)
{
    struct folder f;
    struct frame frame = { .kind = FRAME_NONE };

    (void)state;
    folder_make(&f);
    folder_put(&f, "a.exr", "old");
    struct source *s = watch(&f, NULL);
    folder_put(&f, "a.exr", "new");
    folder_put(&f, "b.exr", "first");
    folder_put(&f, "b.exr", "second");
    expect(s, &frame, "/a.exr", "new");
    expect(s, &frame, "/b.exr", "second");
    expect(s, &frame, NULL, NULL);
    folder_put(&f, "a.exr", "again"); /* after its turn it is a new frame */
    expect(s, &frame, "/a.exr", "again");
    assert_int_equal(frame.number, 2);
    source_close(s);
    frame_finish(&frame);
    folder_remove(&f);
}

static void file_that_vanished_is_named_and_passed_over(void **state)
{
    struct folder f;
    struct frame frame = { .kind = FRAME_NONE };
    struct reason why;

    (void)state;
    folder_make(&f);
    struct source *s = watch(&f, NULL);
    folder_put(&f, "a.exr", "a");
    assert_int_equal(unlink(folder_path(&f, "a.exr")), 0);
    folder_put(&f, "b.exr", "b");
    assert_int_equal(source_next(s, &frame, &why), ERR_IO);
    assert_non_null(strstr(why.text, "a.exr"));
    expect(s, &frame, "/b.exr", "b");
    source_close(s);
    frame_finish(&frame);
    folder_remove(&f);
}

static void range_begins_and_ends_the_watch(void **state)
{
    struct folder f;
    struct frame frame = { .kind = FRAME_NONE };
    struct reason why;

    (void)state;
    folder_make(&f);
    folder_put(&f, "a.exr", "a");
    folder_put(&f, "b.exr", "b");
    folder_put(&f, "c.exr", "c");
    struct source *s = watch(&f, &(struct source_desc){ .frames = { true, 1, 1 } });
    expect(s, &frame, NULL, NULL); /* number 0 is passed over */
    expect(s, &frame, "/b.exr", "b");
    assert_int_equal(source_next(s, &frame, &why), ERR_END);
    assert_int_equal(frame.kind, FRAME_FILE); /* as it was */
    source_close(s);
    frame_finish(&frame);
    folder_remove(&f);
}

static void file_was_captured_when_it_was_last_written(void **state)
{
    static const struct timespec times[2] = { { 1000000000, 0 }, { 1234567890, 123456789 } };
    struct folder f;
    struct frame frame = { .kind = FRAME_NONE };

    (void)state;
    folder_make(&f);
    folder_put(&f, "a.exr", "a");
    assert_int_equal(utimensat(AT_FDCWD, folder_path(&f, "a.exr"), times, 0), 0);
    struct source *s = watch(&f, NULL);
    expect(s, &frame, "/a.exr", "a");
    assert_true(frame.capture_us == INT64_C(1234567890123456));
    source_close(s);
    frame_finish(&frame);
    folder_remove(&f);
}

static void removed_folder_ends_the_watch_after_what_came(void **state)
{
    struct folder f;
    struct frame frame = { .kind = FRAME_NONE };
    struct reason why;

    (void)state;
    folder_make(&f);
    struct source *s = watch(&f, NULL);
    expect(s, &frame, NULL, NULL);
    folder_remove(&f);
    assert_int_equal(source_next(s, &frame, &why), ERR_END);
    assert_int_equal(source_next(s, &frame, &why), ERR_END);
    assert_non_null(strstr(why.text, f.path));
    source_close(s);
    frame_finish(&frame);
}

static void first_of_an_empty_folder_is_an_error_and_no_wait(void **state)
{
    struct folder f;
    char spec[128];
    struct frame frame = { 0 };
    struct reason why = { "" };
    (void)state;

    folder_make(&f);
    snprintf(spec, sizeof(spec), "watch:%s", f.path);
    assert_int_equal(source_first(&(struct source_desc){ .spec = spec }, &frame, &why), ERR_IO);
    assert_non_null(strstr(why.text, "contains no frame"));
    assert_int_equal(source_first(&(struct source_desc){ .spec = "sky:size=16x8" }, &frame, &why), ERR_OK);
    assert_int_equal(frame.kind == FRAME_NONE, false);
    frame_finish(&frame);
    folder_remove(&f);
}

static void folder_must_be_there(void **state)
{
    struct folder f;
    struct source *s = NULL;
    struct reason why;
    char spec[128];

    (void)state;
    folder_make(&f);
    folder_put(&f, "a.exr", "a");
    snprintf(spec, sizeof(spec), "watch:%s/none", f.path);
    assert_int_equal(source_open(&(struct source_desc){ .spec = spec }, &s, &why), ERR_IO);
    assert_non_null(strstr(why.text, "/none"));
    snprintf(spec, sizeof(spec), "watch:%s/a.exr", f.path);
    assert_int_equal(source_open(&(struct source_desc){ .spec = spec }, &s, &why), ERR_IO);
    assert_int_equal(source_open(&(struct source_desc){ .spec = "watch:" }, &s, &why), ERR_USAGE);
    assert_null(s);
    folder_remove(&f);
}

/* Waits for the file; the test's own limit ends a wait for ever. */
static void await(struct source *s, struct frame *frame, const char *name, const char *text)
{
    struct reason why = { "" };

    do {
        assert_int_equal(source_next(s, frame, &why), ERR_OK);
    } while (frame->kind == FRAME_NONE);
    const size_t n = strlen(frame->name);
    assert_string_equal(frame->name + n - strlen(name), name);
    assert_int_equal(frame->size, strlen(text));
    assert_memory_equal(frame->bytes, text, strlen(text));
}

static void links_arrive_when_they_are_made(void **state)
{
    struct folder f, other;
    struct frame frame = { .kind = FRAME_NONE };

    (void)state;
    folder_make(&f);
    folder_make(&other);
    folder_put(&other, "one", "by a hard link");
    folder_put(&other, "two", "by a symbolic link");
    struct source *s = watch(&f, NULL);
    assert_int_equal(link(folder_path(&other, "one"), folder_path(&f, "a.exr")), 0);
    expect(s, &frame, "/a.exr", "by a hard link");
    assert_int_equal(symlink(folder_path(&other, "two"), folder_path(&f, "b.exr")), 0);
    expect(s, &frame, "/b.exr", "by a symbolic link");
    source_close(s);
    frame_finish(&frame);
    folder_remove(&f);
    folder_remove(&other);
}

/* As on a network share, where others' writes raise no event: the files are written by names in another folder. */
static void files_without_events_arrive_by_listing_and_once(void **state)
{
    struct folder f, other;
    struct frame frame = { .kind = FRAME_NONE };

    (void)state;
    folder_make(&f);
    folder_make(&other);
    folder_put(&other, "one", "1");
    folder_put(&other, "two", "2");
    assert_int_equal(link(folder_path(&other, "one"), folder_path(&f, "a.exr")), 0);
    assert_int_equal(symlink(folder_path(&other, "two"), folder_path(&f, "b.exr")), 0);
    struct source *s = watch(&f, NULL);
    expect(s, &frame, "/a.exr", "1");
    expect(s, &frame, "/b.exr", "2");
    folder_put(&other, "two", "two again");
    await(s, &frame, "/b.exr", "two again");
    folder_put(&other, "one", "one again");
    await(s, &frame, "/a.exr", "one again");
    folder_put(&f, "c.exr", "by an event"); /* which listings leave alone */
    await(s, &frame, "/c.exr", "by an event");
    folder_put(&other, "one", "the last");
    await(s, &frame, "/a.exr", "the last");
    assert_int_equal(frame.number, 5);
    source_close(s);
    frame_finish(&frame);
    folder_remove(&f);
    folder_remove(&other);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(links_arrive_when_they_are_made),
    cmocka_unit_test(files_without_events_arrive_by_listing_and_once),
    cmocka_unit_test(files_already_there_come_first_in_order),
    cmocka_unit_test(half_written_file_is_not_read),
    cmocka_unit_test(file_moved_in_arrives_and_hidden_names_do_not),
    cmocka_unit_test(file_written_twice_before_its_turn_comes_once),
    cmocka_unit_test(file_that_vanished_is_named_and_passed_over),
    cmocka_unit_test(range_begins_and_ends_the_watch),
    cmocka_unit_test(file_was_captured_when_it_was_last_written),
    cmocka_unit_test(removed_folder_ends_the_watch_after_what_came),
    cmocka_unit_test(first_of_an_empty_folder_is_an_error_and_no_wait),
    cmocka_unit_test(folder_must_be_there),
};

UNIT_MAIN(tests)
