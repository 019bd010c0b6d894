/* Videos whose containers say where their images lie, in space and time, made by ffmpeg. */
#include "support/unit.h"

#include "sky/source/clips.h"
#include "sky/source/source.h"

#include <math.h>

static struct source *open_clip(const struct source_desc *d)
{
    struct source *s = NULL;
    struct reason why = { "" };

    if (source_open(d, &s, &why))
        fail_msg("%s", why.text);
    return s;
}

/* A black image of 10 frames/s with a red block at the top left and a blue one below it; the first frame is at
 * brightness 1 of 10, the next at 2, and so on. */
#define BLOCKS                                                                                                         \
    "ffmpeg -v error -y -f lavfi -i color=black:s=128x64:r=10:d=1 -vf "                                                \
    "drawbox=0:0:16:16:red:fill,drawbox=0:32:16:16:blue:fill,drawbox=64:16:16:16:white:fill,"                          \
    "\"geq=r='r(X,Y)*(N+1)/10':g='g(X,Y)*(N+1)/10':b='b(X,Y)*(N+1)/10'\" "                                             \
    "-pix_fmt yuv444p -c:v libx264 -g 10 -bf 0 -qp 0 "

static void first_frame(const char *path, struct frame *f)
{
    struct source *s = open_clip(&(struct source_desc){ .spec = path });
    struct reason why = { "" };

    if (source_next(s, f, &why))
        fail_msg("%s", why.text);
    source_close(s);
}

/* Whether the colour there is much of one channel alone. */
static bool is_colour(const struct frame *f, uint32_t x, uint32_t y, int channel)
{
    const float *v = f->rgb + 3 * ((size_t)y * f->width + x);

    assert_true(x < f->width && y < f->height);
    return v[channel] > 0.2f && v[(channel + 1) % 3] < 0.1f && v[(channel + 2) % 3] < 0.1f;
}

static void a_display_matrix_turns_the_image(void **state)
{
    static const struct {
        int degrees;
        uint32_t width, red_x, red_y, blue_x, blue_y;
    } rows[] = { { 180, 128, 120, 56, 120, 24 }, { 270, 64, 56, 8, 24, 8 }, { 90, 64, 8, 120, 40, 120 } };
    struct folder folder;
    struct frame f = { 0 };
    (void)state;

    folder_make(&folder);
    clips_run(BLOCKS "%s", folder_path(&folder, "plain.mp4"));
    first_frame(folder_path(&folder, "plain.mp4"), &f);
    assert_true(is_colour(&f, 8, 8, 0) && is_colour(&f, 8, 40, 2));
    for (size_t i = 0; i < 3; i++) {
        char path[300];
        snprintf(path, sizeof(path), "%s", folder_path(&folder, "turned.mp4"));
        clips_run("ffmpeg -v error -y -i %s -c copy -metadata:s:v:0 rotate=%d %s", folder_path(&folder, "plain.mp4"),
                  rows[i].degrees, path);
        first_frame(path, &f);
        assert_int_equal(f.width, rows[i].width);
        assert_true(is_colour(&f, rows[i].red_x, rows[i].red_y, 0));
        assert_true(is_colour(&f, rows[i].blue_x, rows[i].blue_y, 2));
    }
    frame_finish(&f);
    folder_remove(&folder);
}

static void of_stereo_the_left_eye_is_used(void **state)
{
    static const struct {
        const char *mode;
        uint32_t width, height;
        bool red, blue; /* seen at the top left */
    } rows[] = { { "top_bottom", 128, 32, true, false },
                 { "bottom_top", 128, 32, false, true },
                 { "left_right", 64, 64, true, false },
                 { "mono", 128, 64, true, false } };
    struct folder folder;
    struct frame f = { 0 };
    (void)state;

    folder_make(&folder);
    clips_run(BLOCKS "%s", folder_path(&folder, "plain.mkv"));
    for (size_t i = 0; i < 4; i++) {
        char path[300];
        snprintf(path, sizeof(path), "%s", folder_path(&folder, "stereo.mkv"));
        clips_run("ffmpeg -v error -y -i %s -c copy -metadata:s:v:0 stereo_mode=%s %s",
                  folder_path(&folder, "plain.mkv"), rows[i].mode, path);
        first_frame(path, &f);
        assert_int_equal(f.width, rows[i].width);
        assert_int_equal(f.height, rows[i].height);
        assert_int_equal(is_colour(&f, 8, 8, 0), rows[i].red);
        assert_int_equal(is_colour(&f, 8, 8, 2), rows[i].blue);
        /* the whole is 2:1, so that each eye is squeezed */
        assert_string_equal(f.layout, i < 3 ? "latlong" : "auto");
    }
    clips_run(BLOCKS "-x264-params frame-packing=3 -bsf:v h264_metadata -f mp4 %s", folder_path(&folder, "sei.mp4"));
    first_frame(folder_path(&folder, "sei.mp4"), &f);
    assert_true(f.width == 64 && f.height == 64); /* the codec's own message, side by side */
    frame_finish(&f);
    folder_remove(&folder);
}

static void pixels_that_are_not_square_make_a_lat_long_image(void **state)
{
    struct folder folder;
    struct frame f = { 0 };
    (void)state;

    folder_make(&folder);
    clips_run("ffmpeg -v error -y -f lavfi -i color=black:s=96x64:r=10:d=0.3 -vf setsar=4/3 -c:v libx264 %s",
              folder_path(&folder, "wide.mp4"));
    first_frame(folder_path(&folder, "wide.mp4"), &f);
    assert_string_equal(f.layout, "latlong");
    frame_finish(&f);
    folder_remove(&folder);
}

/* What an edit list leaves out is decoded for the others, and neither shown nor counted. */
static void frames_before_an_edit_are_not_shown(void **state)
{
    struct folder folder;
    struct frame f = { 0 };
    struct reason why = { "" };
    (void)state;

    folder_make(&folder);
    clips_run(BLOCKS "%s", folder_path(&folder, "plain.mp4"));
    char path[300];
    snprintf(path, sizeof(path), "%s", folder_path(&folder, "cut.mp4"));
    clips_run("ffmpeg -v error -y -ss 0.5 -i %s -c copy %s", folder_path(&folder, "plain.mp4"), path);
    struct source *s = open_clip(&(struct source_desc){ .spec = path });
    assert_int_equal(source_count(s), 5);
    for (uint64_t n = 0; n < 5; n++) {
        if (source_next(s, &f, &why))
            fail_msg("%s", why.text);
        assert_int_equal(f.number, n);
        const double want = 203.0 * pow(0.1 * (double)(6 + n), 2.4), got = (double)f.rgb[3 * (24 * 128 + 72)];
        assert_true(fabs(got - want) < 0.05 * want + 0.5);
    }
    assert_int_equal(source_next(s, &f, &why), ERR_END);
    source_close(s);
    frame_finish(&f);
    folder_remove(&folder);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_display_matrix_turns_the_image),
    cmocka_unit_test(of_stereo_the_left_eye_is_used),
    cmocka_unit_test(pixels_that_are_not_square_make_a_lat_long_image),
    cmocka_unit_test(frames_before_an_edit_are_not_shown),
};

UNIT_MAIN(tests)
