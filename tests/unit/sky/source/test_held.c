/* Several images from one frame to the next: numbers and places count images, and an image is the same in any order. */
#include "support/unit.h"

#include "sky/daylight/sky.h"
#include "sky/source/folder.h"
#include "sky/source/source.h"

#include <math.h>

enum { HOLD = 4 };

static struct source *opened(const char *spec, bool loop, enum between_mode mode)
{
    struct source *s = NULL;
    struct reason why = { "" };
    const struct source_desc desc = { .spec = spec, .loop = loop, .between = { .mode = mode, .hold = HOLD } };

    assert_int_equal(source_open(&desc, &s, &why), ERR_OK);
    return s;
}

/* A grey Radiance file of 8x4 texels. */
static void put_grey(struct folder *folder, const char *name, unsigned char mantissa)
{
    char text[512];
    const int head = snprintf(text, sizeof(text), "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n");

    for (int k = 0; k < 32; k++)
        memcpy(text + head + 4 * k, (unsigned char[4]){ mantissa, mantissa, mantissa, 129 }, 4);
    folder_put_bytes(folder, name, text, (size_t)head + 128);
}

static float grey_of(struct source *s, struct frame *f)
{
    struct reason why = { "" };

    assert_int_equal(source_next(s, f, &why), ERR_OK);
    assert_int_equal(f->kind, FRAME_TEXELS);
    return f->rgb[0];
}

static void images_count_from_the_first_to_the_last_frame(void **state)
{
    struct folder folder;
    struct frame f = { .kind = FRAME_NONE };
    struct reason why;
    (void)state;

    folder_make(&folder);
    put_grey(&folder, "a.3.hdr", 64);
    put_grey(&folder, "a.4.hdr", 128);
    put_grey(&folder, "a.10.hdr", 192);
    struct source *s = opened(folder_path(&folder, "a.%d.hdr"), false, BETWEEN_FADE);
    assert_int_equal(source_count(s), 2 * HOLD + 1);
    for (int k = 0; k <= 2 * HOLD; k++) {
        const float wanted = 2.0f * (64.0f + 64.0f * (float)k / HOLD) / 256.0f;
        const float grey = grey_of(s, &f);
        assert_true(fabsf(grey / wanted - 1.0f) < 1e-2f);
        assert_int_equal(f.number, 3 * HOLD + k);
        assert_int_equal(source_position(s), k);
    }
    assert_int_equal(source_next(s, &f, &why), ERR_END);
    assert_true(source_seek(s, 5));
    assert_true(fabsf(grey_of(s, &f) / 1.125f - 1.0f) < 1e-2f);
    assert_true(source_step(s, -4));
    (void)grey_of(s, &f);
    assert_int_equal(source_position(s), 1);
    assert_false(source_seek(s, 2 * HOLD + 1));
    frame_finish(&f);
    source_close(s);
    folder_remove(&folder);
}

/* A sky that is still needed is kept, also where one between cannot be read: what was read once may vanish. */
static void each_frame_is_read_once(void **state)
{
    enum { SKIES = 9, DAMAGED = 4 };
    struct folder folder;
    struct frame f = { .kind = FRAME_NONE };
    char name[32];
    int there = 0;
    (void)state;

    folder_make(&folder);
    for (int k = 0; k < SKIES; k++) {
        snprintf(name, sizeof(name), "a.%d.hdr", k);
        if (k == DAMAGED)
            folder_put(&folder, name, "no image");
        else
            put_grey(&folder, name, (unsigned char)(64 + 16 * k));
    }
    struct source *s = opened(folder_path(&folder, "a.%d.hdr"), false, BETWEEN_FADE);
    for (int k = 0; k <= (SKIES - 1) * HOLD; k++) {
        assert_true(fabsf(grey_of(s, &f) * 128.0f / (64.0f + 16.0f * (float)k / HOLD) - 1.0f) < 2e-2f);
        for (; k % HOLD != 0 && there < SKIES && there <= k / HOLD + 2; there++) {
            snprintf(name, sizeof(name), "a.%d.hdr", there);
            assert_int_equal(remove(folder_path(&folder, name)), 0);
        }
    }
    assert_int_equal(there, SKIES);
    frame_finish(&f);
    source_close(s);
    folder_remove(&folder);
}

/* Taken at 0, 1 and 4 s: nine images over four seconds are half a second apart. */
static void capture_times_in_names_make_images_even_in_time(void **state)
{
    static const double when[] = { 0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0 };
    struct folder folder;
    struct frame f = { .kind = FRAME_NONE };
    (void)state;

    folder_make(&folder);
    put_grey(&folder, "sky_20240612_143000.hdr", 64);
    put_grey(&folder, "sky_20240612_143001.hdr", 128);
    put_grey(&folder, "sky_20240612_143004.hdr", 224);
    struct source *s = opened(folder_path(&folder, "*.hdr"), false, BETWEEN_FADE);
    for (int k = 0; k < 9; k++) {
        const double mantissa = when[k] < 1.0 ? 64.0 + 64.0 * when[k] : 128.0 + 32.0 * (when[k] - 1.0);
        assert_true(fabs((double)grey_of(s, &f) * 128.0 / mantissa - 1.0) < 1e-2);
    }
    frame_finish(&f);
    source_close(s);
    folder_remove(&folder);
}

/* Equal times: images are even in number. */
static void times_that_stand_still_are_not_used(void **state)
{
    struct folder folder;
    struct frame f = { .kind = FRAME_NONE };
    (void)state;

    folder_make(&folder);
    put_grey(&folder, "a_20240612_143000.hdr", 64);
    put_grey(&folder, "b_20240612_143000.hdr", 128);
    put_grey(&folder, "c_20240612_143009.hdr", 192);
    struct source *s = opened(folder_path(&folder, "*.hdr"), false, BETWEEN_FADE);
    for (int k = 0; k < 5; k++)
        assert_true(fabsf(grey_of(s, &f) * 128.0f / (64.0f + 16.0f * (float)k) - 1.0f) < 1e-2f);
    frame_finish(&f);
    source_close(s);
    folder_remove(&folder);
}

/* It is named once, and images go across the gap; once it is mended, it is used. */
static void a_damaged_frame_is_passed_over(void **state)
{
    struct folder folder;
    struct frame f = { .kind = FRAME_NONE };
    (void)state;

    folder_make(&folder);
    put_grey(&folder, "a.0.hdr", 64);
    folder_put(&folder, "a.1.hdr", "no image");
    put_grey(&folder, "a.2.hdr", 192);
    struct source *s = opened(folder_path(&folder, "a.%d.hdr"), false, BETWEEN_FADE);
    for (int k = 0; k <= 2 * HOLD; k++)
        assert_true(fabsf(grey_of(s, &f) * 128.0f / (64.0f + 16.0f * (float)k) - 1.0f) < 2e-2f);
    put_grey(&folder, "a.1.hdr", 100);
    assert_true(source_seek(s, HOLD));
    assert_true(fabsf(grey_of(s, &f) * 128.0f / 100.0f - 1.0f) < 1e-2f);
    frame_finish(&f);
    source_close(s);
    folder_remove(&folder);
}

static void without_a_readable_frame_there_is_an_error_for_each_image(void **state)
{
    struct folder folder;
    struct frame f = { .kind = FRAME_NONE };
    struct reason why = { "" };
    int failed = 0;
    (void)state;

    folder_make(&folder);
    folder_put(&folder, "a.0.hdr", "no image");
    folder_put(&folder, "a.1.hdr", "no image");
    struct source *s = opened(folder_path(&folder, "a.%d.hdr"), false, BETWEEN_FADE);
    for (enum err e = source_next(s, &f, &why); e != ERR_END; e = source_next(s, &f, &why)) {
        assert_int_equal(e, ERR_FORMAT);
        failed++;
    }
    assert_int_equal(failed, HOLD + 1);
    frame_finish(&f);
    source_close(s);
    folder_remove(&folder);
}

/* Numbers count images, so that a sky's hour goes on by a part of its speed. */
static void the_hour_that_is_set_is_that_of_the_next_image(void **state)
{
    const struct source_desc desc = { .spec = "sky:hour=6,speed=1,size=64x32",
                                      .frames = { true, 100, 400 },
                                      .between = { .mode = BETWEEN_FADE, .hold = HOLD } };
    struct source *s = NULL;
    struct frame f = { .kind = FRAME_NONE };
    struct reason why = { "" };
    (void)state;

    assert_int_equal(source_open(&desc, &s, &why), ERR_OK);
    for (int k = 0; k < 3; k++)
        (void)grey_of(s, &f);
    assert_true(source_set_hour(s, 12.0));
    for (int k = 0; k < 3; k++) {
        (void)grey_of(s, &f);
        const struct sky_desc *sky = source_sky(s);
        const double hours = sky->hour + sky->speed_hours * (double)f.number;
        assert_true(fabs(hours - 24.0 * floor(hours / 24.0) - 12.0 - k / 60.0 / HOLD) < 1e-9);
    }
    frame_finish(&f);
    source_close(s);
}

static void a_turn_of_a_whole_round_goes_round(void **state)
{
    struct folder folder;
    struct frame f = { .kind = FRAME_NONE };
    struct source *s = NULL;
    struct reason why = { "" };
    (void)state;

    folder_make(&folder);
    put_grey(&folder, "a.hdr", 64);
    const struct source_desc desc = { .spec = folder_path(&folder, "a.hdr"),
                                      .frames = { true, 0, 2 },
                                      .turn = 360.0,
                                      .between = { .mode = BETWEEN_FADE, .hold = HOLD } };
    assert_int_equal(source_open(&desc, &s, &why), ERR_OK);
    for (int k = 0; k <= 2 * HOLD; k++) {
        (void)grey_of(s, &f);
        assert_true(fabs(f.turn - fmod(360.0 * k / HOLD, 360.0)) < 1e-9);
    }
    frame_finish(&f);
    source_close(s);
    folder_remove(&folder);
}

static void what_cannot_be_held_is_refused(void **state)
{
    struct source_desc desc = { .spec = "sky:",
                                .frames = { true, FRAME_NUMBER_MAX - 1, FRAME_NUMBER_MAX },
                                .between = { .mode = BETWEEN_FADE, .hold = HOLD } };
    struct source *s = NULL;
    struct reason why = { "" };
    (void)state;

    assert_int_equal(source_open(&desc, &s, &why), ERR_USAGE);
    assert_non_null(strstr(why.text, "2^53 - 1"));
    desc = (struct source_desc){ .spec = "sky:", .frames = { true, 0, 3 }, .between = { .align = BETWEEN_ALIGN_SUN } };
    assert_int_equal(source_open(&desc, &s, &why), ERR_USAGE);
    assert_non_null(strstr(why.text, "--align"));
}

static uint64_t digest_at(struct source *s, struct frame *f, uint64_t position)
{
    struct reason why = { "" };
    uint64_t sum = 0;

    assert_true(source_seek(s, position));
    assert_int_equal(source_next(s, f, &why), ERR_OK);
    for (size_t k = 0; k < 3 * (size_t)f->width * f->height; k++) {
        uint32_t bits;
        memcpy(&bits, f->rgb + k, sizeof(bits));
        sum = 6364136223846793005u * (sum + bits) + 1442695040888963407u;
    }
    return sum;
}

static void an_image_is_the_same_in_any_order(void **state)
{
    static const uint64_t order[] = { 17, 3, 18, 0, 20, 9, 8, 7, 12, 13 };
    const char *spec = "sky:hour=9,speed=20,size=64x32";
    struct frame f = { .kind = FRAME_NONE };
    uint64_t digests[24];
    (void)state;

    struct source *s = NULL, *other = NULL;
    struct reason why = { "" };
    const struct source_desc desc = { .spec = spec,
                                      .frames = { true, 0, 5 },
                                      .between = { .mode = BETWEEN_MOTION, .hold = HOLD } };
    assert_int_equal(source_open(&desc, &s, &why), ERR_OK);
    assert_int_equal(source_open(&desc, &other, &why), ERR_OK);
    assert_int_equal(source_count(s), 5 * HOLD + 1);
    for (uint64_t k = 0; k <= 5 * HOLD; k++)
        digests[k] = digest_at(s, &f, k);
    for (size_t k = 0; k < sizeof(order) / sizeof(order[0]); k++)
        assert_true(digest_at(other, &f, order[k]) == digests[order[k]]);
    assert_true(digests[1] != digests[2]);
    frame_finish(&f);
    source_close(s);
    source_close(other);
}

static void what_loops_begins_again(void **state)
{
    struct folder folder;
    struct frame f = { .kind = FRAME_NONE };
    (void)state;

    folder_make(&folder);
    put_grey(&folder, "a.0.hdr", 64);
    put_grey(&folder, "a.1.hdr", 128);
    struct source *s = opened(folder_path(&folder, "a.%d.hdr"), true, BETWEEN_FADE);
    for (int k = 0; k < 2 * (HOLD + 1); k++)
        assert_true(fabsf(grey_of(s, &f) * 128.0f / (64.0f + 16.0f * (float)(k % (HOLD + 1))) - 1.0f) < 1e-2f);
    frame_finish(&f);
    source_close(s);
    folder_remove(&folder);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(images_count_from_the_first_to_the_last_frame),
    cmocka_unit_test(each_frame_is_read_once),
    cmocka_unit_test(capture_times_in_names_make_images_even_in_time),
    cmocka_unit_test(times_that_stand_still_are_not_used),
    cmocka_unit_test(a_damaged_frame_is_passed_over),
    cmocka_unit_test(without_a_readable_frame_there_is_an_error_for_each_image),
    cmocka_unit_test(the_hour_that_is_set_is_that_of_the_next_image),
    cmocka_unit_test(a_turn_of_a_whole_round_goes_round),
    cmocka_unit_test(what_cannot_be_held_is_refused),
    cmocka_unit_test(an_image_is_the_same_in_any_order),
    cmocka_unit_test(what_loops_begins_again),
};
UNIT_MAIN(tests)
