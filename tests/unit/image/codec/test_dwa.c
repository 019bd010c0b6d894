/* DWA files, against what the library that defines them has written. */
#include "image/codec/decoding.h"
#include "image/codec/dwa_files.h"

/* place: of the three channels in the file's list. */
static void check_even(const uint8_t *bytes, size_t size, uint32_t width, uint32_t height, const int place[3])
{
    struct image im = { 0 };

    must_decode(bytes, size, &im);
    assert_int_equal(im.width, width);
    assert_int_equal(im.height, height);
    for (uint32_t i = 0; i < 3 * width * height; i++) {
        const uint32_t x = i / 3 % width, y = i / 3 / width;
        const float want = 2.0f + (float)place[i % 3] + (float)x / 64.0f + (float)y / 128.0f;
        if (fabsf(im.rgb[i] - want) > 0.01f * want)
            fail_msg("texel %u, %u, channel %u: %g, not %g", x, y, i % 3, (double)im.rgb[i], (double)want);
    }
    image_finish(&im);
}

static void files_of_the_cxx_library_decode(void **state)
{
    (void)state;

    check_even(dwaa_file, sizeof(dwaa_file), 13, 34, (const int[]){ 3, 2, 1 });
    check_even(dwab_file, sizeof(dwab_file), 11, 9, (const int[]){ 1, 1, 1 });
}

static void files_cut_at_any_byte_are_refused(void **state)
{
    (void)state;

    must_refuse_each_cut(dwaa_file, sizeof(dwaa_file));
    must_refuse_each_cut(dwab_file, sizeof(dwab_file));
}

static void turned_bits_are_survived(void **state)
{
    uint8_t bytes[sizeof(dwaa_file)];
    (void)state;

    memcpy(bytes, dwaa_file, sizeof(dwaa_file));
    must_survive_turned_bits(bytes, sizeof(dwaa_file));
    memcpy(bytes, dwab_file, sizeof(dwab_file));
    must_survive_turned_bits(bytes, sizeof(dwab_file));
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(files_of_the_cxx_library_decode),
    cmocka_unit_test(files_cut_at_any_byte_are_refused),
    cmocka_unit_test(turned_bits_are_survived),
};

UNIT_MAIN(tests)
