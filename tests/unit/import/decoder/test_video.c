/* A stream through relight-video: JPEG images as packets, their texels and times, and faults by the stream's name. */
#include "support/unit.h"

#include "import/decoder/decoder.h"

#include <libavcodec/avcodec.h>
#include <math.h>
#include <turbojpeg.h>

#define SIDE 16

static const struct stream_format motion_jpeg = { .codec = AV_CODEC_ID_MJPEG,
                                                  .pixel_format = AV_PIX_FMT_NONE,
                                                  .profile = FF_PROFILE_UNKNOWN,
                                                  .level = FF_LEVEL_UNKNOWN,
                                                  .primaries = 2,
                                                  .transfer = 2,
                                                  .matrix = 2,
                                                  .width = SIDE,
                                                  .height = SIDE,
                                                  .codec_name = "mjpeg" };

/* Linear light with a white of 255: grey is its code value. */
static const struct video_desc desc = { .format = &motion_jpeg,
                                        .colour = { .transfer = SIGNAL_LINEAR, .peak_cdm2 = 255.0 },
                                        .name = "clip.mp4" };

static struct decoder *start(void)
{
    struct decoder *d = NULL;
    struct reason why = { "" };

    if (decoder_create(&(struct decoder_desc){ .video = true }, &d, &why))
        fail_msg("%s", why.text);
    return d;
}

static unsigned char *grey_jpeg(int level, unsigned long *size)
{
    unsigned char *out = NULL, codes[3 * SIDE * SIDE];
    tjhandle tj = tjInitCompress();

    memset(codes, level, sizeof(codes));
    *size = 0;
    assert_int_equal(tjCompress2(tj, codes, SIDE, 0, SIDE, TJPF_RGB, &out, size, TJSAMP_444, 100, 0), 0);
    tjDestroy(tj);
    return out;
}

static void send(struct decoder *d, int level, int64_t time_us)
{
    struct video_image picture;
    struct reason why = { "" };
    unsigned long size;
    unsigned char *jpeg = grey_jpeg(level, &size);

    if (video_packet(d, &desc, &(struct video_packet){ jpeg, size, time_us, false }, &picture, &why))
        fail_msg("%s", why.text);
    assert_true(picture.ready);
    assert_int_equal(picture.time_us, time_us);
    tjFree(jpeg);
}

static void must_show(struct decoder *d, double level)
{
    struct frame f = { .kind = FRAME_TEXELS };
    struct video_state seen;
    struct reason why = { "" };

    if (video_convert(d, &desc, &f, &seen, &why))
        fail_msg("%s", why.text);
    assert_true(f.width == SIDE && f.height == SIDE);
    assert_int_equal(seen.transfer, SIGNAL_LINEAR);
    assert_false(seen.assumed);
    for (size_t i = 0; i < 3 * SIDE * SIDE; i++)
        assert_true(fabs((double)f.rgb[i] - level) < 1.5);
    frame_finish(&f);
}

static void images_come_out_with_their_light_and_times(void **state)
{
    struct decoder *d = start();
    struct video_image picture;
    struct reason why = { "" };
    (void)state;

    assert_false(video_is_open(d));
    assert_int_equal(video_open(d, &desc, &why), ERR_OK);
    assert_true(video_is_open(d));
    for (int i = 0; i < 3; i++) {
        send(d, 50 + 70 * i, 1000000 + 40000 * i);
        must_show(d, 50.0 + 70.0 * i);
        assert_int_equal(video_next(d, &desc, &picture, &why), ERR_OK);
        assert_false(picture.ready);
    }
    assert_int_equal(video_drain(d, &desc, &picture, &why), ERR_OK);
    assert_false(picture.ready);
    assert_int_equal(video_flush(d, &desc, &why), ERR_OK);
    send(d, 99, 7);
    must_show(d, 99.0);
    decoder_destroy(d);
}

static void must_say(enum err got, enum err want, const struct reason *why, const char *about)
{
    if (got != want || strncmp(why->text, "clip.mp4: ", 10) != 0 || !strstr(why->text, about))
        fail_msg("\"%s\" (%s), not clip.mp4 and \"%s\"", why->text, err_text(got), about);
}

static void faults_are_told_by_the_streams_name(void **state)
{
    struct stream_format unknown = motion_jpeg;
    struct video_desc other = desc;
    struct decoder *d = start();
    struct video_image picture;
    struct video_state seen;
    struct frame f = { .kind = FRAME_TEXELS };
    struct reason why = { "" };
    (void)state;

    unknown.codec = 0;
    snprintf(unknown.codec_name, sizeof(unknown.codec_name), "odd");
    other.format = &unknown;
    must_say(video_open(d, &other, &why), ERR_UNSUPPORTED, &why, "no decoder for its codec, odd");
    assert_false(video_is_open(d));
    assert_int_equal(video_open(d, &desc, &why), ERR_OK);
    must_say(video_convert(d, &desc, &f, &seen, &why), ERR_FORMAT, &why, "no frame was decoded");
    must_say(video_packet(d, &desc, &(struct video_packet){ (const uint8_t *)"no JPEG at all", 14, 0, false }, &picture,
                          &why),
             ERR_FORMAT, &why, "a packet cannot be decoded: Invalid data");
    assert_true(video_is_open(d)); /* the stream goes on */
    send(d, 120, 5);
    must_show(d, 120.0);
    decoder_destroy(d);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(images_come_out_with_their_light_and_times),
    cmocka_unit_test(faults_are_told_by_the_streams_name),
};
UNIT_MAIN(tests)
