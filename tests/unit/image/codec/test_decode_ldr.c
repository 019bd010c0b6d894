/* JPEG and PNG files as light: code values by sRGB's curve, PNG's 16 bits linear; and other formats, refused by name.
 */
#include "support/unit.h"

#include "base/mem.h"
#include "image/codec/decode.h"

#include <math.h>
#include <png.h>
#include <turbojpeg.h>

#define SIDE 16

static double light_of(double code) /* 0..1 [IEC 61966-2-1] */
{
    return code <= 0.04045 ? code / 12.92 : pow((code + 0.055) / 1.055, 2.4);
}

static void decode(const void *bytes, size_t size, struct image *im)
{
    struct reason why;

    if (decode_image(bytes, size, "picture", im, &why))
        fail_msg("%s", why.text);
    assert_true(im->low_range && decode_is_low_range(bytes, size));
}

static void must_refuse(const void *bytes, size_t size, enum err code, const char *about)
{
    struct image im = { .max_side = SIDE };
    struct reason why;

    const enum err e = decode_image(bytes, size, "sky.bin", &im, &why);
    if (e != code)
        fail_msg("%s, not %s: %s", err_text(e), err_text(code), why.text);
    assert_ptr_equal(strstr(why.text, "sky.bin: "), why.text);
    if (!strstr(why.text, about))
        fail_msg("\"%s\" does not say \"%s\"", why.text, about);
    image_finish(&im);
}

static void must_be(const struct image *im, size_t texel, double r, double g, double b, double tolerance)
{
    const double want[3] = { r, g, b };

    for (size_t c = 0; c < 3; c++)
        if (!(fabs((double)im->rgb[3 * texel + c] - want[c]) <= tolerance))
            fail_msg("texel %zu, component %zu: %.5f, not %.5f", texel, c, (double)im->rgb[3 * texel + c], want[c]);
}

/* The left half of one colour, the right half of another. */
static unsigned char *make_jpeg(int format, unsigned long *size)
{
    unsigned char *out = NULL, codes[SIDE * SIDE * 4];
    tjhandle tj = tjInitCompress();
    const int channels = tjPixelSize[format];

    for (int i = 0; i < SIDE * SIDE; i++) {
        const unsigned char left[4] = { 200, 40, 90, 0 }, right[4] = { 8, 160, 250, 0 };
        memcpy(codes + i * channels, i % SIDE < SIDE / 2 ? left : right, (size_t)channels);
    }
    *size = 0;
    assert_int_equal(tjCompress2(tj, codes, SIDE, 0, SIDE, format, &out, size,
                                 format == TJPF_GRAY ? TJSAMP_GRAY : TJSAMP_444, 100, 0),
                     0);
    tjDestroy(tj);
    return out;
}

static void a_jpeg_is_light_by_the_curve_of_srgb(void **state)
{
    struct image im = { 0 };
    unsigned long size;
    unsigned char *jpeg = make_jpeg(TJPF_RGB, &size);
    (void)state;

    decode(jpeg, size, &im);
    assert_true(im.width == SIDE && im.height == SIDE);
    for (size_t y = 0; y < SIDE; y++) {
        must_be(&im, y * SIDE, light_of(200 / 255.0), light_of(40 / 255.0), light_of(90 / 255.0), 0.02);
        must_be(&im, y * SIDE + SIDE - 1, light_of(8 / 255.0), light_of(160 / 255.0), light_of(250 / 255.0), 0.02);
    }
    tjFree(jpeg);
    jpeg = make_jpeg(TJPF_GRAY, &size);
    decode(jpeg, size, &im);
    must_be(&im, 3, light_of(200 / 255.0), light_of(200 / 255.0), light_of(200 / 255.0), 0.02);
    tjFree(jpeg);
    image_finish(&im);
}

static void a_jpeg_that_is_damaged_large_or_of_inks_is_refused(void **state)
{
    unsigned long size;
    unsigned char *jpeg = make_jpeg(TJPF_RGB, &size);
    struct image im = { .max_side = SIDE - 1 };
    struct reason why;
    (void)state;

    must_refuse(jpeg, 20, ERR_FORMAT, "JPEG: ");
    must_refuse(jpeg, size - size / 4, ERR_FORMAT, "JPEG: ");
    assert_int_equal(decode_image(jpeg, size, "sky.bin", &im, &why), ERR_RANGE);
    tjFree(jpeg);
    jpeg = make_jpeg(TJPF_CMYK, &size);
    must_refuse(jpeg, size, ERR_UNSUPPORTED, "CMYK");
    tjFree(jpeg);
    image_finish(&im);
}

static size_t make_png(unsigned format, const void *texels, void *out, size_t room)
{
    png_image image = { .version = PNG_IMAGE_VERSION, .width = 2, .height = 2, .format = format };
    png_alloc_size_t size = room;

    assert_true(png_image_write_to_memory(&image, out, &size, 0, texels, 0, NULL));
    return size;
}

static void a_png_is_light_whatever_its_depth_and_channels(void **state)
{
    static const uint8_t rgb[12] = { 0, 0, 0, 255, 128, 10, 3, 200, 64, 255, 255, 255 },
                         rgba[16] = { 0, 0, 0, 255, 255, 128, 10, 255, 3, 200, 64, 255, 9, 9, 9, 255 },
                         grey[4] = { 0, 10, 128, 255 };
    static const uint16_t wide[12] = { 0, 0, 0, 65535, 6553, 100, 32768, 1000, 20000, 655, 65, 6 };
    struct image im = { 0 };
    uint8_t png[4096];
    (void)state;

    decode(png, make_png(PNG_FORMAT_RGB, rgb, png, sizeof(png)), &im);
    assert_true(im.width == 2 && im.height == 2);
    must_be(&im, 1, 1.0, light_of(128 / 255.0), light_of(10 / 255.0), 1e-5);
    must_be(&im, 2, light_of(3 / 255.0), light_of(200 / 255.0), light_of(64 / 255.0), 1e-5);
    must_be(&im, 3, 1.0, 1.0, 1.0, 1e-6);
    decode(png, make_png(PNG_FORMAT_RGBA, rgba, png, sizeof(png)), &im);
    must_be(&im, 1, 1.0, light_of(128 / 255.0), light_of(10 / 255.0), 1e-5);
    must_be(&im, 3, light_of(9 / 255.0), light_of(9 / 255.0), light_of(9 / 255.0), 1e-5);
    decode(png, make_png(PNG_FORMAT_GRAY, grey, png, sizeof(png)), &im);
    must_be(&im, 2, light_of(128 / 255.0), light_of(128 / 255.0), light_of(128 / 255.0), 1e-5);
    decode(png, make_png(PNG_FORMAT_LINEAR_RGB, wide, png, sizeof(png)), &im);
    must_be(&im, 1, 1.0, 6553 / 65535.0, 100 / 65535.0, 2e-4);
    must_be(&im, 2, 32768 / 65535.0, 1000 / 65535.0, 20000 / 65535.0, 2e-4);
    image_finish(&im);
}

static void a_png_that_is_damaged_or_large_is_refused(void **state)
{
    static const uint8_t rgb[12] = { 1 };
    static const uint16_t wide[12] = { 1 };
    struct image im = { .max_side = 1 };
    struct reason why;
    uint8_t png[4096];
    (void)state;

    size_t size = make_png(PNG_FORMAT_RGB, rgb, png, sizeof(png));
    must_refuse(png, 20, ERR_FORMAT, "PNG: ");
    must_refuse(png, size - 16, ERR_FORMAT, "PNG: ");
    assert_int_equal(decode_image(png, size, "sky.bin", &im, &why), ERR_RANGE);
    size = make_png(PNG_FORMAT_LINEAR_RGB, wide, png, sizeof(png));
    must_refuse(png, size - 16, ERR_FORMAT, "PNG: ");
    image_finish(&im);
}

static void other_formats_are_refused_by_their_names(void **state)
{
    static const struct {
        const char *bytes, *name;
    } rows[] = { { "II*\0........", "a TIFF" },         { "MM\0*........", "a TIFF" },
                 { "RIFF....WEBP", "a WebP" },          { "....ftypavif", "an AVIF or HEIC" },
                 { "....ftypheic", "an AVIF or HEIC" }, { "....ftypheix", "an AVIF or HEIC" },
                 { "....ftypisom", "an MP4 video" },    { "\x1a\x45\xdf\xa3........", "a Matroska or WebM video" },
                 { "#EXTM3U.....", "an HLS playlist" }, { "GIF89a......", "a GIF" } };
    (void)state;

    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++)
        must_refuse(rows[i].bytes, 12, ERR_UNSUPPORTED, rows[i].name);
    must_refuse("RIFF....WAVE", 12, ERR_FORMAT, "starts with 52 49 46 46");
    must_refuse("\xff\xd8", 2, ERR_FORMAT, "starts with ff d8 00 00");
    must_refuse("\x89PN", 3, ERR_FORMAT, "starts with 89 50 4e 00");
    must_refuse("GIF", 3, ERR_FORMAT, "starts with 47 49 46 00");
    must_refuse("", 0, ERR_FORMAT, "empty");
}

static void a_file_of_more_than_a_megabyte_is_read_whole(void **state)
{
    enum { LONG = 1200000 };
    char path[] = "/tmp/test_decode_ldr.XXXXXX";
    struct image im = { 0 };
    struct reason why;
    unsigned long size;
    unsigned char *jpeg = make_jpeg(TJPF_RGB, &size), *bytes = mem_alloc(LONG, 1);
    (void)state;

    memcpy(bytes, jpeg, size); /* what follows a JPEG's end is passed over */
    const int fd = mkstemp(path);
    FILE *f = fdopen(fd, "wb");
    assert_non_null(f);
    assert_int_equal(fwrite(bytes, 1, LONG, f), LONG);
    fclose(f);
    if (decode_file(path, &im, &why))
        fail_msg("%s", why.text);
    must_be(&im, 0, light_of(200 / 255.0), light_of(40 / 255.0), light_of(90 / 255.0), 0.02);
    remove(path);
    assert_int_equal(decode_file(path, &im, &why), ERR_IO);
    image_finish(&im);
    mem_free(bytes);
    tjFree(jpeg);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_jpeg_is_light_by_the_curve_of_srgb),
    cmocka_unit_test(a_jpeg_that_is_damaged_large_or_of_inks_is_refused),
    cmocka_unit_test(a_png_is_light_whatever_its_depth_and_channels),
    cmocka_unit_test(a_png_that_is_damaged_or_large_is_refused),
    cmocka_unit_test(other_formats_are_refused_by_their_names),
    cmocka_unit_test(a_file_of_more_than_a_megabyte_is_read_whole),
};
UNIT_MAIN(tests)
