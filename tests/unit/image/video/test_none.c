#include "image/video/h264.h"
#include "image/video/movie.h"

#include "support/unit.h"

static void without_an_encoder_nothing_is_offered_and_nothing_encoded(void **state)
{
    const uint8_t rgb[12] = { 0 };
    struct h264_output out;
    (void)state;

    assert_false(h264_available());
    assert_null(h264_encoder_create());
    assert_int_equal(h264_encode(NULL, rgb, &(struct h264_desc){ .width = 2, .height = 2, .quality = 90 }, &out),
                     ERR_UNSUPPORTED);
    assert_null(out.bytes);
    h264_encoder_destroy(NULL);
}

static void without_it_no_video_file_is_begun(void **state)
{
    const struct movie_desc desc = { .path = "never.mp4", .container = "mp4", .width = 2, .height = 2, .rate = 30.0 };
    struct movie *m;
    struct reason why;
    (void)state;

    assert_false(movie_available());
    assert_int_equal(movie_create(&desc, &m, &why), ERR_UNSUPPORTED);
    assert_null(m);
    movie_destroy(NULL);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(without_an_encoder_nothing_is_offered_and_nothing_encoded),
    cmocka_unit_test(without_it_no_video_file_is_begun),
};
UNIT_MAIN(tests)
