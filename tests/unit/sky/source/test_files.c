#include "support/unit.h"

#include "sky/source/files.h"
#include "sky/source/folder.h"
#include "sky/source/source.h"

#include <inttypes.h>

/* What a source gives from first to last, as "number=text number=text", where text is the file's contents. */
static const char *walk(const struct source_desc *desc, size_t most)
{
    static char said[4096];
    struct source *s = NULL;
    struct reason why = { "" };
    struct frame f = { .kind = FRAME_NONE };
    size_t at = 0;

    said[0] = '\0';
    assert_int_equal(source_open(desc, &s, &why), ERR_OK);
    for (size_t i = 0; i < most; i++) {
        const enum err e = source_next(s, &f, &why);
        if (e == ERR_END)
            break;
        const char *space = at ? " " : "";
        if (e)
            at += (size_t)snprintf(said + at, sizeof(said) - at, "%s!%s", space, err_text(e));
        else
            at += (size_t)snprintf(said + at, sizeof(said) - at, "%s%" PRIu64 "=%.*s", space, f.number, (int)f.size,
                                   (const char *)f.bytes);
        assert_true(at < sizeof(said));
        assert_int_equal(f.kind, e ? FRAME_NONE : FRAME_FILE);
    }
    frame_finish(&f);
    source_close(s);
    return said;
}

static const char *walk_spec(const char *spec)
{
    return walk(&(struct source_desc){ .spec = spec }, 100);
}

static enum err refuse(const char *spec, struct reason *why)
{
    struct source *s = NULL;
    const enum err e = source_open(&(struct source_desc){ .spec = spec }, &s, why);

    assert_null(s);
    assert_non_null(strstr(why->text, spec)); /* every message names the spec */
    assert_null(strchr(why->text, '\n'));
    return e;
}

/* A file with a hole takes no disk; it must not take memory either. */
static void a_hole_is_not_read(void **state)
{
    static const struct {
        const char *head;
        size_t size;
        enum err wanted; /* ERR_OK: its size may be what its header says */
    } rows[] = { { "", 0, ERR_FORMAT },
                 { "GIF89a", 6, ERR_UNSUPPORTED },
                 { "#?RADIANCE\n", 11, ERR_FORMAT },
                 { "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 64 +X 128\n", 49, ERR_FORMAT },
                 { "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4096 +X 8192\n", 52, ERR_OK },
                 { "\x76\x2f\x31\x01\x02\0\0\0", 8, ERR_FORMAT },
                 { "\xff\xd8\xff\xc0\0\x11\x08\0\x40\0\x80\x03\x01", 13, ERR_FORMAT },
                 { "\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x80\0\0\0\x40\x08\x02", 26, ERR_FORMAT } };
    struct frame frame = { .kind = FRAME_NONE };
    struct reason why = { "" };
    struct folder f;
    (void)state;

    folder_make(&f);
    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        const char *path = folder_path(&f, "hole.hdr");
        const int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC, 0600);
        assert_int_equal(write(fd, rows[i].head, rows[i].size), rows[i].size);
        assert_int_equal(ftruncate(fd, (off_t)200 << 20), 0);
        close(fd);
        const struct file_item item = { .path = (char *)(uintptr_t)path };
        const enum err e = files_read(&item, &frame, &why);
        if (e != rows[i].wanted)
            fail_msg("row %zu: %s (%s)", i, err_text(e), why.text);
    }
    frame_finish(&frame);
    folder_remove(&f);
}

/* {face} stands for six names, in the order of frame.h; numbers go on as ever. */
static void faces_come_as_six_files_in_one_frame(void **state)
{
    static const char *const names[] = { "posx", "negx", "posy", "negy", "posz", "negz" };
    char spec[4200], name[64];
    struct folder f;
    struct source *s;
    struct reason why;
    struct frame frame = { .kind = FRAME_NONE };

    (void)state;
    folder_make(&f);
    for (int k = 0; k < 12; k++) {
        snprintf(name, sizeof(name), "s.%d.%s.hdr", 3 + k / 6, names[k % 6]);
        folder_put(&f, name, names[k % 6] + (k < 6 ? 0 : 3));
    }
    snprintf(spec, sizeof(spec), "%s/s.%%d.{face}.hdr", f.path);
    assert_string_equal(walk_spec(spec), "3=posxnegxposynegyposznegz 4=xxyyzz");
    assert_int_equal(source_open(&(struct source_desc){ .spec = spec }, &s, &why), ERR_OK);
    assert_int_equal(source_next(s, &frame, &why), ERR_OK);
    for (int k = 0; k < 6; k++)
        assert_int_equal(frame.faces[k], 4);
    source_close(s);
    frame_finish(&frame);
    assert_int_equal(remove(folder_path(&f, "s.4.negy.hdr")), 0);
    assert_string_equal(walk_spec(spec), "3=posxnegxposynegyposznegz !input or output failed");
    snprintf(spec, sizeof(spec), "%s/{face}.%%d.hdr", f.path);
    assert_int_equal(refuse(spec, &why), ERR_USAGE);
    snprintf(spec, sizeof(spec), "%s/{face}.hdr", f.path);
    assert_int_equal(refuse(spec, &why), ERR_IO);
    folder_remove(&f);
}

static void pattern_walks_the_numbers_that_exist_in_order(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_put(&f, "s.0010.exr", "ten");
    folder_put(&f, "s.0003.exr", "three");
    folder_put(&f, "s.12345.exr", "many");
    folder_put(&f, "s.0001.exr", "one");
    folder_put(&f, "s.2.exr", "not as printed");
    folder_put(&f, "s.00003.exr", "not as printed");
    folder_put(&f, "s.-001.exr", "not a frame");
    folder_put(&f, "s.0004.exr.tmp", "not a frame");
    folder_put(&f, "s.99999999999999999999.exr", "beyond 64 bits");
    assert_string_equal(walk_spec(folder_path(&f, "s.%04d.exr")), "1=one 3=three 10=ten 12345=many");
    assert_string_equal(walk_spec(folder_path(&f, "s.%d.exr")), "2=not as printed 12345=many");
    folder_remove(&f);
}

static void pattern_knows_the_conversions_of_whole_numbers(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_put(&f, "a7", "seven");
    folder_put(&f, "a  8", "eight");
    folder_put(&f, "15", "tail");
    assert_string_equal(walk_spec(folder_path(&f, "a%u")), "7=seven");
    assert_string_equal(walk_spec(folder_path(&f, "a%i")), "7=seven");
    assert_string_equal(walk_spec(folder_path(&f, "a%3d")), "8=eight");
    assert_string_equal(walk_spec(folder_path(&f, "%d5")), "1=tail"); /* digits behind the number are not its own */
    folder_remove(&f);
}

static void pattern_takes_every_other_percent_sign_literally(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_put(&f, "100%s%n_%%_4.exr", "four");
    assert_string_equal(walk_spec(folder_path(&f, "100%s%n_%%_%d.exr")), "4=four");
    folder_remove(&f);
}

static void pattern_must_hold_one_number_in_the_name(void **state)
{
    struct reason why;

    (void)state;
    assert_int_equal(refuse("/tmp/a%d-%04d.exr", &why), ERR_USAGE);
    assert_int_equal(refuse("/tmp/x%d/a.exr", &why), ERR_USAGE);
    assert_non_null(strstr(why.text, "folder"));
}

static void range_cuts_what_is_walked(void **state)
{
    struct folder f;
    struct source *s = NULL;
    struct reason why;

    (void)state;
    folder_make(&f);
    for (int i = 0; i < 5; i++) {
        char name[16], text[16];
        snprintf(name, sizeof(name), "s%d.exr", 10 * i);
        snprintf(text, sizeof(text), "t%d", i);
        folder_put(&f, name, text);
    }
    struct source_desc d = { .spec = folder_path(&f, "s%d.exr"), .frames = { true, 5, 30 } };
    assert_string_equal(walk(&d, 100), "10=t1 20=t2 30=t3");
    assert_int_equal(source_open(&d, &s, &why), ERR_OK);
    assert_int_equal(source_count(s), 3);
    source_close(s);
    d.spec = f.path; /* a folder counts from 0, before the range is applied */
    d.frames.first = 3;
    assert_string_equal(walk(&d, 100), "3=t3 4=t4");
    d.frames.first = 7;
    d.frames.last = 8;
    assert_int_equal(source_open(&d, &s, &why), ERR_USAGE);
    assert_non_null(strstr(why.text, "0 to 4")); /* says what there is */
    d.frames.last = 6;
    assert_int_equal(source_open(&d, &s, &why), ERR_USAGE);
    folder_remove(&f);
}

static void folder_gives_its_frames_in_natural_order(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_put(&f, "b.EXR", "b");
    folder_put(&f, "a.hdr", "a");
    folder_put(&f, "B.exr", "B");
    folder_put(&f, "a10.Hdr", "a10");
    folder_put(&f, "a9.exr", "a9");
    folder_put(&f, "c.exr.part", "no frame");
    folder_put(&f, "notes.txt", "no frame");
    folder_put(&f, ".hidden.exr", "no frame");
    folder_put(&f, ".exr", "no frame");
    assert_int_equal(mkdir(folder_path(&f, "d.exr"), 0700), 0);
    assert_string_equal(walk_spec(f.path), "0=B 1=a 2=a9 3=a10 4=b");
    folder_remove(&f);
}

static void glob_gives_its_matches_in_natural_order(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_put(&f, "b1.exr", "b1");
    folder_put(&f, "a10.exr", "a10");
    folder_put(&f, "a2.exr", "a2");
    folder_put(&f, "B3.exr", "B3");
    folder_put(&f, "c.exr", "c");
    assert_string_equal(walk_spec(folder_path(&f, "*[0-9].exr")), "0=B3 1=a2 2=a10 3=b1");
    folder_remove(&f);
}

/* Each row is before all that follow it. */
static void names_compare_by_their_numbers(void **state)
{
    /* clang-format off */
    static const char *const names[] = {
        "", "!1", "-5", "0", "00", "01", "1", "001a", "1a", "02", "2", "2.09", "2.10", "9", "10",
        "18446744073709551615", "18446744073709551616", ":", "A1", "a 1", "a1", "a01b", "a1b9", "a1b10", "a2",
        "a10", "b", "\xe4",
    };
    /* clang-format on */

    (void)state;
    for (size_t i = 0; i < sizeof(names) / sizeof(names[0]); i++)
        for (size_t k = 0; k < sizeof(names) / sizeof(names[0]); k++) {
            const int got = files_compare(names[i], names[k]);
            if ((got > 0) - (got < 0) != (i > k) - (i < k))
                fail_msg("'%s' and '%s': %d", names[i], names[k], got);
        }
}

static void name_that_exists_is_that_file(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_put(&f, "a%d.exr", "itself");
    folder_put(&f, "a1.exr", "another");
    folder_put(&f, "[a]1.exr", "brackets");
    assert_string_equal(walk_spec(folder_path(&f, "a%d.exr")), "0=itself");
    assert_string_equal(walk_spec(folder_path(&f, "[a]1.exr")), "0=brackets");
    folder_remove(&f);
}

static void single_file_is_number_0_whatever_its_name(void **state)
{
    static const char *const names[] = { "dawn_1k.hdr", "sky.0012.exr", "plain.exr" };
    struct folder f;
    struct source *s = NULL;
    struct reason why;

    (void)state;
    folder_make(&f);
    for (size_t i = 0; i < sizeof(names) / sizeof(names[0]); i++) {
        folder_put(&f, names[i], "x");
        const char *spec = folder_path(&f, names[i]);
        assert_string_equal(walk_spec(spec), "0=x");
        assert_string_equal(walk(&(struct source_desc){ .spec = spec, .frames = { true, 0, 0 } }, 9),
                            "0=x"); /* --frames 0 */
        const struct source_desc other = { .spec = spec, .frames = { true, 1, 12 } };
        assert_int_equal(source_open(&other, &s, &why), ERR_USAGE);
    }
    folder_remove(&f);
}

static void nothing_there_is_said_when_it_is_opened(void **state)
{
    struct folder f;
    struct reason why;

    (void)state;
    folder_make(&f);
    folder_put(&f, "notes.txt", "x");
    assert_int_equal(refuse(f.path, &why), ERR_IO);
    assert_int_equal(refuse(folder_path(&f, "s.%04d.exr"), &why), ERR_IO);
    assert_int_equal(refuse(folder_path(&f, "*.exr"), &why), ERR_IO);
    assert_int_equal(refuse(folder_path(&f, "none.exr"), &why), ERR_IO);
    assert_non_null(strstr(why.text, "No such file"));
    struct source *s = NULL;
    const struct source_desc d = { .spec = folder_path(&f, "none/s.%04d.exr") };
    assert_int_equal(source_open(&d, &s, &why), ERR_IO);
    assert_non_null(strstr(why.text, "/none/: cannot open as a folder"));
    assert_int_equal(refuse("", &why), ERR_USAGE);
    assert_int_equal(refuse("push:", &why), ERR_USAGE);
    assert_non_null(strstr(why.text, "relightd"));
    assert_null(strstr(why.text, "::"));
    folder_remove(&f);
}

static void file_is_read_whole_and_its_age_says_nothing_of_the_light(void **state)
{
    struct folder f;
    struct source *s = NULL;
    struct reason why;
    struct frame frame = { .kind = FRAME_NONE };
    static char text[100001];

    (void)state;
    for (size_t i = 0; i < sizeof(text) - 1; i++)
        text[i] = (char)('a' + (i * i) % 23);
    folder_make(&f);
    folder_put(&f, "a.exr", text);
    frame.capture_us = 5; /* of a frame before */
    assert_int_equal(source_open(&(struct source_desc){ .spec = folder_path(&f, "a.exr") }, &s, &why), ERR_OK);
    assert_int_equal(source_count(s), 1);
    assert_int_equal(source_next(s, &frame, &why), ERR_OK);
    assert_int_equal(frame.size, sizeof(text) - 1);
    assert_memory_equal(frame.bytes, text, sizeof(text) - 1);
    assert_string_equal(frame.name, folder_path(&f, "a.exr"));
    assert_true(frame.capture_us == 0);
    memcpy(frame.layout, "cross", 6);
    assert_int_equal(source_next(s, &frame, &why), ERR_END); /* which leaves the frame as it was */
    assert_int_equal(frame.kind, FRAME_FILE);
    assert_string_equal(frame.layout, "cross");
    assert_memory_equal(frame.bytes, text, sizeof(text) - 1);
    frame_finish(&frame);
    source_close(s);
    folder_remove(&f);
}

static void file_that_cannot_be_read_is_named_and_passed_over(void **state)
{
    struct folder f;
    struct source *s = NULL;
    struct reason why;
    struct frame frame = { .kind = FRAME_NONE };

    (void)state;
    folder_make(&f);
    folder_put(&f, "1.exr", "one");
    folder_put(&f, "2.exr", "");
    folder_put(&f, "3.exr", "gone");
    folder_put(&f, "4.exr", "huge");
    folder_put(&f, "5.exr", "five");
    assert_int_equal(truncate(folder_path(&f, "4.exr"), ((off_t)1 << 30) + 1), 0); /* a hole: takes no room */
    assert_int_equal(source_open(&(struct source_desc){ .spec = f.path }, &s, &why), ERR_OK);
    assert_int_equal(unlink(folder_path(&f, "3.exr")), 0);
    assert_int_equal(source_next(s, &frame, &why), ERR_OK);
    assert_int_equal(source_next(s, &frame, &why), ERR_IO);
    assert_non_null(strstr(why.text, "2.exr: is empty"));
    assert_int_equal(source_next(s, &frame, &why), ERR_IO);
    assert_non_null(strstr(why.text, "3.exr"));
    assert_int_equal(source_next(s, &frame, &why), ERR_RANGE);
    assert_non_null(strstr(why.text, "4.exr"));
    assert_int_equal(frame.kind, FRAME_NONE);
    assert_int_equal(source_next(s, &frame, &why), ERR_OK);
    assert_int_equal(frame.number, 4);
    assert_memory_equal(frame.bytes, "five", 4);
    frame_finish(&frame);
    source_close(s);
    folder_remove(&f);
}

static void fifo_is_refused_without_waiting(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    assert_int_equal(mkfifo(folder_path(&f, "a.exr"), 0600), 0);
    assert_string_equal(walk_spec(folder_path(&f, "a.exr")), "!input or output failed");
    folder_remove(&f);
}

static void loop_begins_again_with_the_same_numbers(void **state)
{
    struct folder f;

    (void)state;
    folder_make(&f);
    folder_put(&f, "s5.exr", "a");
    folder_put(&f, "s8.exr", "b");
    assert_string_equal(walk(&(struct source_desc){ .spec = folder_path(&f, "s%d.exr"), .loop = true }, 5),
                        "5=a 8=b 5=a 8=b 5=a");
    folder_remove(&f);
}

static void frame_keeps_the_larger_block(void **state)
{
    struct frame f = { .kind = FRAME_NONE };

    (void)state;
    assert_int_equal(frame_reserve_bytes(&f, 1000), ERR_OK);
    const uint8_t *block = f.bytes;
    assert_int_equal(frame_reserve_bytes(&f, 10), ERR_OK);
    assert_ptr_equal(f.bytes, block);
    assert_int_equal(f.size, 10);
    assert_int_equal(frame_reserve_texels(&f, 8, 4), ERR_OK);
    assert_int_equal(f.kind, FRAME_TEXELS);
    f.rgb[8 * 4 * 3 - 1] = 1.0f; /* the last one is there */
    const float *texels = f.rgb;
    assert_int_equal(frame_reserve_texels(&f, 4, 2), ERR_OK);
    assert_ptr_equal(f.rgb, texels);
    assert_int_equal(f.width, 4);
    frame_finish(&f);
    assert_null(f.bytes);
    frame_finish(&f);
    frame_finish(NULL);
}

static void frame_gives_a_block_back_that_is_far_too_large_for_the_last_eight(void **state)
{
    struct frame f = { .kind = FRAME_NONE };

    (void)state;
    assert_int_equal(frame_reserve_bytes(&f, (size_t)20 << 20), ERR_OK);
    assert_int_equal(frame_reserve_texels(&f, 2048, 1024), ERR_OK);
    for (int i = 0; i < RECENT_FRAMES; i++) {
        assert_int_equal(f.bytes_capacity, (size_t)20 << 20);
        assert_int_equal(f.rgb_capacity, 3 * 2048 * 1024);
        assert_int_equal(frame_reserve_bytes(&f, 100), ERR_OK);
        assert_int_equal(frame_reserve_texels(&f, 4, 2), ERR_OK);
    }
    assert_int_equal(f.bytes_capacity, 100);
    assert_int_equal(f.rgb_capacity, 3 * 4 * 2);
    frame_finish(&f);
}

static void frame_too_large_for_memory_is_an_error(void **state)
{
    struct frame f = { .kind = FRAME_NONE };

    (void)state;
    assert_int_equal(frame_reserve_texels(&f, UINT32_MAX, UINT32_MAX), ERR_NOMEM);
    assert_int_equal(f.kind, FRAME_NONE);
    assert_int_equal(frame_reserve_texels(&f, 2863311531u, 2147483648u), ERR_NOMEM); /* times 3 it is 2^64 + 2^31 */
    assert_int_equal(frame_reserve_bytes(&f, SIZE_MAX - 8), ERR_NOMEM);
    assert_int_equal(f.kind, FRAME_NONE);
    assert_int_equal(frame_reserve_bytes(&f, 4), ERR_OK); /* and it can be used afterwards */
    frame_finish(&f);
}

static void long_path_keeps_its_end_as_a_name(void **state)
{
    struct folder f;
    struct source *s = NULL;
    struct reason why;
    struct frame frame = { .kind = FRAME_NONE };
    char spec[512];

    (void)state;
    folder_make(&f);
    folder_put(&f, "end12.exr", "x");
    snprintf(spec, sizeof(spec), "%s", f.path);
    while (strlen(spec) < 400)
        strcat(spec, "/.");
    strcat(spec, "/end12.exr");
    assert_int_equal(source_open(&(struct source_desc){ .spec = spec }, &s, &why), ERR_OK);
    assert_int_equal(source_next(s, &frame, &why), ERR_OK);
    assert_int_equal(frame.number, 0);
    assert_int_equal(strlen(frame.name), sizeof(frame.name) - 1);
    assert_string_equal(frame.name + strlen(frame.name) - 9, "end12.exr");
    frame_finish(&frame);
    source_close(s);
    folder_remove(&f);
}

static void real_sequence_has_its_67_frames(void **state)
{
    struct source *s = NULL;
    struct reason why;
    struct frame frame = { .kind = FRAME_NONE };

    (void)state;
    assert_int_equal(source_open(&(struct source_desc){ .spec = unit_data("sky/sky.%04d.exr") }, &s, &why), ERR_OK);
    assert_int_equal(source_count(s), 67);
    for (uint64_t i = 0; i < 67; i++) {
        assert_int_equal(source_next(s, &frame, &why), ERR_OK);
        assert_int_equal(frame.number, i);
        assert_true(frame.size > 4);
        assert_memory_equal(frame.bytes, "\x76\x2f\x31\x01", 4); /* every EXR begins with it */
    }
    assert_int_equal(source_next(s, &frame, &why), ERR_END);
    frame_finish(&frame);
    source_close(s);
}

/* One map that turns is as many frames as are asked for; several are what they are. */
static void a_map_that_turns_is_every_frame(void **state)
{
    struct folder f;
    struct frame frame = { .kind = FRAME_NONE };
    struct reason why = { "" };
    struct source *s = NULL;
    (void)state;

    folder_make(&f);
    folder_put(&f, "sky.1.exr", "x");
    struct source_desc d = { .spec = folder_path(&f, "sky.1.exr"), .turn = 100.0, .frames = { true, 2, 4 } };
    assert_string_equal(walk(&d, 100), "2=x 3=x 4=x");
    assert_int_equal(source_open(&d, &s, &why), ERR_OK);
    assert_int_equal(source_count(s), 3);
    for (int n = 2; n <= 4; n++) {
        assert_int_equal(source_next(s, &frame, &why), ERR_OK);
        assert_true(frame.turn == (double)(100 * n % 360));
    }
    assert_int_equal(source_next(s, &frame, &why), ERR_END);
    assert_true(source_seek(s, 1));
    assert_int_equal(source_next(s, &frame, &why), ERR_OK);
    assert_int_equal(frame.number, 3);
    source_close(s);
    folder_put(&f, "sky.2.exr", "y");
    d.spec = folder_path(&f, "sky.%d.exr");
    d.frames.given = false;
    assert_string_equal(walk(&d, 100), "1=x 2=y");
    frame_finish(&frame);
    folder_remove(&f);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_map_that_turns_is_every_frame),
    cmocka_unit_test(faces_come_as_six_files_in_one_frame),
    cmocka_unit_test(a_hole_is_not_read),
    cmocka_unit_test(pattern_walks_the_numbers_that_exist_in_order),
    cmocka_unit_test(pattern_knows_the_conversions_of_whole_numbers),
    cmocka_unit_test(pattern_takes_every_other_percent_sign_literally),
    cmocka_unit_test(pattern_must_hold_one_number_in_the_name),
    cmocka_unit_test(range_cuts_what_is_walked),
    cmocka_unit_test(folder_gives_its_frames_in_natural_order),
    cmocka_unit_test(glob_gives_its_matches_in_natural_order),
    cmocka_unit_test(names_compare_by_their_numbers),
    cmocka_unit_test(name_that_exists_is_that_file),
    cmocka_unit_test(single_file_is_number_0_whatever_its_name),
    cmocka_unit_test(nothing_there_is_said_when_it_is_opened),
    cmocka_unit_test(file_is_read_whole_and_its_age_says_nothing_of_the_light),
    cmocka_unit_test(file_that_cannot_be_read_is_named_and_passed_over),
    cmocka_unit_test(fifo_is_refused_without_waiting),
    cmocka_unit_test(loop_begins_again_with_the_same_numbers),
    cmocka_unit_test(frame_keeps_the_larger_block),
    cmocka_unit_test(frame_gives_a_block_back_that_is_far_too_large_for_the_last_eight),
    cmocka_unit_test(frame_too_large_for_memory_is_an_error),
    cmocka_unit_test(long_path_keeps_its_end_as_a_name),
    cmocka_unit_test(real_sequence_has_its_67_frames),
};

UNIT_MAIN(tests)
