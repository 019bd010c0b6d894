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
    } rows[] = { { "II*\0........", "a TIFF" },
                 { "MM\0*........", "a TIFF" },
                 { "RIFF....WEBP", "a WebP" },
                 { "....ftypavif", "an AVIF or HEIC" },
                 { "....ftypheic", "an AVIF or HEIC" },
                 { "....ftypheix", "an AVIF or HEIC" },
                 { "....ftypisom", "an MP4 video" },
                 { "\x1a\x45\xdf\xa3........", "a Matroska or WebM video" },
                 { "#EXTM3U.....", "an HLS playlist" },
                 { "GIF89a......", "a GIF" },
                 { "glTF........", "a model or scene" },
                 { "ply\nformat a", "a model or scene" },
                 { "{\"asset\":{}}", "a model or scene" },
                 { "Kaydara FBX ", "a model or scene" } };
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

/* ---- What stands beside the texels ---- */

struct buffer {
    uint8_t bytes[20000];
    size_t size;
};

static void append(struct buffer *b, const void *bytes, size_t size)
{
    assert_true(b->size + size <= sizeof(b->bytes));
    memcpy(b->bytes + b->size, bytes, size);
    b->size += size;
}

/* The JPEG with a segment behind its first two bytes. */
static void append_jpeg(struct buffer *b, uint8_t code, const void *segment, size_t length)
{
    unsigned long size;
    unsigned char *jpeg = make_jpeg(TJPF_RGB, &size);
    const uint8_t head[4] = { 0xff, code, (uint8_t)((length + 2) >> 8), (uint8_t)(length + 2) };

    append(b, jpeg, 2);
    append(b, head, 4);
    append(b, segment, length);
    append(b, jpeg + 2, size - 2);
    tjFree(jpeg);
}

static size_t make_exif(uint8_t *out, uint8_t orientation, bool small)
{
    static const uint8_t big[26] = { 'M', 'M', 0, 42, 0, 0, 0, 8, 0, 1, 1, 0x12, 0, 3, 0, 0, 0, 1 },
                         little[26] = { 'I', 'I', 42, 0, 8, 0, 0, 0, 1, 0, 0x12, 1, 3, 0, 1, 0, 0, 0 };

    memcpy(out, small ? little : big, 26);
    out[small ? 18 : 19] = orientation;
    return 26;
}

#define XMP "http://ns.adobe.com/xap/1.0/\0"
#define TURNED "<rdf:Description tiff:Orientation=\""

/* By Exif in both byte orders, or by XMP. */
static void an_orientation_turns_a_jpeg_upright(void **state)
{
    static const uint8_t codes[] = { 3, 6 };
    (void)state;

    for (int k = 0; k < 6; k++) {
        uint8_t segment[80] = "Exif\0";
        struct image im = { 0 };
        struct buffer b = { .size = 0 };
        const int code = k < 4 ? codes[k / 2] : codes[k - 4];
        size_t size = 6 + make_exif(segment + 6, (uint8_t)code, k % 2);
        if (k >= 4) {
            memcpy(segment, XMP TURNED "3\"/>", sizeof(XMP TURNED) + 4);
            size = sizeof(XMP TURNED) + 4;
            segment[sizeof(XMP TURNED) - 1] = (uint8_t)('0' + code);
        }
        append_jpeg(&b, 0xe1, segment, size);
        decode(b.bytes, b.size, &im);
        /* the left half is (200, 40, 90): by 3 it is on the right, by 6 at the top */
        must_be(&im, code == 3 ? SIDE - 1 : 0, light_of(200 / 255.0), light_of(40 / 255.0), light_of(90 / 255.0), 0.05);
        must_be(&im, code == 3 ? 0 : SIDE * (SIDE - 1), light_of(8 / 255.0), light_of(160 / 255.0),
                light_of(250 / 255.0), 0.05);
        for (size_t n = 6; n < size && k < 4; n++) { /* cut Exif is none */
            b.size = 0;
            append_jpeg(&b, 0xe1, segment, n);
            decode(b.bytes, b.size, &im);
        }
        image_finish(&im);
    }
}

static void a_part_of_a_panorama_lies_where_it_says(void **state)
{
    static const char attributes[] =
        XMP "<rdf:Description GPano:FullPanoWidthPixels=\"64\" GPano:FullPanoHeightPixels='32' "
            "GPano:CroppedAreaImageWidthPixels=\"32\" GPano:CroppedAreaImageHeightPixels=\"32\" "
            "GPano:CroppedAreaLeftPixels=\"16\" GPano:CroppedAreaTopPixels=\"0\" GPano:PoseHeadingDegrees=\"90.5\"/>",
                      elements[] = XMP "<GPano:FullPanoWidthPixels>64</GPano:FullPanoWidthPixels>"
                                       "<GPano:FullPanoHeightPixels>32</GPano:FullPanoHeightPixels>"
                                       "<GPano:CroppedAreaImageWidthPixels>32</GPano:CroppedAreaImageWidthPixels>"
                                       "<GPano:CroppedAreaImageHeightPixels>32</GPano:CroppedAreaImageHeightPixels>"
                                       "<GPano:CroppedAreaLeftPixels>16</GPano:CroppedAreaLeftPixels>"
                                       "<GPano:CroppedAreaTopPixels>0</GPano:CroppedAreaTopPixels>";
    struct image im = { 0 };
    (void)state;

    for (int k = 0; k < 2; k++) {
        struct buffer b = { .size = 0 };
        append_jpeg(&b, 0xe1, k ? elements : attributes, k ? sizeof(elements) - 1 : sizeof(attributes) - 1);
        decode(b.bytes, b.size, &im);
        assert_true(im.width == 2 * SIDE && im.height == SIDE); /* half the size that its metadata state */
        must_be(&im, SIDE / 2 - 1, 0, 0, 0, 0.0);
        must_be(&im, SIDE / 2, light_of(200 / 255.0), light_of(40 / 255.0), light_of(90 / 255.0), 0.05);
        assert_non_null(strstr(im.note, "panorama of 32x16"));
        assert_true((strstr(im.note, "90.5 degrees") != NULL) == (k == 0));
    }
    image_finish(&im);
}

/* A first image and a gain map, which is grey 255 in its left half and 0 in the right. */
static void make_ultra_hdr(struct buffer *b, uint8_t code, const void *segment, size_t length)
{
    static const char first[] = XMP "<x hdrgm:Version=\"1.0\"/>";
    uint8_t codes[SIDE * SIDE];
    unsigned char *map = NULL;
    unsigned long size;
    const uint8_t head[4] = { 0xff, code, (uint8_t)((length + 2) >> 8), (uint8_t)(length + 2) };

    for (int i = 0; i < SIDE * SIDE; i++)
        codes[i] = i % SIDE < SIDE / 2 ? 255 : 0;
    tjhandle tj = tjInitCompress();
    assert_int_equal(tjCompress2(tj, codes, SIDE, 0, SIDE, TJPF_GRAY, &map, &size, TJSAMP_GRAY, 100, 0), 0);
    tjDestroy(tj);
    b->size = 0;
    append_jpeg(b, 0xe1, first, sizeof(first) - 1);
    append(b, map, 2);
    append(b, head, 4);
    append(b, segment, length);
    append(b, map + 2, size - 2);
    tjFree(map);
}

static void check_gain(const struct buffer *b)
{
    struct image im = { 0 };
    struct reason why;

    if (decode_image(b->bytes, b->size, "picture", &im, &why))
        fail_msg("%s", why.text);
    assert_false(im.low_range);
    must_be(&im, 1, 8 * light_of(200 / 255.0), 8 * light_of(40 / 255.0), 8 * light_of(90 / 255.0), 0.3);
    must_be(&im, SIDE - 2, light_of(8 / 255.0), light_of(160 / 255.0), light_of(250 / 255.0), 0.05);
    assert_non_null(strstr(im.note, "8 times white"));
    image_finish(&im);
}

static void a_jpeg_with_a_gain_map_is_hdr(void **state)
{
    static const char xmp[] = XMP "<x hdrgm:GainMapMin=\"0\" hdrgm:GainMapMax=\"3\" hdrgm:Gamma=\"1\" "
                                  "hdrgm:OffsetSDR=\"0\" hdrgm:OffsetHDR=\"0\"/>",
                      lists[] = XMP "<hdrgm:GainMapMin><rdf:Seq><rdf:li>0</rdf:li><rdf:li>0</rdf:li><rdf:li>0</rdf:li>"
                                    "</rdf:Seq></hdrgm:GainMapMin><hdrgm:GainMapMax><rdf:Seq><rdf:li>3</rdf:li>"
                                    "<rdf:li>3.0</rdf:li><rdf:li>+3</rdf:li></rdf:Seq></hdrgm:GainMapMax>",
                      plain[] = XMP "<x depth=\"1\"/>";
    /* ISO 21496-1: versions 0, one channel, common denominator 1: headrooms 0 and 3, low 0, high 3, gamma 1, offsets 0
     */
    static const uint8_t common[28 + 5 + 32] =
        "urn:iso:std:iso:ts:21496:-1\0\0\0\0\0\x08\0\0\0\1\0\0\0\0\0\0\0\3\0\0\0\0"
        "\0\0\0\3\0\0\0\1\0\0\0\0\0\0\0";
    uint8_t apart[28 + 5 + 56] = "urn:iso:std:iso:ts:21496:-1";
    static const uint8_t numbers[7] = { 0, 6, 0, 6, 2, 0, 0 }; /* each over 2 */
    struct image im = { 0 };
    struct buffer b;
    (void)state;

    for (int k = 0; k < 7; k++) {
        apart[28 + 5 + 8 * k + 3] = numbers[k];
        apart[28 + 5 + 8 * k + 7] = 2;
    }
    make_ultra_hdr(&b, 0xe1, xmp, sizeof(xmp) - 1);
    check_gain(&b);
    make_ultra_hdr(&b, 0xe1, lists, sizeof(lists) - 1);
    check_gain(&b);
    make_ultra_hdr(&b, 0xe2, common, sizeof(common));
    check_gain(&b);
    make_ultra_hdr(&b, 0xe2, apart, sizeof(apart));
    check_gain(&b);
    make_ultra_hdr(&b, 0xe1, plain, sizeof(plain) - 1); /* some other second image */
    decode(b.bytes, b.size, &im);
    must_be(&im, 1, light_of(200 / 255.0), light_of(40 / 255.0), light_of(90 / 255.0), 0.05);
    image_finish(&im);
}

static void on_write(png_structp png, png_bytep bytes, size_t size)
{
    append(png_get_io_ptr(png), bytes, size);
}

struct png_recipe {
    int type, depth;
    double gamma; /* of gAMA; 0: none */
    bool srgb;
    const uint8_t *cicp;
    uint8_t orientation; /* 0: none */
    const char *profile; /* what ICC profile to give it, by the text it has, or NULL */
    char curve;          /* of the profile: 0 linear, 1 a power, 2 other */
    bool narrow;         /* texels half as wide as high */
    char *xmp;           /* or NULL */
};

/* As much of a profile as libpng wants to see: a description and a curve. */
static void set_profile(png_structp png, png_infop info, const struct png_recipe *r)
{
    uint8_t icc[192] = { 0, 0, 0, 192, [8] = 2, [12] = 'm', 'n', 't', 'r', 'R', 'G', 'B', ' ', 'X', 'Y', 'Z', ' ' };
    static const uint8_t d50[12] = { 0, 0, 0xf6, 0xd6, 0, 1, 0, 0, 0, 0, 0xd3, 0x2d };

    memcpy(icc + 36, "acsp", 4);
    memcpy(icc + 68, d50, 12);
    memcpy(icc + 144, r->profile, strlen(r->profile));
    memcpy(icc + 170, "curv\0\0\0\0\0\0", 10);
    icc[180] = r->curve > 1 ? 4 : 0; /* 1024 entries */
    icc[181] = r->curve > 1 ? 0 : (uint8_t)r->curve;
    png_set_iCCP(png, info, "a name without which libpng finds the chunk too short to be one", 0, icc, sizeof(icc));
}

/* 2 x 1 texels; samples as PNG stores them. */
static void write_png(const struct png_recipe *r, const uint8_t *samples, struct buffer *b)
{
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png_create_info_struct(png);
    uint8_t exif[26];

    b->size = 0;
    assert_false(setjmp(png_jmpbuf(png)));
    png_set_write_fn(png, b, on_write, NULL);
    png_set_IHDR(png, info, 2, 1, r->depth, r->type, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
                 PNG_FILTER_TYPE_DEFAULT);
    if (r->gamma > 0.0)
        png_set_gAMA(png, info, r->gamma);
    if (r->srgb)
        png_set_sRGB(png, info, 0);
    if (r->profile)
        set_profile(png, info, r);
    if (r->narrow)
        png_set_pHYs(png, info, 2, 1, PNG_RESOLUTION_UNKNOWN);
    if (r->xmp)
        png_set_text(png, info, &(png_text){ PNG_ITXT_COMPRESSION_NONE, (char[]){ "XML:com.adobe.xmp" }, r->xmp }, 1);
    if (r->orientation)
        png_set_eXIf_1(png, info, (png_uint_32)make_exif(exif, r->orientation, true), exif);
    if (r->cicp) {
        png_unknown_chunk chunk = { .name = "cICP", .data = (png_bytep)(uintptr_t)r->cicp, .size = 4 };
        chunk.location = PNG_HAVE_IHDR;
        png_set_keep_unknown_chunks(png, PNG_HANDLE_CHUNK_ALWAYS, (png_const_bytep) "cICP", 1);
        png_set_unknown_chunks(png, info, &chunk, 1);
    }
    png_write_info(png, info);
    png_write_row(png, samples);
    png_write_end(png, info);
    png_destroy_write_struct(&png, &info);
}

/* Programs name sRGB also where a profile has its colours alone. */
static void a_profile_other_than_srgb_is_named(void **state)
{
    static const struct {
        const char *profile;
        char curve;
        bool named;
    } rows[] = {
        { "sRGB IEC61966-2.1", 2, false }, { "sRGB built-in", 2, false },      { "Display P3", 2, true },
        { "linear sRGB", 0, true },        { "sRGB with gamma 1.8", 1, true }, { "Adobe RGB (1998)", 1, true }
    };
    static const uint8_t rgb[6] = { 200, 40, 90, 8, 160, 250 };
    struct image im = { 0 };
    struct buffer b;
    (void)state;

    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        write_png(&(struct png_recipe){ PNG_COLOR_TYPE_RGB, 8, .profile = rows[i].profile, .curve = rows[i].curve },
                  rgb, &b);
        decode(b.bytes, b.size, &im);
        if ((strstr(im.note, "its ICC profile is ignored") != NULL) != rows[i].named)
            fail_msg("%s: '%s'", rows[i].profile, im.note);
    }
    image_finish(&im);
}

static void the_shape_of_texels_is_named_or_taken(void **state)
{
    static const uint8_t rgb[6] = { 200, 40, 90, 8, 160, 250 };
    static const uint8_t jfif[] = { 'J', 'F', 'I', 'F', 0, 1, 2, 0, 0, 1, 0, 2, 0, 0 }; /* twice as many downwards */
    struct image im = { 0 };
    struct buffer b;
    (void)state;

    write_png(&(struct png_recipe){ PNG_COLOR_TYPE_RGB, 8, .narrow = true }, rgb, &b);
    decode(b.bytes, b.size, &im);
    assert_string_equal(im.note, "the shape of its pixels, 0.5:1, is ignored");
    b.size = 0;
    append_jpeg(&b, 0xe0, jfif, sizeof(jfif));
    decode(b.bytes, b.size, &im);
    assert_true(im.layout == LAYOUT_LATLONG); /* 2:1 by its shape */
    image_finish(&im);
}

/* 16 bits are the same light as 8: by sRGB's curve, whatever the alpha. */
static void a_png_of_16_bits_is_light_as_one_of_8_is(void **state)
{
    static const uint8_t rgb[12] = { 63, 63, 63, 63, 63, 63, 1, 1, 1, 1, 1, 1 };
    static const uint8_t rgba[16] = { 118, 118, 118, 118, 118, 118, 128, 128, 1, 1, 2, 2, 3, 3, 0, 0 };
    static const uint8_t grey[8] = { 118, 118, 0, 0, 3, 3, 255, 255 };
    struct buffer b;
    struct image im = { 0 };
    (void)state;

    for (int srgb = 0; srgb < 2; srgb++) {
        write_png(&(struct png_recipe){ PNG_COLOR_TYPE_RGB, 16, .srgb = srgb }, rgb, &b);
        decode(b.bytes, b.size, &im);
        must_be(&im, 0, light_of(63 / 255.0), light_of(63 / 255.0), light_of(63 / 255.0), 1e-6);
        must_be(&im, 1, light_of(1 / 255.0), light_of(1 / 255.0), light_of(1 / 255.0), 1e-7);
    }
    write_png(&(struct png_recipe){ PNG_COLOR_TYPE_RGB_ALPHA, 16 }, rgba, &b);
    decode(b.bytes, b.size, &im);
    must_be(&im, 0, light_of(118 / 255.0), light_of(118 / 255.0), light_of(118 / 255.0), 1e-6);
    must_be(&im, 1, light_of(1 / 255.0), light_of(2 / 255.0), light_of(3 / 255.0), 1e-7);
    write_png(&(struct png_recipe){ PNG_COLOR_TYPE_GRAY_ALPHA, 16 }, grey, &b);
    decode(b.bytes, b.size, &im);
    must_be(&im, 0, light_of(118 / 255.0), light_of(118 / 255.0), light_of(118 / 255.0), 1e-6);
    for (int depth = 8; depth <= 16; depth += 8) {
        write_png(&(struct png_recipe){ PNG_COLOR_TYPE_RGB, depth, .gamma = 1.0 }, rgb, &b);
        decode(b.bytes, b.size, &im);
        must_be(&im, 0, 63 / 255.0, 63 / 255.0, 63 / 255.0, 1e-6);
        write_png(&(struct png_recipe){ PNG_COLOR_TYPE_RGB, depth, .gamma = 0.45455 }, rgb, &b);
        decode(b.bytes, b.size, &im);
        must_be(&im, 0, light_of(63 / 255.0), light_of(63 / 255.0), light_of(63 / 255.0), 1e-6);
    }
    image_finish(&im);
}

static void a_png_by_pq_is_hdr_with_203_candelas_at_white(void **state)
{
    static const uint8_t pq709[4] = { 1, 16, 0, 1 }, srgb[4] = { 1, 13, 0, 1 };
    /* 0.751827 of PQ is 1000 cd/m^2, 0.58 about 203 [ITU-R BT.2408] */
    static const uint8_t wide[12] = { 0xc0, 0x77, 0xc0, 0x77, 0xc0, 0x77, 0x94, 0x9d, 0x94, 0x9d, 0x94, 0x9d };
    static const uint8_t narrow[6] = { 192, 192, 192, 148, 148, 148 };
    struct buffer b;
    struct image im = { 0 };
    struct reason why;
    (void)state;

    for (int depth = 8; depth <= 16; depth += 8) {
        write_png(&(struct png_recipe){ PNG_COLOR_TYPE_RGB, depth, .cicp = pq709 }, depth == 8 ? narrow : wide, &b);
        if (decode_image(b.bytes, b.size, "picture", &im, &why))
            fail_msg("%s", why.text);
        assert_false(im.low_range);
        must_be(&im, 0, 1000.0 / 203.0, 1000.0 / 203.0, 1000.0 / 203.0, depth == 8 ? 0.1 : 0.002);
        must_be(&im, 1, 1.0, 1.0, 1.0, 0.02);
        assert_non_null(strstr(im.note, "pq"));
    }
    write_png(&(struct png_recipe){ PNG_COLOR_TYPE_RGB, 8, .cicp = srgb }, narrow, &b);
    decode(b.bytes, b.size, &im);
    must_be(&im, 0, light_of(192 / 255.0), light_of(192 / 255.0), light_of(192 / 255.0), 1e-4);
    image_finish(&im);
}

static void an_orientation_turns_a_png_upright(void **state)
{
    static const uint8_t rgb[6] = { 255, 0, 0, 0, 0, 255 };
    struct buffer b;
    struct image im = { 0 };
    (void)state;

    write_png(&(struct png_recipe){ PNG_COLOR_TYPE_RGB, 8, .orientation = 3 }, rgb, &b);
    decode(b.bytes, b.size, &im);
    must_be(&im, 0, 0, 0, 1, 1e-6);
    must_be(&im, 1, 1, 0, 0, 1e-6);
    write_png(&(struct png_recipe){ PNG_COLOR_TYPE_RGB, 8, .xmp = (char[]){ TURNED "3\"/>" } }, rgb, &b);
    decode(b.bytes, b.size, &im);
    must_be(&im, 0, 0, 0, 1, 1e-6);
    image_finish(&im);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_jpeg_is_light_by_the_curve_of_srgb),
    cmocka_unit_test(a_jpeg_that_is_damaged_large_or_of_inks_is_refused),
    cmocka_unit_test(a_png_is_light_whatever_its_depth_and_channels),
    cmocka_unit_test(a_png_that_is_damaged_or_large_is_refused),
    cmocka_unit_test(an_orientation_turns_a_jpeg_upright),
    cmocka_unit_test(a_part_of_a_panorama_lies_where_it_says),
    cmocka_unit_test(a_jpeg_with_a_gain_map_is_hdr),
    cmocka_unit_test(a_png_of_16_bits_is_light_as_one_of_8_is),
    cmocka_unit_test(a_profile_other_than_srgb_is_named),
    cmocka_unit_test(the_shape_of_texels_is_named_or_taken),
    cmocka_unit_test(a_png_by_pq_is_hdr_with_203_candelas_at_white),
    cmocka_unit_test(an_orientation_turns_a_png_upright),
    cmocka_unit_test(other_formats_are_refused_by_their_names),
    cmocka_unit_test(a_file_of_more_than_a_megabyte_is_read_whole),
};
UNIT_MAIN(tests)
