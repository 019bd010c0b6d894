/* An image's memory, and what sanitising does to each kind of value. */
#include "sky/tables/environment.h"
#include "support/skies.h"
#include "support/unit.h"

#include "image/codec/image.h"

#include <math.h>

#define FILE_2X2                                                                                                       \
    "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 2\n"                                                                \
    "\x80\x80\x80\x81\x80\x80\x80\x81\x80\x80\x80\x81\x80\x80\x80\x81"

static void sizes_outside_the_limits_are_refused(void **state)
{
    static const uint32_t sizes[][2] = { { 0, 1 },
                                         { 1, 0 },
                                         { IMAGE_MAX_SIDE + 1, 1 },
                                         { 1, IMAGE_MAX_SIDE + 1 },
                                         { IMAGE_MAX_SIDE, IMAGE_MAX_SIDE / 2 + 1 },
                                         { UINT32_MAX, UINT32_MAX } };
    struct image im = { 0 };
    (void)state;

    for (size_t i = 0; i < sizeof(sizes) / sizeof(sizes[0]); i++) {
        assert_int_equal(image_resize(&im, sizes[i][0], sizes[i][1]), ERR_RANGE);
        assert_null(im.rgb);
    }
}

/* Of frames of texels, of one file and of six; and the limit can be moved. */
static void a_frame_above_the_owners_limit_is_refused_by_its_size(void **state)
{
    enum { FACE = sizeof(FILE_2X2) - 1 };
    static char six[] = FILE_2X2 FILE_2X2 FILE_2X2 FILE_2X2 FILE_2X2 FILE_2X2;
    static float rgb[3 * 3];
    const struct frame frames[] = {
        { .kind = FRAME_TEXELS, .name = "f", .rgb = rgb, .width = 1, .height = 3 },
        { .kind = FRAME_FILE, .name = "f", .bytes = (uint8_t *)six, .size = FACE },
        { .kind = FRAME_FILE,
          .name = "f",
          .bytes = (uint8_t *)six,
          .size = sizeof(six) - 1,
          .faces = { FACE, FACE, FACE, FACE, FACE, FACE } },
    };
    static const uint32_t enough[] = {
        3, 3, 12
    }; /* a side; half its square has to be enough as well, and six faces lie one above the other */
    static const char *const said[] = {
        "f: an image of 1x3 texels is too large; the limit is 2 per side and 2 in all",
        "f: byte 35: an image of 2x2 texels is too large; the limit is 2 per side and 2 in all",
        "f (face px): too large: six faces of 2x2 texels"
    };
    struct environment *e = environment_create(&(struct environment_desc){ .n = 16 });
    struct reason why;
    (void)state;

    for (size_t i = 0; i < 3; i++) {
        environment_configure(e, &(struct environment_desc){ .max_side = enough[i] - 1 });
        assert_int_equal(environment_decode(e, &frames[i], &why), ERR_RANGE);
        if (strncmp(why.text, said[i], strlen(said[i])) != 0)
            fail_msg("%s", why.text);
        environment_configure(e, &(struct environment_desc){ .max_side = enough[i] });
        assert_int_equal(environment_decode(e, &frames[i], &why), ERR_OK);
        environment_configure(e, &(struct environment_desc){ .max_side = 0 });
        assert_int_equal(environment_decode(e, &frames[i], &why), ERR_OK);
    }
    environment_destroy(e);
}

static void memory_is_kept_while_it_is_large_enough(void **state)
{
    struct image im = { 0 };
    (void)state;

    assert_int_equal(image_resize(&im, 20, 10), ERR_OK);
    const float *before = im.rgb;
    im.layout = LAYOUT_CUBE;
    im.faults.negative = 3;
    assert_int_equal(image_resize(&im, 8, 25), ERR_OK);
    assert_ptr_equal(im.rgb, before);
    assert_int_equal(im.width, 8);
    assert_int_equal(im.height, 25);
    assert_int_equal(im.layout, LAYOUT_AUTO);
    assert_int_equal(im.faults.negative, 0);
    assert_int_equal(image_resize(&im, 21, 10), ERR_OK);
    assert_int_equal(im.capacity, 630);
    image_finish(&im);
    assert_null(im.rgb);
    image_finish(&im);
    image_finish(NULL);
}

static void hold(struct image *im, uint32_t width, uint32_t height)
{
    assert_int_equal(image_resize(im, width, height), ERR_OK);
    for (size_t i = 0; i < 3 * (size_t)width * height; i++)
        im->rgb[i] = (float)i;
    image_trim(im);
}

/* Texels stay what they are; images of one size, or now and then a large one, take no new memory. */
static void memory_goes_back_when_images_have_become_far_smaller(void **state)
{
    struct image im = { 0 };
    (void)state;

    hold(&im, 2048, 1024);
    const float *large = im.rgb;
    for (int i = 0; i < 20; i++) {
        hold(&im, i % RECENT_FRAMES == 0 ? 2048 : 4, i % RECENT_FRAMES == 0 ? 1024 : 2);
        assert_ptr_equal(im.rgb, large);
    }
    for (int i = 0; i < RECENT_FRAMES; i++)
        hold(&im, 20, 10);
    assert_int_equal(im.capacity, 600);
    assert_int_equal(im.width, 20);
    for (size_t i = 0; i < 600; i++)
        assert_true(im.rgb[i] == (float)i);
    const float *small = im.rgb;
    hold(&im, 20, 10);
    assert_ptr_equal(im.rgb, small);
    image_finish(&im);
}

/* The same through a whole environment, which is as good as new when it has been told to forget. */
static void an_environment_gives_back_what_a_far_larger_frame_took(void **state)
{
    struct frame large = sky_overcast(2048, 1024), small = sky_overcast(32, 16);
    struct environment *e = environment_create(&(struct environment_desc){ .n = 16 });
    struct environment *other = sky_environment(sky_overcast(32, 16), 16, 0.0);
    struct reason why;
    (void)state;

    assert_int_equal(environment_update(e, &large, &why), ERR_OK);
    for (int i = 0; i < RECENT_FRAMES; i++)
        assert_int_equal(environment_update(e, &small, &why), ERR_OK);
    assert_int_equal(e->image.capacity, 3 * 32 * 16);
    assert_memory_equal(e->texels, other->texels, CUBE_FACES * 16 * 16 * sizeof(*e->texels));
    environment_release_memory(e);
    assert_int_equal(e->image.capacity, 0);
    assert_false(e->ready);
    assert_int_equal(environment_update(e, &small, &why), ERR_OK);
    assert_true(e->ready);
    assert_memory_equal(e->texels, other->texels, CUBE_FACES * 16 * 16 * sizeof(*e->texels));
    environment_destroy(e);
    environment_destroy(other);
    frame_finish(&large);
    frame_finish(&small);
}

/* Every odd value at every place of an image that is no multiple of anything. */
static void each_odd_value_is_put_right_and_counted_anywhere(void **state)
{
    static const struct {
        float value, becomes;
        struct image_faults faults;
    } rows[] = {
        { NAN, NAN, { .nan = 1 } }, /* marks, for image_mend */
        { -NAN, NAN, { .nan = 1 } },
        { INFINITY, INFINITY, { .infinite = 1 } },
        { -INFINITY, 0.0f, { .infinite = 1 } },
        { 3e38f, IMAGE_MAX, { .infinite = 1 } },
        { -3e38f, 0.0f, { .infinite = 1 } },
        { -1e-30f, 0.0f, { .negative = 1 } },
        { -5.0f, 0.0f, { .negative = 1 } },
        { 65504.0f, 65504.0f, { .clipped = 1 } },
        { 65505.0f, 65505.0f, { .clipped = 0 } },
        { IMAGE_MAX, IMAGE_MAX, { .clipped = 0 } },
        { 1e-40f, 1e-40f, { .clipped = 0 } },
    };
    struct image im = { 0 };
    (void)state;

    assert_int_equal(image_resize(&im, 67, 3), ERR_OK);
    for (size_t r = 0; r < sizeof(rows) / sizeof(rows[0]); r++) {
        for (size_t at = 0; at < 67 * 3 * 3; at++) {
            for (size_t i = 0; i < 67 * 3 * 3; i++)
                im.rgb[i] = (float)i;
            im.rgb[at] = rows[r].value;
            memset(&im.faults, 0, sizeof(im.faults));
            image_sanitise_texels(im.rgb, 67 * 3, NULL, &im.faults);
            assert_memory_equal(&im.faults, &rows[r].faults, sizeof(im.faults));
            for (size_t i = 0; i < 67 * 3 * 3; i++)
                if (i == at && isnan(rows[r].becomes))
                    assert_true(isnan(im.rgb[i]));
                else
                    assert_true(im.rgb[i] == (i == at ? rows[r].becomes : (float)i));
        }
    }
    image_finish(&im);
}

static void faults_are_counted_before_a_change_of_primaries_and_negatives_after(void **state)
{
    /* r' = r - g, g' = g, b' = b / 2 */
    static const float m[9] = { 1, -1, 0, 0, 1, 0, 0, 0, 0.5f };
    float rgb[5][3] = { { 3, 1, 4 }, { 1, 3, 4 }, { NAN, 1, -INFINITY }, { 65504, -65504, INFINITY }, { -2, -2, 0 } };
    static const float want[5][3] = {
        { 2, 1, 2 }, { 0, 3, 2 }, { NAN, NAN, NAN }, { INFINITY, INFINITY, INFINITY }, { 0, 0, 0 }
    };
    struct image_faults faults = { .nan = 10 };
    (void)state;

    image_sanitise_texels(&rgb[0][0], 5, m, &faults);
    for (int i = 0; i < 15; i++)
        assert_true(rgb[i / 3][i % 3] == want[i / 3][i % 3] ||
                    (isnan(rgb[i / 3][i % 3]) && isnan(want[i / 3][i % 3]))); /* a mark covers its texel */
    assert_int_equal(faults.nan, 11);
    assert_int_equal(faults.infinite, 2);
    assert_int_equal(faults.clipped, 1);
    assert_int_equal(faults.negative, 2); /* r of texel 1, g of texel 4 */
}

static void fill_image(struct image *im, uint32_t width, uint32_t height)
{
    assert_int_equal(image_resize(im, width, height), ERR_OK);
    for (size_t i = 0; i < 3 * (size_t)width * height; i++)
        im->rgb[i] = (float)(i % 3) + 1.0f; /* 1, 2, 3 in each texel */
}

static void set_texels(struct image *im, uint32_t x0, uint32_t x1, uint32_t y0, uint32_t y1, float v)
{
    for (uint32_t y = y0; y < y1; y++)
        for (uint32_t x = x0; x < x1; x++)
            for (size_t c = 0; c < 3; c++)
                im->rgb[3 * ((size_t)y * im->width + x) + c] = v;
}

static void mend(struct image *im)
{
    image_sanitise_texels(im->rgb, (size_t)im->width * im->height, NULL, &im->faults);
    image_mend(im);
}

/* A texel's three values. */
static void must_hold(const struct image *im, uint32_t x, uint32_t y, float r, float g, float b)
{
    const float *v = im->rgb + 3 * ((size_t)y * im->width + x);

    if (v[0] != r || v[1] != g || v[2] != b)
        fail_msg("(%u, %u): %g %g %g, not %g %g %g", x, y, (double)v[0], (double)v[1], (double)v[2], (double)r,
                 (double)g, (double)b);
}

static void an_infinite_sun_is_at_least_what_a_half_float_holds(void **state)
{
    struct image im = { 0 };
    (void)state;

    fill_image(&im, 64, 32);
    set_texels(&im, 30, 33, 10, 12, INFINITY);
    mend(&im);
    must_hold(&im, 31, 11, 65504.0f, 65504.0f, 65504.0f);
    must_hold(&im, 29, 11, 1.0f, 2.0f, 3.0f);
    fill_image(&im, 64, 32); /* a brighter ring of 32-bit floats around it, in one channel */
    set_texels(&im, 0, 2, 0, 2, INFINITY);
    im.rgb[3 * (64 * 2 + 1) + 1] = 2e6f;
    mend(&im);
    must_hold(&im, 0, 0, 65504.0f, 2e6f, 65504.0f);
    assert_int_equal(im.faults.infinite, 12);
    image_finish(&im);
}

static void what_is_no_number_becomes_the_highest_value_around_it_unless_it_is_a_mask(void **state)
{
    struct image im = { 0 };
    (void)state;

    fill_image(&im, 64, 32);
    set_texels(&im, 30, 34, 10, 14, NAN);
    im.rgb[3 * (64 * 9 + 29)] = 500.0f; /* diagonally beside it */
    set_texels(&im, 50, 51, 0, 1, NAN); /* another area, in a corner */
    mend(&im);
    must_hold(&im, 33, 13, 500.0f, 2.0f, 3.0f);
    must_hold(&im, 50, 0, 1.0f, 2.0f, 3.0f);
    assert_int_equal(im.faults.nan, 3 * 17);
    fill_image(&im, 64, 32);
    set_texels(&im, 0, 64, 20, 32, NAN); /* a lower half without data */
    mend(&im);
    must_hold(&im, 5, 25, 0.0f, 0.0f, 0.0f);
    must_hold(&im, 5, 19, 1.0f, 2.0f, 3.0f);
    fill_image(&im, 4, 2);
    set_texels(&im, 0, 4, 0, 2, NAN);
    mend(&im);
    must_hold(&im, 0, 0, 0.0f, 0.0f, 0.0f);
    image_finish(&im);
}

/* Texel (x, y) of a 3 x 2 image holds 10 x + y; what each of Exif's orientations shows top left, top right, bottom left
 * [Exif 2.32, 4.6.4]. */
static void each_orientation_of_exif_is_set_upright(void **state)
{
    static const struct {
        uint32_t width;
        float left, right, below;
    } rows[] = { { 3, 0, 20, 1 }, { 3, 20, 0, 21 }, { 3, 21, 1, 20 }, { 3, 1, 21, 0 },
                 { 2, 0, 1, 20 }, { 2, 1, 0, 21 },  { 2, 21, 20, 1 }, { 2, 20, 21, 0 } };
    struct image im = { 0 };
    (void)state;

    for (unsigned k = 0; k < 8; k++) {
        assert_int_equal(image_resize(&im, 3, 2), ERR_OK);
        for (uint32_t t = 0; t < 6; t++)
            im.rgb[3 * t] = (float)(10 * (t % 3) + t / 3);
        assert_int_equal(image_orient(&im, k + 1), ERR_OK);
        assert_int_equal(im.width, rows[k].width);
        assert_int_equal(im.height, 5 - rows[k].width);
        assert_true(im.rgb[0] == rows[k].left);
        assert_true(im.rgb[3 * (im.width - 1)] == rows[k].right);
        assert_true(im.rgb[3 * im.width * (im.height - 1)] == rows[k].below);
    }
    image_finish(&im);
}

static void a_window_adds_black_and_cuts_off(void **state)
{
    struct image im = { 0 };
    (void)state;

    fill_image(&im, 4, 2);
    im.rgb[0] = 9.0f;
    im.layout = LAYOUT_CUBE;
    assert_int_equal(image_place(&im, 8, 6, 3, 2), ERR_OK);
    must_hold(&im, 3, 2, 9.0f, 2.0f, 3.0f);
    must_hold(&im, 6, 3, 1.0f, 2.0f, 3.0f);
    must_hold(&im, 7, 3, 0.0f, 0.0f, 0.0f);
    must_hold(&im, 3, 1, 0.0f, 0.0f, 0.0f);
    assert_int_equal(im.layout, LAYOUT_CUBE);
    assert_int_equal(image_place(&im, 2, 1, -3, -2), ERR_OK);
    assert_true(im.width == 2 && im.height == 1);
    must_hold(&im, 0, 0, 9.0f, 2.0f, 3.0f);
    assert_int_equal(image_place(&im, 2, 1, 2, 0), ERR_RANGE);
    image_finish(&im);
}

static void pixels_that_are_not_square_make_a_lat_long_image_or_are_named(void **state)
{
    struct image im = { 0 };
    (void)state;

    fill_image(&im, 16, 16);
    image_take_aspect(&im, 2.0);
    assert_int_equal(im.layout, LAYOUT_LATLONG);
    assert_string_equal(im.note, "");
    fill_image(&im, 16, 16);
    image_take_aspect(&im, 1.0);
    assert_int_equal(im.layout, LAYOUT_AUTO);
    image_take_aspect(&im, 1.5);
    assert_int_equal(im.layout, LAYOUT_AUTO);
    assert_non_null(strstr(im.note, "1.5:1"));
    image_finish(&im);
}

static void no_texels_are_no_work(void **state)
{
    struct image_faults faults = { 0 };
    (void)state;

    image_sanitise_texels(NULL, 0, NULL, &faults);
    assert_int_equal(faults.nan, 0);
}

static void layouts_have_names_that_parse(void **state)
{
    static const enum layout layouts[] = { LAYOUT_AUTO,   LAYOUT_LATLONG,  LAYOUT_LATLONG_BOTTOM_FIRST,
                                           LAYOUT_CUBE,   LAYOUT_HCROSS,   LAYOUT_VCROSS,
                                           LAYOUT_BALL,   LAYOUT_CUBE_3X2, LAYOUT_CUBE_6X1,
                                           LAYOUT_FISHEYE };
    int got = -1;
    struct reason why;
    (void)state;

    for (size_t i = 0; i < sizeof(layouts) / sizeof(layouts[0]); i++) {
        assert_int_equal(choice_parse(layout_choices, 0, "layout", layout_name(layouts[i]), &got, &why), ERR_OK);
        assert_int_equal(got, layouts[i]);
    }
    assert_int_equal(choice_parse(layout_choices, 0, "layout", "mercator", &got, &why), ERR_USAGE);
    assert_int_equal(got, LAYOUT_FISHEYE); /* as it was */
    assert_non_null(strstr(why.text, "mercator"));
}

/* A frame of texels is copied and put right row by row; what is counted is of the whole image, and the frame itself
 * stays as it came, for it may be wanted again. */
static void texels_of_a_frame_are_put_right_in_every_row(void **state)
{
    enum { W = 70, H = 35 };
    static float rgb[W * H * 3], before[W * H * 3];
    struct environment *e = environment_create(&(struct environment_desc){ .n = 16 });
    const struct frame f = { .kind = FRAME_TEXELS, .name = "texels", .rgb = rgb, .width = W, .height = H };
    struct reason why;
    (void)state;

    for (size_t i = 0; i < W * H * 3; i++)
        rgb[i] = (float)(i % 97);
    for (size_t y = 0; y < H; y++) {
        rgb[3 * W * y + y] = NAN;
        rgb[3 * W * y + y + 1] = -1.0f;
        rgb[3 * W * y + 3 * W - 1] = INFINITY;
        rgb[3 * W * y + 3 * W - 2] = 65504.0f;
    }
    memcpy(before, rgb, sizeof(rgb));
    for (int time = 0; time < 2; time++) {
        assert_int_equal(environment_decode(e, &f, &why), ERR_OK);
        assert_memory_equal(rgb, before, sizeof(rgb));
        assert_int_equal(e->image.layout, LAYOUT_LATLONG);
        assert_int_equal(e->image.faults.nan, H);
        assert_int_equal(e->image.faults.negative, H);
        assert_int_equal(e->image.faults.infinite, H);
        assert_int_equal(e->image.faults.clipped, H);
        for (size_t i = 0; i < W * H * 3; i++) {
            const float v = rgb[i], got = e->image.rgb[i];
            if (isfinite(v))
                assert_true(got == (v >= 0.0f ? v : 0.0f));
            else /* what is around it: test_image's own tests */
                assert_true(isnan(v) ? got > 0.0f && got < 97.0f : got == 65504.0f);
        }
    }
    environment_destroy(e);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(texels_of_a_frame_are_put_right_in_every_row),
    cmocka_unit_test(sizes_outside_the_limits_are_refused),
    cmocka_unit_test(a_frame_above_the_owners_limit_is_refused_by_its_size),
    cmocka_unit_test(memory_is_kept_while_it_is_large_enough),
    cmocka_unit_test(memory_goes_back_when_images_have_become_far_smaller),
    cmocka_unit_test(an_environment_gives_back_what_a_far_larger_frame_took),
    cmocka_unit_test(each_odd_value_is_put_right_and_counted_anywhere),
    cmocka_unit_test(faults_are_counted_before_a_change_of_primaries_and_negatives_after),
    cmocka_unit_test(an_infinite_sun_is_at_least_what_a_half_float_holds),
    cmocka_unit_test(what_is_no_number_becomes_the_highest_value_around_it_unless_it_is_a_mask),
    cmocka_unit_test(each_orientation_of_exif_is_set_upright),
    cmocka_unit_test(a_window_adds_black_and_cuts_off),
    cmocka_unit_test(pixels_that_are_not_square_make_a_lat_long_image_or_are_named),
    cmocka_unit_test(no_texels_are_no_work),
    cmocka_unit_test(layouts_have_names_that_parse),
};

UNIT_MAIN(tests)
