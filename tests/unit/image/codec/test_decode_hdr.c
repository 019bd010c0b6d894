/* Radiance images: each encoding and orientation, what the header may say of the light, and what is refused. */
#include "image/codec/decoding.h"

#include "base/mem.h"
#include "image/codec/encode.h"
#include "image/codec/make_hdr.h"

#define RGBE "FORMAT=32-bit_rle_rgbe"

/* The file at the head of many tests: text, then bytes. */
static enum err decode_text(const char *text, const void *pixels, size_t count, struct image *im, struct reason *why)
{
    uint8_t bytes[4096];
    const size_t n = strlen(text);

    assert_true(n + count <= sizeof(bytes));
    memcpy(bytes, text, n);
    memcpy(bytes + n, pixels, count);
    return decode_alone(bytes, n + count, im, why);
}

static void must_refuse_text(const char *text, const void *pixels, size_t count, enum err code, const char *about)
{
    struct image im = { 0 };
    struct reason why;
    const enum err e = decode_text(text, pixels, count, &im, &why);

    image_finish(&im);
    if (e != code)
        fail_msg("%s, not %s: %s", err_text(e), err_text(code), why.text);
    if (!strstr(why.text, about))
        fail_msg("'%s' has no '%s'", why.text, about);
}

/* One texel of (128, 64, 32) at exponent 129: 1, 1/2, 1/4, under such a header. */
static void decode_one(const char *header, float out[3])
{
    static const uint8_t texel[4] = { 128, 64, 32, 129 };
    struct image im = { 0 };
    struct reason why;
    char text[1024];

    snprintf(text, sizeof(text), "#?RADIANCE\n%s\n\n-Y 1 +X 1\n", header);
    if (decode_text(text, texel, sizeof(texel), &im, &why))
        fail_msg("%s", why.text);
    memcpy(out, im.rgb, 3 * sizeof(float));
    image_finish(&im);
}

static void must_give(const char *header, float r, float g, float b)
{
    float got[3];

    decode_one(header, got);
    if (fabsf(got[0] - r) > 1e-5f * r || fabsf(got[1] - g) > 1e-5f * g || fabsf(got[2] - b) > 1e-5f * b)
        fail_msg("%s: %g %g %g, not %g %g %g", header, (double)got[0], (double)got[1], (double)got[2], (double)r,
                 (double)g, (double)b);
}

static void each_encoding_decodes(void **state)
{
    static const uint32_t lengths[] = { 1, 2, 7, 8, 9, 127, 128, 129, 255, 256, 300, 700 };
    struct image im = { 0 };
    (void)state;

    for (int encoding = HDR_FLAT; encoding <= HDR_NEW_RLE; encoding++) {
        for (size_t l = 0; l < sizeof(lengths) / sizeof(lengths[0]); l++) {
            const struct hdr_recipe r = { .scanlines = 5,
                                          .length = lengths[l],
                                          .encoding = (enum hdr_encoding)encoding };
            size_t size;
            if (encoding == HDR_NEW_RLE && r.length < 8)
                continue;
            uint8_t *bytes = hdr_make(&r, &size);
            must_decode(bytes, size, &im);
            free(bytes);
            assert_int_equal(im.width, r.length);
            assert_int_equal(im.height, 5);
            assert_int_equal(im.layout, LAYOUT_AUTO);
            for (uint32_t i = 0; i < 5 * r.length; i++) {
                uint8_t t[4];
                hdr_recipe_texel(i / r.length, i % r.length, t);
                for (int c = 0; c < 3; c++)
                    assert_true(im.rgb[3 * i + (uint32_t)c] == ldexpf((float)t[c], t[3] - 136));
            }
        }
    }
    image_finish(&im);
}

static void each_orientation_comes_out_upright(void **state)
{
    static const struct {
        const char *first, *second;
        bool x_first, from_right, from_bottom;
    } rows[] = {
        { "-Y", "+X", false, false, false }, { "-Y", "-X", false, true, false }, { "+Y", "+X", false, false, true },
        { "+Y", "-X", false, true, true },   { "+X", "-Y", true, false, false }, { "-X", "-Y", true, true, false },
        { "+X", "+Y", true, false, true },   { "-X", "+Y", true, true, true },
    };
    struct image im = { 0 };
    (void)state;

    for (size_t o = 0; o < 8; o++) {
        for (int encoding = HDR_FLAT; encoding <= HDR_NEW_RLE; encoding++) {
            const struct hdr_recipe r = { .first = rows[o].first,
                                          .second = rows[o].second,
                                          .scanlines = 6,
                                          .length = 11,
                                          .encoding = (enum hdr_encoding)encoding };
            const uint32_t w = rows[o].x_first ? 6 : 11, h = rows[o].x_first ? 11 : 6;
            size_t size;
            uint8_t *bytes = hdr_make(&r, &size);
            must_decode(bytes, size, &im);
            free(bytes);
            assert_int_equal(im.width, w);
            assert_int_equal(im.height, h);
            for (uint32_t y = 0; y < h; y++) {
                for (uint32_t x = 0; x < w; x++) {
                    const uint32_t across = rows[o].from_right ? w - 1 - x : x;
                    const uint32_t down = rows[o].from_bottom ? h - 1 - y : y;
                    uint8_t t[4];
                    hdr_recipe_texel(rows[o].x_first ? across : down, rows[o].x_first ? down : across, t);
                    for (uint32_t c = 0; c < 3; c++)
                        assert_true(im.rgb[3 * (y * w + x) + c] == ldexpf((float)t[c], t[3] - 136));
                }
            }
        }
    }
    image_finish(&im);
}

/* Numbers that RGBE holds exactly, in runs and singly, in rows too short to be packed and in others. */
static void what_hdr_write_packs_is_read_back(void **state)
{
    static const uint32_t widths[] = { 1, 7, 8, 40, 300 };
    static float rgb[2 * 300 * 3];
    (void)state;
    for (size_t k = 0; k < sizeof(widths) / sizeof(widths[0]); k++) {
        const uint32_t width = widths[k], count = 2 * width * 3;
        const struct hdr_desc d = { .rgb = rgb, .width = width, .height = 2 };
        struct image im = { 0 };
        struct reason why;
        uint8_t *bytes;
        size_t size;
        for (uint32_t i = 0; i < count; i++) /* 129 .. 201 of 256: the same exponent in all channels */
            rgb[i] = (float)(i / 3 % 50 < 20 ? 160 : 129 + i / 3 * (7 + i % 3) % 73) / 128.0f;
        assert_int_equal(hdr_encode(&d, &bytes, &size, &why), ERR_OK);
        assert_int_equal(decode_alone(bytes, size, &im, &why), ERR_OK);
        assert_int_equal(im.width, width);
        assert_memory_equal(im.rgb, rgb, count * sizeof(float));
        image_finish(&im);
        mem_free(bytes);
    }
}

static void every_exponent_is_a_power_of_two_and_zero_is_black(void **state)
{
    uint8_t texels[256 * 4];
    struct image im = { 0 };
    struct reason why;
    (void)state;

    for (int e = 0; e < 256; e++) {
        texels[4 * e] = texels[4 * e + 1] = texels[4 * e + 2] = 200;
        texels[4 * e + 3] = (uint8_t)e;
    }
    assert_int_equal(decode_text("#?ANY_PROGRAM\n\n-Y 1 +X 256\n", texels, sizeof(texels), &im, &why), ERR_OK);
    assert_true(im.rgb[0] == 0.0f);
    for (int e = 1; e < 256; e++) {
        const float want = ldexpf(200.0f, e - 136);
        assert_true(im.rgb[3 * e] == (want < IMAGE_MAX ? want : IMAGE_MAX));
    }
    assert_true(im.faults.infinite > 0 && im.faults.nan == 0 && im.faults.negative == 0);
    image_finish(&im);
}

static void exposure_and_correction_divide_and_multiply_up(void **state)
{
    (void)state;

    must_give(RGBE, 1.0f, 0.5f, 0.25f);
    must_give("EXPOSURE=4\n" RGBE, 0.25f, 0.125f, 0.0625f);
    must_give("EXPOSURE= 4.0e+0 \nEXPOSURE=0.5", 0.5f, 0.25f, 0.125f);
    must_give("COLORCORR=2 4 8", 0.5f, 0.125f, 0.03125f);
    must_give("COLORCORR= 2 4 8\nCOLORCORR=2 1 0.5\nEXPOSURE=2", 0.125f, 0.0625f, 0.03125f);
}

static void primaries_are_brought_to_rec709(void **state)
{
    float got[3];
    (void)state;

    must_give("PRIMARIES=0 0 0 0 0 0 0 0", 1.0f, 0.5f, 0.25f);
    must_give("PRIMARIES=0.64 0.33 0.30 0.60 0.15 0.06 0.3127 0.3290", 1.0f, 0.5f, 0.25f);
    /* Rec.2020 [ITU-R BT.2087-0]: 1.6605 -0.5876 -0.0728; -0.1246 1.1329 -0.0083; -0.0182 -0.1006 1.1187 */
    decode_one("PRIMARIES= 0.708 0.292 0.170 0.797 0.131 0.046 0.3127 0.3290", got);
    assert_true(fabsf(got[0] - 1.34846f) < 2e-4f);
    assert_true(fabsf(got[1] - 0.43980f) < 2e-4f);
    assert_true(fabsf(got[2] - 0.21119f) < 2e-4f);
    /* the correction stands before the primaries: red halved, then brought over */
    decode_one("COLORCORR=2 1 1\nPRIMARIES= 0.708 0.292 0.170 0.797 0.131 0.046 0.3127 0.3290", got);
    assert_true(fabsf(got[0] - 0.51823f) < 2e-4f);
    assert_true(fabsf(got[1] - 0.50211f) < 2e-4f);
    assert_true(fabsf(got[2] - 0.22029f) < 2e-4f);
}

static void xyze_is_brought_to_rec709(void **state)
{
    static const uint8_t white[4] = { 128, 128, 128, 129 };
    struct image im = { 0 };
    struct reason why;
    (void)state;

    assert_int_equal(decode_text("#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n", white, 4, &im, &why), ERR_OK);
    for (int c = 0; c < 3; c++)
        assert_true(fabsf(im.rgb[c] - 1.0f) < 1e-5f);
    image_finish(&im);
}

static void what_does_not_change_the_light_is_passed_over(void **state)
{
    (void)state;

    must_give("#?RADIANCE\n# Made with a camera\nGAMMA=1\nSOFTWARE=any\nVIEW= -vth\n" RGBE, 1.0f, 0.5f, 0.25f);
    must_give("\tEXPOSURE=4\nPIXASPECT=1.0\nrpict -vf a.vf\n" RGBE, 1.0f, 0.5f, 0.25f);
    must_give("FORMAT=32-bit_rle_rgbe\r\nEXPOSURE=1\r", 1.0f, 0.5f, 0.25f);
}

static void headers_that_cannot_be_honoured_are_refused(void **state)
{
    static const struct {
        const char *line;
        enum err code;
    } rows[] = {
        { "FORMAT=32-bit_rle_cmyk", ERR_UNSUPPORTED },
        { "GAMMA=2.2", ERR_UNSUPPORTED },
        { "EXPOSURE=0", ERR_FORMAT },
        { "EXPOSURE=-1", ERR_FORMAT },
        { "EXPOSURE=nan", ERR_FORMAT },
        { "EXPOSURE=1e300", ERR_FORMAT },
        { "EXPOSURE=", ERR_FORMAT },
        { "EXPOSURE=1 2", ERR_FORMAT },
        { "COLORCORR=1 2", ERR_FORMAT },
        { "COLORCORR=1 0 1", ERR_FORMAT },
        { "PRIMARIES=0.64 0.33", ERR_FORMAT },
        { "PRIMARIES=0 0 1 1 2 2 .3 .3", ERR_FORMAT },
    };
    char text[256], name[32];
    (void)state;

    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        snprintf(text, sizeof(text), "#?RADIANCE\n%s\n\n-Y 1 +X 1\n", rows[i].line);
        snprintf(name, sizeof(name), "%.*s", (int)strcspn(rows[i].line, "="), rows[i].line);
        must_refuse_text(text, "\200\200\200\200", 4, rows[i].code, name);
    }
}

static void sizes_that_make_no_image_are_refused(void **state)
{
    static const struct {
        const char *line;
        enum err code;
    } rows[] = {
        { "-Y 1 +Y 1", ERR_FORMAT },
        { "-Y 1", ERR_FORMAT },
        { "Y 1 X 1", ERR_FORMAT },
        { "-Y 0 +X 1", ERR_FORMAT },
        { "-Y 1 +X 1 1", ERR_FORMAT },
        { "-Y -1 +X 1", ERR_FORMAT },
        { "-Y 16385 +X 1", ERR_RANGE },
        { "-Y 1 +X 16385", ERR_RANGE },
        { "-Y 16384 +X 16384", ERR_RANGE },
        { "-Y 1 +X 99999999999999999999999999", ERR_RANGE },
        { "", ERR_FORMAT },
        { "-Y 4294967297 +X 1", ERR_RANGE },
    };
    char text[256];
    (void)state;

    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        snprintf(text, sizeof(text), "#?RADIANCE\n\n%s\n", rows[i].line);
        must_refuse_text(text, "\200\200\200\200", 4, rows[i].code,
                         rows[i].code == ERR_RANGE ? "too large" : "byte 12");
    }
}

static void sizes_that_the_file_cannot_hold_take_no_memory(void **state)
{
    static const char text[] = "#?RADIANCE\n\n-Y 8192 +X 16384\nabcdefgh";
    struct image im = { 0 };
    struct reason why;
    (void)state;

    assert_int_equal(decode_text(text, "", 0, &im, &why), ERR_FORMAT);
    assert_non_null(strstr(why.text, "16384x8192 texels cannot fit into"));
    assert_null(im.rgb);
}

static void scanlines_that_do_not_fit_are_refused_with_their_place(void **state)
{
    static const char header[] = "#?RADIANCE\n\n-Y 2 +X 9\n"; /* 22 bytes */
    static const struct {
        const char *pixels;
        size_t count;
        const char *about;
    } rows[] = {
        { "\2\2\0\10aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", 36, "scanline 0, byte 22: has 8 texels in an image of 9" },
        { "\2\2\0\11\212aaaaaaaaaaaaaaaaaaaaaaaaaaaa", 32,
          "scanline 0, byte 26: a run of 10 texels exceeds the row of 9" },
        { "\2\2\0\11\210a\2aaaaaaaaaaaaaaaaaaaaaaaaaa", 32,
          "scanline 0, byte 28: a run of 2 texels exceeds the row of 9" },
        { "\2\2\0\11\0aaaaaaaaaaaaaaaaaaaaaaaaaaaaa", 32, "scanline 0, byte 26: a run of 0 texels" },
        { "\2\2\0\11\211a\211b\211c\211d\2\2\0\11\211a\211b\211c\211", 23, "scanline 1, byte 45: the file ends here" },
        { "\1\1\1\1aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", 40, "scanline 0, byte 22: a run without a preceding texel" },
        { "aaaa\1\1\1\11aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", 40, "scanline 0, byte 26: a run of 9 texels exceeds" },
        { "aaaa\1\1\1\1\1\1\1\1aaaaaaaaaaaaaaaaaaaaaaaaaaaa", 40, "scanline 0, byte 30: a run of 256 texels exceeds" },
    };
    (void)state;

    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++)
        must_refuse_text(header, rows[i].pixels, rows[i].count, ERR_FORMAT, rows[i].about);
}

static const struct hdr_recipe small[] = {
    { .scanlines = 3, .length = 5, .encoding = HDR_FLAT },
    { .scanlines = 4, .length = 20, .encoding = HDR_FLAT, .first = "+X", .second = "-Y" },
    { .scanlines = 4, .length = 20, .encoding = HDR_OLD_RLE, .header = RGBE "\nEXPOSURE=2" },
    { .scanlines = 4, .length = 300, .encoding = HDR_OLD_RLE, .first = "-X", .second = "+Y" },
    { .scanlines = 4, .length = 20, .encoding = HDR_NEW_RLE, .header = "FORMAT=32-bit_rle_xyze\nCOLORCORR=1 2 3" },
    { .scanlines = 2, .length = 140, .encoding = HDR_NEW_RLE, .header = "PRIMARIES=.7 .3 .2 .7 .1 .1 .33 .33" },
};

static void a_file_cut_at_any_byte_is_refused(void **state)
{
    (void)state;

    for (size_t i = 0; i < sizeof(small) / sizeof(small[0]); i++) {
        size_t size;
        uint8_t *bytes = hdr_make(&small[i], &size);
        must_refuse_each_cut(bytes, size);
        free(bytes);
    }
}

static void turned_bits_are_survived(void **state)
{
    (void)state;

    for (size_t i = 0; i < sizeof(small) / sizeof(small[0]); i++) {
        size_t size;
        uint8_t *bytes = hdr_make(&small[i], &size);
        must_survive_turned_bits(bytes, size);
        free(bytes);
    }
}

static void headers_without_an_end_are_refused(void **state)
{
    (void)state;

    must_refuse_text("#?RADIANCE", "", 0, ERR_FORMAT, "byte 10: the header does not end");
    must_refuse_text("#?RADIANCE\nEXPOSURE=1\n", "", 0, ERR_FORMAT, "byte 22: the header does not end");
    must_refuse_text("#?RADIANCE\n\n", "", 0, ERR_FORMAT, "byte 12: the line with the image's size is missing");
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(each_encoding_decodes),
    cmocka_unit_test(each_orientation_comes_out_upright),
    cmocka_unit_test(what_hdr_write_packs_is_read_back),
    cmocka_unit_test(every_exponent_is_a_power_of_two_and_zero_is_black),
    cmocka_unit_test(exposure_and_correction_divide_and_multiply_up),
    cmocka_unit_test(primaries_are_brought_to_rec709),
    cmocka_unit_test(xyze_is_brought_to_rec709),
    cmocka_unit_test(what_does_not_change_the_light_is_passed_over),
    cmocka_unit_test(headers_that_cannot_be_honoured_are_refused),
    cmocka_unit_test(sizes_that_make_no_image_are_refused),
    cmocka_unit_test(sizes_that_the_file_cannot_hold_take_no_memory),
    cmocka_unit_test(scanlines_that_do_not_fit_are_refused_with_their_place),
    cmocka_unit_test(a_file_cut_at_any_byte_is_refused),
    cmocka_unit_test(turned_bits_are_survived),
    cmocka_unit_test(headers_without_an_end_are_refused),
};

UNIT_MAIN(tests)
