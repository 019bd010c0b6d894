/* PNG files, read back by libpng. */
#include "image/codec/encode.h"

#include "base/mem.h"
#include "base/rng.h"
#include "support/unit.h"

#include <png.h>

enum { SIDE = 70 };

/* Decodes samples as they stand in the file, in this machine's byte order. */
static void read_back(const uint8_t *bytes, size_t size, const struct png_desc *want, void *out)
{
    png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png_create_info_struct(png);
    FILE *f = tmpfile();
    int intent = -1;

    assert_true(f && fwrite(bytes, 1, size, f) == size);
    rewind(f);
    png_init_io(png, f);
    png_read_png(png, info, PNG_TRANSFORM_SWAP_ENDIAN, NULL);
    assert_int_equal(png_get_image_width(png, info), want->width);
    assert_int_equal(png_get_image_height(png, info), want->height);
    assert_int_equal(png_get_bit_depth(png, info), want->deep ? 16 : 8);
    assert_int_equal(png_get_channels(png, info), want->alpha ? 4 : 3);
    assert_true(png_get_sRGB(png, info, &intent) != 0);
    const size_t row = png_get_rowbytes(png, info);
    for (uint32_t y = 0; y < want->height; y++)
        memcpy((uint8_t *)out + y * row, png_get_rows(png, info)[y], row);
    png_destroy_read_struct(&png, &info, NULL);
    fclose(f);
}

static void samples_come_back_bit_for_bit(void **state)
{
    static const uint32_t sizes[][2] = { { 1, 1 }, { 1, 17 }, { 33, 15 }, { SIDE, SIDE }, { 7, 64 } };
    static uint16_t samples[4 * SIDE * SIDE], back[4 * SIDE * SIDE];
    struct rng r = { 5 };
    (void)state;

    for (size_t i = 0; i < 4 * SIDE * SIDE; i++)
        samples[i] = (uint16_t)(65536.0 * rng_next(&r));
    for (size_t i = 0; i < 4 * sizeof(sizes) / sizeof(sizes[0]); i++) {
        const struct png_desc d = { samples, sizes[i / 4][0], sizes[i / 4][1], i & 1, i & 2 };
        struct reason why = { "" };
        uint8_t *bytes;
        size_t size;
        assert_int_equal(png_encode(&d, &bytes, &size, &why), ERR_OK);
        read_back(bytes, size, &d, back);
        assert_memory_equal(back, samples, (size_t)d.width * d.height * (d.alpha ? 4 : 3) * (d.deep ? 2 : 1));
        mem_free(bytes);
    }
}

/* Noise, whose file outgrows the first memory for it several times. */
static void a_large_file_is_whole(void **state)
{
    enum { LARGE = 300 };
    static uint16_t samples[4 * LARGE * LARGE], back[4 * LARGE * LARGE];
    const struct png_desc d = { samples, LARGE, LARGE, true, true };
    struct rng r = { 6 };
    struct reason why = { "" };
    uint8_t *bytes;
    size_t size;
    (void)state;

    for (size_t i = 0; i < 4 * LARGE * LARGE; i++)
        samples[i] = (uint16_t)(65536.0 * rng_next(&r));
    assert_int_equal(png_encode(&d, &bytes, &size, &why), ERR_OK);
    assert_true(size > sizeof(samples) * 9 / 10);
    read_back(bytes, size, &d, back);
    assert_memory_equal(back, samples, sizeof(samples));
    mem_free(bytes);
}

static void sizes_that_png_lacks_are_refused(void **state)
{
    const struct png_desc none = { NULL, 0, 5, false, false }, huge = { NULL, 5, 1u << 30, false, false };
    struct reason why = { "" };
    uint8_t *bytes;
    size_t size;
    (void)state;

    assert_int_equal(png_encode(&none, &bytes, &size, &why), ERR_RANGE);
    assert_non_null(strstr(why.text, "0x5"));
    assert_int_equal(png_encode(&huge, &bytes, &size, &why), ERR_RANGE);
    assert_null(bytes);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(samples_come_back_bit_for_bit),
    cmocka_unit_test(a_large_file_is_whole),
    cmocka_unit_test(sizes_that_png_lacks_are_refused),
};

UNIT_MAIN(tests)
