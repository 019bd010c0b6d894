#include "video/h264.h"

#include "support/unit.h"

static void without_an_encoder_nothing_is_offered_and_nothing_encoded(void **state)
{
    const uint8_t rgb[12] = { 0 };
    struct h264_output out;
    (void)state;

    assert_false(h264_available());
    assert_null(h264_encoder_create());
    assert_int_equal(h264_encode(NULL, rgb, &(struct h264_desc){ 2, 2, 90, false }, &out), ERR_UNSUPPORTED);
    assert_null(out.bytes);
    h264_encoder_destroy(NULL);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(without_an_encoder_nothing_is_offered_and_nothing_encoded),
};
UNIT_MAIN(tests)
