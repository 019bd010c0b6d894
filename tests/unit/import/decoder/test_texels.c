/* Images as libavcodec leaves them, made by hand, to linear texels: where values lie in memory, where chroma lies
 * among the luma samples, and what is assumed of a stream that does not say its colours. */
#include "support/unit.h"

#include "import/decoder/internal.h"

#include <libavutil/frame.h>
#include <libavutil/pixfmt.h>
#include <math.h>

#define SIDE 4
#define PEAK 255.0 /* cd/m^2: linear light of 8 full bits then is the code value */

static AVFrame *frame(enum AVPixelFormat format, int width, int height)
{
    AVFrame *f = av_frame_alloc();

    f->format = format;
    f->width = width;
    f->height = height;
    assert_int_equal(av_frame_get_buffer(f, 0), 0);
    for (int p = 0; p < 4 && f->buf[p]; p++)
        memset(f->buf[p]->data, 0, f->buf[p]->size);
    f->color_primaries = AVCOL_PRI_BT709;
    f->color_trc = AVCOL_TRC_LINEAR;
    f->colorspace = AVCOL_SPC_BT709;
    f->color_range = AVCOL_RANGE_JPEG;
    return f;
}

static void convert(AVFrame *f, struct image *im)
{
    struct texels t = { .peak_cdm2 = PEAK };
    struct reason why;

    if (texels_convert(&t, f, "picture", im, &why))
        fail_msg("%s", why.text);
    texels_finish(&t);
    av_frame_free(&f);
}

static void must_be(const float *rgb, double r, double g, double b)
{
    const double want[3] = { r, g, b };

    for (int c = 0; c < 3; c++)
        if (!(fabs((double)rgb[c] - want[c]) <= 0.1))
            fail_msg("component %d is %.3f, not %.3f", c, (double)rgb[c], want[c]);
}

static void put16(uint8_t *at, uint32_t v, bool swapped)
{
    at[swapped] = (uint8_t)v;
    at[!swapped] = (uint8_t)(v >> 8);
}

/* The second texel of the second row is R 10, G 200, B 90. */
static void each_arrangement_of_rgb_is_read(void **state)
{
    static const struct {
        enum AVPixelFormat format;
        int step, at[3]; /* bytes of a texel, and where R, G and B are; -1: planes of G, B, R */
    } rows[] = { { AV_PIX_FMT_RGB24, 3, { 0, 1, 2 } }, { AV_PIX_FMT_BGR24, 3, { 2, 1, 0 } },
                 { AV_PIX_FMT_RGBA, 4, { 0, 1, 2 } },  { AV_PIX_FMT_ARGB, 4, { 1, 2, 3 } },
                 { AV_PIX_FMT_BGRA, 4, { 2, 1, 0 } },  { AV_PIX_FMT_GBRP, -1, { 2, 0, 1 } } };
    static const uint8_t value[3] = { 10, 200, 90 };
    (void)state;

    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        AVFrame *f = frame(rows[i].format, SIDE, 2);
        struct image im = { 0 };
        for (int c = 0; c < 3; c++) {
            if (rows[i].step > 0)
                f->data[0][f->linesize[0] + rows[i].step + rows[i].at[c]] = value[c];
            else
                f->data[rows[i].at[c]][f->linesize[rows[i].at[c]] + 1] = value[c];
        }
        convert(f, &im);
        assert_true(im.width == SIDE && im.height == 2);
        must_be(im.rgb + 3 * (SIDE + 1), 10, 200, 90);
        must_be(im.rgb + 3 * SIDE, 0, 0, 0);
        must_be(im.rgb + 3, 0, 0, 0);
        image_finish(&im);
    }
}

static void wide_values_are_read_in_either_order_of_bytes(void **state)
{
    static const struct {
        enum AVPixelFormat format;
        uint32_t code, depth, shift;
        bool swapped;
    } rows[] = { { AV_PIX_FMT_GRAY10LE, 512, 10, 0, false },   { AV_PIX_FMT_GRAY10BE, 513, 10, 0, true },
                 { AV_PIX_FMT_GRAY16LE, 33000, 16, 0, false }, { AV_PIX_FMT_GRAY12BE, 2049, 12, 0, true },
                 { AV_PIX_FMT_P010LE, 515, 10, 6, false },     { AV_PIX_FMT_P016BE, 32769, 16, 0, true } };
    (void)state;

    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        AVFrame *f = frame(rows[i].format, SIDE, 2);
        struct image im = { 0 };
        const double want = PEAK * rows[i].code / ((1u << rows[i].depth) - 1u);
        put16(f->data[0] + 2, rows[i].code << rows[i].shift, rows[i].swapped);
        for (int x = 0; i >= 4 && x < SIDE; x++)
            put16(f->data[1] + 2 * x, 1u << (rows[i].depth - 1 + rows[i].shift), rows[i].swapped);
        convert(f, &im);
        must_be(im.rgb + 3, want, want, want);
        must_be(im.rgb + 6, 0, 0, 0);
        image_finish(&im);
    }
}

/* Luma is 100. Cr is 128 but where the values below stand: 188 and 148 side by side, or above each other. R' = Y' +
 * 1.5748 (Cr - 128). */
static void check_sites(enum AVChromaLocation site, bool down, const double share[SIDE])
{
    AVFrame *f = frame(AV_PIX_FMT_YUV420P, SIDE, SIDE);
    struct image im = { 0 };

    f->chroma_location = site;
    memset(f->data[0], 100, (size_t)f->linesize[0] * SIDE);
    memset(f->data[1], 128, (size_t)f->linesize[1] * SIDE / 2);
    for (int y = 0; y < 2; y++)
        for (int x = 0; x < 2; x++)
            f->data[2][y * f->linesize[2] + x] = (down ? y : x) ? 148 : 188;
    convert(f, &im);
    for (int i = 0; i < SIDE; i++) {
        const double cr = 60.0 + share[i] * (20.0 - 60.0);
        must_be(im.rgb + 3 * (down ? SIDE * i + 2 : 2 * SIDE + i), 100.0 + 1.5748 * cr, 100.0 - 0.46812 * cr, 100.0);
    }
    image_finish(&im);
}

static void chroma_is_interpolated_between_its_sites(void **state)
{
    static const double first[SIDE] = { 0, 0.5, 1, 1 }, middle[SIDE] = { 0, 0.25, 0.75, 1 },
                        last[SIDE] = { 0, 0, 0.5, 1 };
    (void)state;

    check_sites(AVCHROMA_LOC_LEFT, false, first);
    check_sites(AVCHROMA_LOC_LEFT, true, middle);
    check_sites(AVCHROMA_LOC_UNSPECIFIED, false, first);
    check_sites(AVCHROMA_LOC_UNSPECIFIED, true, middle);
    check_sites(AVCHROMA_LOC_CENTER, false, middle);
    check_sites(AVCHROMA_LOC_CENTER, true, middle);
    check_sites(AVCHROMA_LOC_TOPLEFT, false, first);
    check_sites(AVCHROMA_LOC_TOPLEFT, true, first);
    check_sites(AVCHROMA_LOC_TOP, false, middle);
    check_sites(AVCHROMA_LOC_TOP, true, first);
    check_sites(AVCHROMA_LOC_BOTTOMLEFT, false, first);
    check_sites(AVCHROMA_LOC_BOTTOMLEFT, true, last);
    check_sites(AVCHROMA_LOC_BOTTOM, false, middle);
    check_sites(AVCHROMA_LOC_BOTTOM, true, last);
}

/* Cb and Cr side by side in one plane; 4:2:2, whose rows have their own; 4:4:4. */
static void every_subsampling_is_read(void **state)
{
    static const enum AVPixelFormat formats[] = { AV_PIX_FMT_NV12, AV_PIX_FMT_NV21, AV_PIX_FMT_YUV422P,
                                                  AV_PIX_FMT_YUV444P, AV_PIX_FMT_YUYV422 };
    (void)state;

    for (size_t i = 0; i < sizeof(formats) / sizeof(formats[0]); i++) {
        AVFrame *f = frame(formats[i], SIDE, SIDE);
        struct image im = { 0 };
        for (int y = 0; y < SIDE; y++)
            for (int x = 0; x < 2 * SIDE; x++) {
                if (i < 2 && y < SIDE / 2 && x < SIDE)
                    f->data[1][y * f->linesize[1] + x] = (i == 0) == (x % 2 == 0) ? 158 : 98;
                if ((i == 2 && x < SIDE / 2) || (i == 3 && x < SIDE)) {
                    f->data[1][y * f->linesize[1] + x] = 158;
                    f->data[2][y * f->linesize[2] + x] = 98;
                }
                if (i < 4 && x < SIDE)
                    f->data[0][y * f->linesize[0] + x] = (uint8_t)(90 + 5 * y + x);
                if (i == 4) /* Y Cb Y Cr */
                    f->data[0][y * f->linesize[0] + x] = x % 2 == 0   ? (uint8_t)(90 + 5 * y + x / 2)
                                                         : x % 4 == 1 ? 158
                                                                      : 98;
            }
        convert(f, &im);
        for (int k = 0; k < SIDE * SIDE; k++) {
            const double luma = 90.0 + 5 * (k / SIDE) + k % SIDE;
            must_be(im.rgb + 3 * k, luma - 30.0 * 1.5748, luma - 30.0 * 0.18732 + 30.0 * 0.46812, luma + 30.0 * 1.8556);
        }
        image_finish(&im);
    }
}

/* The red that a texel of Cr 158 has tells the matrix: 2 - 2 Kr. */
static double red_of(int width, int height, enum AVColorPrimaries primaries, enum AVColorSpace space)
{
    AVFrame *f = frame(AV_PIX_FMT_YUV444P, width, height);
    struct image im = { 0 };

    f->colorspace = space;
    f->color_primaries = primaries;
    memset(f->data[0], 100, 1);
    memset(f->data[1], 128, 1);
    memset(f->data[2], 158, 1);
    convert(f, &im);
    const double sum = (double)im.rgb[0];
    image_finish(&im);
    return (sum - 100.0) / 30.0;
}

static void a_matrix_that_is_not_stated_follows_size_and_primaries(void **state)
{
    (void)state;
    assert_true(fabs(red_of(1279, 1, AVCOL_PRI_BT709, AVCOL_SPC_UNSPECIFIED) - 1.402) < 1e-3);
    assert_true(fabs(red_of(1280, 1, AVCOL_PRI_BT709, AVCOL_SPC_UNSPECIFIED) - 1.5748) < 1e-3);
    assert_true(fabs(red_of(1, 576, AVCOL_PRI_BT709, AVCOL_SPC_UNSPECIFIED) - 1.402) < 1e-3);
    assert_true(fabs(red_of(1, 577, AVCOL_PRI_BT709, AVCOL_SPC_UNSPECIFIED) - 1.5748) < 1e-3);
    assert_true(fabs(red_of(1, 1, AVCOL_PRI_BT709, AVCOL_SPC_BT709) - 1.5748) < 1e-3);
    assert_true(fabs(red_of(1, 1, AVCOL_PRI_BT2020, AVCOL_SPC_UNSPECIFIED) -
                     red_of(1, 1, AVCOL_PRI_BT2020, AVCOL_SPC_BT2020_NCL)) < 1e-6);
}

static double white_of(enum AVPixelFormat format, enum AVColorRange range, uint8_t code)
{
    AVFrame *f = frame(format, 1, 1);
    struct image im = { 0 };

    f->color_range = range;
    f->data[0][0] = f->data[0][1] = f->data[0][2] = code;
    if (format != AV_PIX_FMT_RGB24)
        f->data[1][0] = f->data[2][0] = 128;
    convert(f, &im);
    const double white = (double)im.rgb[1] / PEAK;
    image_finish(&im);
    return white;
}

static void a_range_that_is_not_stated_follows_the_format(void **state)
{
    static const enum AVPixelFormat full[] = { AV_PIX_FMT_YUVJ420P, AV_PIX_FMT_YUVJ422P, AV_PIX_FMT_YUVJ444P,
                                               AV_PIX_FMT_YUVJ440P, AV_PIX_FMT_RGB24 };
    (void)state;

    for (size_t i = 0; i < sizeof(full) / sizeof(full[0]); i++)
        assert_true(fabs(white_of(full[i], AVCOL_RANGE_UNSPECIFIED, 255) - 1.0) < 1e-3);
    assert_true(fabs(white_of(AV_PIX_FMT_YUV420P, AVCOL_RANGE_UNSPECIFIED, 235) - 1.0) < 1e-3);
    assert_true(fabs(white_of(AV_PIX_FMT_YUV420P, AVCOL_RANGE_JPEG, 255) - 1.0) < 1e-3);
    assert_true(fabs(white_of(AV_PIX_FMT_RGB24, AVCOL_RANGE_MPEG, 235) - 1.0) < 1e-3);
}

static enum err refusal(struct texels *t, enum AVPixelFormat format, int width, struct image *im, struct reason *why)
{
    AVFrame *f = frame(format, width, 2);
    const enum err e = texels_convert(t, f, "clip.mp4", im, why);

    av_frame_free(&f);
    return e;
}

static void formats_without_plain_components_are_refused_by_name(void **state)
{
    static const enum AVPixelFormat barred[] = { AV_PIX_FMT_PAL8, AV_PIX_FMT_MONOBLACK, AV_PIX_FMT_GBRPF32LE,
                                                 AV_PIX_FMT_BAYER_RGGB8, AV_PIX_FMT_RGB565LE };
    struct texels t = { 0 };
    struct image im = { 0 };
    struct reason why;
    (void)state;

    for (size_t i = 0; i < sizeof(barred) / sizeof(barred[0]); i++) {
        assert_int_equal(refusal(&t, barred[i], SIDE, &im, &why), ERR_UNSUPPORTED);
        assert_non_null(strstr(why.text, "clip.mp4: its pixel format"));
    }
    im.max_side = 16;
    assert_int_equal(refusal(&t, AV_PIX_FMT_RGB24, 17, &im, &why), ERR_RANGE);
    assert_int_equal(refusal(&t, AV_PIX_FMT_RGB24, 16, &im, &why), ERR_OK);
    image_finish(&im);
    texels_finish(&t);
}

/* One after the other: a wider image, other colours, and the first ones again. */
static void a_change_of_size_or_colour_is_followed(void **state)
{
    static const int widths[] = { 2, 40, 2, 2 };
    static const enum AVColorRange ranges[] = { AVCOL_RANGE_JPEG, AVCOL_RANGE_JPEG, AVCOL_RANGE_MPEG,
                                                AVCOL_RANGE_JPEG };
    struct texels t = { .peak_cdm2 = PEAK };
    struct image im = { 0 };
    struct reason why;
    (void)state;

    for (int i = 0; i < 4; i++) {
        AVFrame *f = frame(AV_PIX_FMT_GRAY8, widths[i], 1);
        f->color_range = ranges[i];
        f->data[0][widths[i] - 1] = 235;
        assert_int_equal(texels_convert(&t, f, "picture", &im, &why), ERR_OK);
        assert_int_equal(im.width, widths[i]);
        const double want = ranges[i] == AVCOL_RANGE_MPEG ? PEAK : 235.0;
        must_be(im.rgb + 3 * (widths[i] - 1), want, want, want);
        av_frame_free(&f);
    }
    image_finish(&im);
    texels_finish(&t);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(each_arrangement_of_rgb_is_read),
    cmocka_unit_test(wide_values_are_read_in_either_order_of_bytes),
    cmocka_unit_test(chroma_is_interpolated_between_its_sites),
    cmocka_unit_test(every_subsampling_is_read),
    cmocka_unit_test(a_matrix_that_is_not_stated_follows_size_and_primaries),
    cmocka_unit_test(a_range_that_is_not_stated_follows_the_format),
    cmocka_unit_test(formats_without_plain_components_are_refused_by_name),
    cmocka_unit_test(a_change_of_size_or_colour_is_followed),
};
UNIT_MAIN(tests)
