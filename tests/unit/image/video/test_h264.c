/* What the encoder writes is read by libavcodec's own decoder. */
#include "image/video/h264.h"

#include "support/unit.h"

#include <libavcodec/avcodec.h>

#include <math.h>

#define WIDTH 162
#define HEIGHT 94

static uint8_t picture[HEIGHT][WIDTH][3];

/* Smooth, as skies are, with one hard edge that wanders. */
static void paint(int frame)
{
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            picture[y][x][0] = (uint8_t)(120.0 + 100.0 * sin((x + frame) * 0.05));
            picture[y][x][1] = (uint8_t)(x > y + 2 * frame ? 200 : 90);
            picture[y][x][2] = (uint8_t)(y * 2);
        }
}

struct reader {
    AVCodecContext *context;
    AVFrame *frame;
};

static void reader_open(struct reader *r)
{
    r->context = avcodec_alloc_context3(avcodec_find_decoder(AV_CODEC_ID_H264));
    r->frame = av_frame_alloc();
    assert_non_null(r->context);
    assert_non_null(r->frame);
    r->context->thread_count = 1;
    assert_int_equal(avcodec_open2(r->context, NULL, NULL), 0);
}

static void reader_shut(struct reader *r)
{
    avcodec_free_context(&r->context);
    av_frame_free(&r->frame);
}

/* Into r->frame; the image comes out at once or not at all. */
static int reader_take(struct reader *r, const struct h264_output *out)
{
    AVPacket *p = av_packet_alloc();

    assert_non_null(p);
    assert_int_equal(av_new_packet(p, (int)out->size), 0); /* with the padding that the decoder wants */
    memcpy(p->data, out->bytes, out->size);
    int failed = avcodec_send_packet(r->context, p);
    if (!failed)
        failed = avcodec_receive_frame(r->context, r->frame);
    av_packet_free(&p);
    return failed;
}

/* Root mean square over pixels and channels, in code values, of what is in r->frame against `image`. */
static double rms_error(const struct reader *r)
{
    const AVFrame *f = r->frame;
    double sum = 0.0;

    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            const double luma = f->data[0][y * f->linesize[0] + x];
            const double cb = f->data[1][y / 2 * f->linesize[1] + x / 2] - 128.0;
            const double cr = f->data[2][y / 2 * f->linesize[2] + x / 2] - 128.0;
            const double red = luma + 1.5748 * cr, blue = luma + 1.8556 * cb;
            const double green = (luma - 0.2126 * red - 0.0722 * blue) / 0.7152;
            sum += pow(red - picture[y][x][0], 2.0) + pow(green - picture[y][x][1], 2.0) +
                   pow(blue - picture[y][x][2], 2.0);
        }
    return sqrt(sum / (WIDTH * HEIGHT * 3));
}

static struct h264_output encode(struct h264_encoder *h, int quality, bool key)
{
    const struct h264_desc desc = { .width = WIDTH, .height = HEIGHT, .quality = quality, .key = key };
    struct h264_output out;

    assert_int_equal(h264_encode(h, &picture[0][0][0], &desc, &out), ERR_OK);
    assert_true(out.size > 0);
    return out;
}

static void every_image_comes_out_at_once_and_only_the_first_is_a_key(void **state)
{
    struct h264_encoder *h = h264_encoder_create();
    struct reader r;
    double worst = 0.0;
    (void)state;

    assert_true(h264_available());
    assert_non_null(h);
    reader_open(&r);
    for (int frame = 0; frame < 60; frame++) {
        paint(frame);
        const struct h264_output out = encode(h, 90, false);
        assert_int_equal(out.key, frame == 0);
        assert_int_equal(reader_take(&r, &out), 0);
        worst = fmax(worst, rms_error(&r));
    }
    /* 4:2:0 smears the coloured edge; swapped planes, narrow range or BT.601 in place of BT.709 give 8 and more */
    printf("rms error at most %.2f\n", worst);
    assert_true(worst < 6.0);
    reader_shut(&r);
    h264_encoder_destroy(h);
}

/* The types of its units, one letter each: parameter sets S and P, key K, delta d; others are passed over. */
static void units(const struct h264_output *out, char *types)
{
    for (size_t i = 0; i + 3 < out->size; i++)
        if (out->bytes[i] == 0 && out->bytes[i + 1] == 0 && out->bytes[i + 2] == 1) {
            const int type = out->bytes[i + 3] & 31;
            if (type == 7 || type == 8 || type == 5 || type == 1)
                *types++ = type == 7 ? 'S' : type == 8 ? 'P' : type == 5 ? 'K' : 'd';
        }
    *types = '\0';
}

static void a_key_image_that_was_asked_for_stands_alone(void **state)
{
    struct h264_encoder *h = h264_encoder_create();
    char types[64];
    (void)state;

    for (int frame = 0; frame < 12; frame++) {
        struct reader fresh;
        const bool key = frame == 5 || frame == 6 || frame == 11;
        paint(frame);
        const struct h264_output out = encode(h, 90, key);
        units(&out, types);
        assert_string_equal(types, key || frame == 0 ? "SPK" : "d");
        assert_int_equal(out.key, key || frame == 0);
        if (!key)
            continue;
        reader_open(&fresh);
        assert_int_equal(reader_take(&fresh, &out), 0);
        assert_true(rms_error(&fresh) < 6.0);
        reader_shut(&fresh);
    }
    h264_encoder_destroy(h);
}

static void the_stream_says_what_its_colours_are(void **state)
{
    struct h264_encoder *h = h264_encoder_create();
    struct reader r;
    (void)state;

    paint(0);
    const struct h264_output out = encode(h, 90, true);
    reader_open(&r);
    assert_int_equal(reader_take(&r, &out), 0);
    assert_int_equal(r.frame->color_range, AVCOL_RANGE_JPEG);
    assert_int_equal(r.frame->colorspace, AVCOL_SPC_BT709);
    assert_int_equal(r.frame->color_primaries, AVCOL_PRI_BT709);
    assert_int_equal(r.frame->color_trc, AVCOL_TRC_IEC61966_2_1);
    assert_int_equal(r.context->has_b_frames, 0); /* it need not wait for a later image */
    reader_shut(&r);
    h264_encoder_destroy(h);
}

static void quality_is_heeded_from_one_image_to_the_next(void **state)
{
    struct h264_encoder *h = h264_encoder_create();
    struct reader r;
    double error[3];
    size_t size[3] = { 0 };
    (void)state;

    reader_open(&r);
    for (int i = 0; i < 3; i++) {
        const int quality[] = { 100, 60, 20 };    /* of itself it gets better where little moves */
        for (int frame = 0; frame < 4; frame++) { /* the last of which is looked at */
            paint(8 * i + 2 * frame);
            const struct h264_output out = encode(h, quality[i], false);
            assert_int_equal(reader_take(&r, &out), 0);
            size[i] += out.key ? 0 : out.size;
        }
        error[i] = rms_error(&r);
    }
    assert_true(error[0] < error[1] && error[1] < error[2]);
    assert_true(size[0] > size[1] && size[1] > size[2]);
    reader_shut(&r);
    h264_encoder_destroy(h);
}

static void what_does_not_move_costs_little(void **state)
{
    struct h264_encoder *h = h264_encoder_create();
    (void)state;

    paint(0);
    const size_t key = encode(h, 90, true).size;
    for (int i = 0; i < 10; i++) /* the encoder takes its chance to make it better */
        assert_true(encode(h, 90, false).size * 2 < key);
    h264_encoder_destroy(h);
}

/* Bits that so many grainy images take, of which no pixel has anything to do with the last one's: the worst case. */
static double grainy_bits(struct h264_encoder *h, int count, int64_t step_us, double cap, int64_t *time_us)
{
    static uint32_t random = 1;
    double bits = 0.0;

    for (int i = 0; i < count; i++) {
        uint8_t *bytes = &picture[0][0][0];
        for (size_t k = 0; k < sizeof(picture); k++) {
            random = random * 1664525u + 1013904223u;
            bytes[k] = (uint8_t)(random >> 24);
        }
        *time_us += i % 2 ? step_us / 2 : step_us * 3 / 2; /* they do not come evenly */
        const struct h264_desc desc = { .width = WIDTH,
                                        .height = HEIGHT,
                                        .quality = 90,
                                        .bits_per_second = cap,
                                        .time_us = *time_us,
                                        .key = i % 40 == 9 };
        struct h264_output out;
        assert_int_equal(h264_encode(h, bytes, &desc, &out), ERR_OK);
        bits += 8.0 * (double)out.size;
    }
    return bits;
}

static void a_cap_holds_by_the_time_that_passes(void **state)
{
    static const double steps_s[] = { 1.0 / 60.0, 1.0 / 30.0, 0.1, 0.5 };
    const double cap = 400e3;
    double an_image = 0.0;
    (void)state;

    for (size_t i = 0; i < sizeof(steps_s) / sizeof(steps_s[0]); i++) {
        struct h264_encoder *h = h264_encoder_create();
        const int count = 120;
        int64_t time_us = 0;
        const double bits = grainy_bits(h, count, (int64_t)(1e6 * steps_s[i]), cap, &time_us);
        const double seconds = count * steps_s[i];
        printf("%4.1f a second: %.0f bits a second, %.0f an image\n", 1.0 / steps_s[i], bits / seconds, bits / count);
        /* the bucket is full at first; at the fastest, these images take more than the coarsest quantiser gives */
        if (i > 0)
            assert_true(bits <= 1.05 * cap * (seconds + H264_CAP_S));
        assert_true(bits > an_image * count); /* slower ones have more each */
        an_image = bits / count;
        h264_encoder_destroy(h);
    }
}

static void a_cap_is_heeded_from_one_image_to_the_next(void **state)
{
    struct h264_encoder *h = h264_encoder_create();
    int64_t time_us = 0;
    (void)state;

    const double free_bits = grainy_bits(h, 60, 33333, 0.0, &time_us);
    (void)grainy_bits(h, 20, 33333, 400e3, &time_us);
    const double capped = grainy_bits(h, 60, 33333, 400e3, &time_us), again = grainy_bits(h, 60, 33333, 0.0, &time_us);
    printf("%.0f, capped %.0f, again %.0f bits\n", free_bits, capped, again);
    assert_true(capped <= 1.05 * 400e3 * (2.0 + H264_CAP_S));
    assert_true(free_bits > 2.0 * capped && again > 2.0 * capped);
    h264_encoder_destroy(h);
}

static void any_size_can_be_encoded_and_another_one_begins_anew(void **state)
{
    static const uint32_t sizes[][2] = { { 2, 2 }, { 1, 3 }, { 17, 31 }, { 161, 93 }, { 160, 98 }, { 320, 180 } };
    struct h264_encoder *h = h264_encoder_create();
    static uint8_t rgb[320 * 180 * 3];
    (void)state;

    memset(rgb, 99, sizeof(rgb));
    for (size_t i = 0; i < sizeof(sizes) / sizeof(sizes[0]); i++) {
        const struct h264_desc desc = { .width = sizes[i][0], .height = sizes[i][1], .quality = 90 };
        struct h264_output out;
        struct reader r;
        assert_int_equal(h264_encode(h, rgb, &desc, &out), ERR_OK);
        assert_true(out.key);
        reader_open(&r);
        assert_int_equal(reader_take(&r, &out), 0);
        assert_int_equal(r.frame->width, (desc.width + 1) / 2 * 2);
        assert_int_equal(r.frame->height, (desc.height + 1) / 2 * 2);
        assert_true(abs(r.frame->data[0][0] - 99) <= 2);
        reader_shut(&r);
        assert_int_equal(h264_encode(h, rgb, &desc, &out), ERR_OK);
        assert_false(out.key);
    }
    h264_encoder_destroy(h);
}

static void sides_out_of_range_are_refused(void **state)
{
    static const uint32_t sizes[][2] = { { 0, 2 }, { 2, 0 }, { 16385, 2 }, { 2, 4000000000u } };
    struct h264_encoder *h = h264_encoder_create();
    const uint8_t rgb[12] = { 0 };
    struct h264_output out;
    (void)state;

    for (size_t i = 0; i < sizeof(sizes) / sizeof(sizes[0]); i++) {
        const struct h264_desc desc = { .width = sizes[i][0], .height = sizes[i][1], .quality = 90 };
        assert_int_equal(h264_encode(h, rgb, &desc, &out), ERR_RANGE);
        assert_null(out.bytes);
    }
    h264_encoder_destroy(h);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(every_image_comes_out_at_once_and_only_the_first_is_a_key),
    cmocka_unit_test(a_key_image_that_was_asked_for_stands_alone),
    cmocka_unit_test(the_stream_says_what_its_colours_are),
    cmocka_unit_test(quality_is_heeded_from_one_image_to_the_next),
    cmocka_unit_test(what_does_not_move_costs_little),
    cmocka_unit_test(a_cap_holds_by_the_time_that_passes),
    cmocka_unit_test(a_cap_is_heeded_from_one_image_to_the_next),
    cmocka_unit_test(any_size_can_be_encoded_and_another_one_begins_anew),
    cmocka_unit_test(sides_out_of_range_are_refused),
};
UNIT_MAIN(tests)
