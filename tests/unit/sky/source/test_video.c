/* Video files as sources, made by ffmpeg: from code values of known ramps to cd/m^2, frame numbers, and damaged files.
 */
#include "support/unit.h"

#include "import/decoder/decoder.h"
#include "import/demux/demux.h"
#include "sky/source/clips.h"
#include "sky/source/source.h"

#include <math.h>

/* The formulas of the standards, written here once more, in the other direction where there is one. */
static double pq_code(double cdm2) /* the inverse EOTF [ITU-R BT.2100-2, Table 4] */
{
    const double y = pow(cdm2 / 10000.0, 0.1593017578125);
    return pow((0.8359375 + 18.8515625 * y) / (1.0 + 18.6875 * y), 78.84375);
}

/* cd/m^2 at a signal, by bisection of its inverse. */
static double pq_light(double signal)
{
    double low = 0.0, high = 10000.0;

    for (int i = 0; i < 200; i++) {
        const double middle = 0.5 * (low + high);
        *(pq_code(middle) < signal ? &low : &high) = middle;
    }
    return low;
}

static double hlg_code(double scene) /* the OETF [ITU-R BT.2100-2, Table 5] */
{
    return scene <= 1.0 / 12.0 ? sqrt(3.0 * scene) : 0.17883277 * log(12.0 * scene - 0.28466892) + 0.55991073;
}

static double hlg_light(double signal) /* on the reference display of 1000 cd/m^2, for greys */
{
    double low = 0.0, high = 1.0;

    for (int i = 0; i < 200; i++) {
        const double middle = 0.5 * (low + high);
        *(hlg_code(middle) < signal ? &low : &high) = middle;
    }
    return 1000.0 * pow(low, 1.2);
}

static double bt1886_light(double signal)
{
    return 203.0 * pow(signal, 2.4);
}

static double srgb_light(double signal)
{
    return 203.0 * (signal <= 0.04045 ? signal / 12.92 : pow((signal + 0.055) / 1.055, 2.4));
}

static struct source *open_clip(const struct source_desc *d)
{
    struct source *s = NULL;
    struct reason why = { "" };

    if (source_open(d, &s, &why))
        fail_msg("%s", why.text);
    return s;
}

/* Every band of the frame has the light of its code value, to 1 %, and no colour. */
static void check_ramp(const struct frame *f, unsigned depth, bool full, double (*light)(double))
{
    const double unit = 1u << (depth - 8), black = full ? 0.0 : 16.0 * unit,
                 span = full ? (double)((1u << depth) - 1u) : 219.0 * unit;

    assert_int_equal(f->kind, FRAME_TEXELS);
    assert_int_equal(f->width, CLIP_WIDTH);
    assert_int_equal(f->height, CLIP_HEIGHT);
    for (unsigned k = 0; k < CLIP_BANDS; k++) {
        const double want = light((clips_code(depth, full, k) - black) / span);
        const float *rgb = f->rgb + 3 * ((size_t)CLIP_WIDTH * CLIP_HEIGHT / 2 + 16 * k + 8);
        for (int c = 0; c < 3; c++)
            if (fabs((double)rgb[c] - want) > 0.01 * want + 1e-3)
                fail_msg("band %u, channel %d: %g cd/m^2 instead of %g", k, c, (double)rgb[c], want);
    }
}

/* Encodes the ramp with these flags of ffmpeg, and checks the first frame of the clip. */
static void check_clip(const char *name, unsigned depth, bool full, const char *flags, double (*light)(double),
                       const struct source_desc *more)
{
    struct source_desc d = more ? *more : (struct source_desc){ .spec = NULL };
    struct folder folder;
    struct frame f = { 0 };
    struct reason why = { "" };

    folder_make(&folder);
    clips_ramp(folder_path(&folder, "ramp.yuv"), depth, full, 3);
    d.spec = folder_path(&folder, name);
    if (depth == 8)
        clips_run(CLIP_RAW8 "%s %s", folder_path(&folder, "ramp.yuv"), flags, d.spec);
    else
        clips_run(CLIP_RAW10 "%s %s", folder_path(&folder, "ramp.yuv"), flags, d.spec);
    struct source *s = open_clip(&d);
    if (source_next(s, &f, &why))
        fail_msg("%s", why.text);
    check_ramp(&f, depth, full, light);
    assert_int_equal(f.number, 0);
    assert_int_equal(f.capture_us, 0);
    source_close(s);
    frame_finish(&f);
    folder_remove(&folder);
}

#define TAGS(primaries, transfer, matrix)                                                                              \
    "-color_primaries " primaries " -color_trc " transfer " -colorspace " matrix " -color_range tv "
#define X265 "-c:v libx265 -x265-params log-level=error:lossless=1:colorprim=bt2020:colormatrix=bt2020nc:transfer="

static void pq_of_hevc_arrives_in_candelas(void **state)
{
    (void)state;
    check_clip("ramp.mp4", 10, false, X265 "smpte2084 " TAGS("bt2020", "smpte2084", "bt2020nc"), pq_light, NULL);
}

static void pq_of_vp9_arrives_in_candelas(void **state)
{
    (void)state;
    check_clip("ramp.webm", 10, false,
               "-c:v libvpx-vp9 -lossless 1 -cpu-used 8 -deadline realtime " TAGS("bt2020", "smpte2084", "bt2020nc"),
               pq_light, NULL);
}

static void pq_of_av1_arrives_in_candelas(void **state)
{
    (void)state;
    check_clip("ramp.mkv", 10, false,
               "-c:v libaom-av1 -crf 0 -b:v 0 -cpu-used 8 " TAGS("bt2020", "smpte2084", "bt2020nc"), pq_light, NULL);
}

static void hlg_arrives_as_on_its_reference_display(void **state)
{
    (void)state;
    check_clip("ramp.mov", 10, false, X265 "arib-std-b67 " TAGS("bt2020", "arib-std-b67", "bt2020nc"), hlg_light, NULL);
}

static void eight_bits_of_bt709_are_bt1886(void **state)
{
    (void)state;
    check_clip("ramp.mp4", 8, false, "-c:v libx264 -qp 0 " TAGS("bt709", "bt709", "bt709"), bt1886_light, NULL);
}

static void full_range_and_srgb_are_honoured(void **state)
{
    (void)state;
    check_clip(
        "ramp.mkv", 8, true,
        "-c:v libx264 -qp 0 -color_range pc -x264-params fullrange=on:transfer=iec61966-2-1 -color_trc iec61966-2-1",
        srgb_light, NULL);
}

static double half_as_bright_srgb(double signal)
{
    return 0.5 * srgb_light(signal);
}

static void flags_override_what_a_stream_says(void **state)
{
    (void)state;
    check_clip("ramp.mp4", 8, false, "-c:v libx264 -qp 0 " TAGS("bt709", "bt709", "bt709"), half_as_bright_srgb,
               &(struct source_desc){ .colour = { SIGNAL_SRGB, 101.5 } });
    check_clip("ramp.mp4", 10, false, X265 "bt709 " TAGS("bt2020", "bt709", "bt2020nc"), pq_light,
               &(struct source_desc){ .colour = { SIGNAL_PQ, 0.0 } });
}

/* One colour by its code values, through three matrices, two sets of primaries and both ranges; linear, so that the
 * numbers stand for themselves. */
static void matrices_and_primaries_are_undone(void **state)
{
    static const struct {
        const char *params, *flags;
        double black, span, half, colours; /* code values: of black, white less black, no colour, colours' span */
        double red_cr, green_cb, green_cr, blue_cb;
        bool wide;
    } cases[] = {
        { "colormatrix=bt709:colorprim=bt709:range=limited", "-colorspace bt709 -color_primaries bt709 -color_range tv",
          64.0, 876.0, 512.0, 896.0, 1.5748, 0.1873, 0.4681, 1.8556, false },
        { "colormatrix=smpte170m:colorprim=bt709:range=full",
          "-colorspace smpte170m -color_primaries bt709 -color_range pc", 0.0, 1023.0, 512.0, 1023.0, 1.402, 0.344136,
          0.714136, 1.772, false },
        { "colormatrix=bt2020nc:colorprim=bt2020:range=limited",
          "-colorspace bt2020nc -color_primaries bt2020 -color_range tv", 64.0, 876.0, 512.0, 896.0, 1.4746, 0.16455,
          0.57135, 1.8814, true },
    };
    /* Linear BT.2020 to BT.709 [ITU-R BT.2087-0, Annex 2]. */
    static const double narrow[3][3] = { { 1.6605, -0.5876, -0.0728 },
                                         { -0.1246, 1.1329, -0.0083 },
                                         { -0.0182, -0.1006, 1.1187 } };
    struct folder folder;
    (void)state;

    folder_make(&folder);
    for (size_t k = 0; k < sizeof(cases) / sizeof(cases[0]); k++) {
        const double y = (560.0 - cases[k].black) / cases[k].span, cb = (400.0 - cases[k].half) / cases[k].colours,
                     cr = (640.0 - cases[k].half) / cases[k].colours;
        const double rgb[3] = { y + cases[k].red_cr * cr, y - cases[k].green_cb * cb - cases[k].green_cr * cr,
                                y + cases[k].blue_cb * cb };
        struct frame f = { 0 };
        struct reason why = { "" };
        const char *clip = folder_path(&folder, "colour.mkv");
        clips_run(
            "ffmpeg -v error -y -f lavfi -i "
            "color=black:s=64x32:r=25:d=0.1,format=yuv444p10le,geq=lum=560:cb=400:cr=640 -c:v libx265 -x265-params "
            "log-level=error:lossless=1:transfer=linear:%s -color_trc linear %s %s",
            cases[k].params, cases[k].flags, clip);
        struct source *s = open_clip(&(struct source_desc){ .spec = clip });
        assert_int_equal(source_next(s, &f, &why), ERR_OK);
        for (int c = 0; c < 3; c++) {
            const double want =
                203.0 *
                (cases[k].wide ? narrow[c][0] * rgb[0] + narrow[c][1] * rgb[1] + narrow[c][2] * rgb[2] : rgb[c]);
            const double got = (double)f.rgb[3 * 1000 + c];
            if (fabs(got - want) > 0.002 * 203.0)
                fail_msg("clip %zu, channel %d: %g instead of %g", k, c, got, want);
        }
        source_close(s);
        frame_finish(&f);
    }
    folder_remove(&folder);
}

/* Twelve frames of rising grey, with B frames and a keyframe every five: number n has code value 20 + 15 n. */
static void make_steps(const char *clip)
{
    clips_run("ffmpeg -v error -y -f lavfi -i \"color=black:s=64x32:r=10:d=1.2,geq=lum=20+15*N:cb=128:cr=128\" "
              "-c:v libx264 -qp 0 -g 5 -bf 2 -pix_fmt yuv420p %s",
              clip);
}

static unsigned step_of(const struct frame *f)
{
    const double signal = pow((double)f->rgb[0] / 203.0, 1.0 / 2.4);
    return (unsigned)((219.0 * signal + 16.0 - 20.0) / 15.0 + 0.5);
}

static void frames_come_in_order_and_all_of_them(void **state)
{
    struct folder folder;
    struct frame f = { 0 };
    struct reason why = { "" };
    (void)state;

    folder_make(&folder);
    const char *clip = folder_path(&folder, "steps.mp4");
    make_steps(clip);
    struct source *s = open_clip(&(struct source_desc){ .spec = clip });
    assert_int_equal(source_kind(s), SOURCE_VIDEO);
    assert_int_equal(source_count(s), 12);
    assert_true(fabs(source_rate(s) - 10.0) < 1e-6);
    for (unsigned n = 0; n < 12; n++) {
        assert_int_equal(source_next(s, &f, &why), ERR_OK);
        assert_int_equal(f.number, n);
        assert_int_equal(step_of(&f), n);
    }
    assert_int_equal(source_next(s, &f, &why), ERR_END);
    assert_int_equal(source_next(s, &f, &why), ERR_END);
    source_close(s);

    s = open_clip(&(struct source_desc){ .spec = clip, .frames = { true, 7, 8 }, .loop = true });
    assert_int_equal(source_count(s), 2);
    for (unsigned n = 0; n < 5; n++) { /* and again, as a loop */
        assert_int_equal(source_next(s, &f, &why), ERR_OK);
        assert_int_equal(f.number, 7 + n % 2);
        assert_int_equal(step_of(&f), 7 + n % 2);
    }
    source_close(s);
    frame_finish(&f);
    folder_remove(&folder);
}

/* A live stream may bring nothing new when its image is asked for at last: the decoder must still have it, also after
 * a packet without an image, and when the stream begins anew. */
static void an_image_stays_until_there_is_another(void **state)
{
    struct folder folder;
    struct frame f = { 0 };
    struct reason why = { "" };
    struct demux *demux;
    struct decoder *decoder;
    struct demux_item item;
    struct video_image picture = { .ready = false };
    struct video_state colour;
    (void)state;

    folder_make(&folder);
    const char *clip = folder_path(&folder, "steps.mkv");
    make_steps(clip);
    assert_int_equal(demux_open(&(struct demux_desc){ .spec = clip }, &demux, &why), ERR_OK);
    assert_int_equal(decoder_create(&(struct decoder_desc){ .video = true }, &decoder, &why), ERR_OK);
    assert_int_equal(demux_next(demux, 10000, &item, &why), ERR_OK);
    assert_int_equal(item.event, DEMUX_FORMAT);
    const struct stream_format format = item.format;
    uint8_t extra[1024];
    assert_true(item.size <= sizeof(extra));
    memcpy(extra, item.bytes, item.size);
    const struct video_desc d = { .format = &format, .extra = extra, .extra_size = item.size, .name = "clip" };
    assert_int_equal(video_open(decoder, &d, &why), ERR_OK);
    while (!picture.ready) {
        assert_int_equal(demux_next(demux, 10000, &item, &why), ERR_OK);
        const struct video_packet packet = { item.bytes, item.size, item.time_us, item.hidden };
        assert_int_equal(video_packet(decoder, &d, &packet, &picture, &why), ERR_OK);
    }
    for (int again = 0; again < 2; again++) {
        while (picture.ready)
            assert_int_equal(video_next(decoder, &d, &picture, &why), ERR_OK);
        if (video_convert(decoder, &d, &f, &colour, &why))
            fail_msg("%s", why.text);
        assert_int_equal(step_of(&f), 0);
        assert_int_equal(video_open(decoder, &d, &why), ERR_OK);
    }
    assert_int_equal(video_flush(decoder, &d, &why), ERR_OK);
    assert_int_equal(video_convert(decoder, &d, &f, &colour, &why), ERR_FORMAT); /* another place of the stream */
    decoder_destroy(decoder);
    demux_close(demux);
    frame_finish(&f);
    folder_remove(&folder);
}

static void seeking_goes_to_that_very_frame(void **state)
{
    static const unsigned to[] = { 8, 3, 11, 0, 6 };
    struct folder folder;
    struct frame f = { 0 };
    struct reason why = { "" };
    (void)state;

    folder_make(&folder);
    const char *clip = folder_path(&folder, "steps.mkv");
    make_steps(clip);
    struct source *s = open_clip(&(struct source_desc){ .spec = clip, .loop = true });
    assert_int_equal(source_next(s, &f, &why), ERR_OK);
    for (size_t i = 0; i < sizeof(to) / sizeof(to[0]); i++) {
        assert_true(source_seek(s, to[i]));
        for (unsigned n = to[i]; n < to[i] + 2; n++) {
            assert_int_equal(source_next(s, &f, &why), ERR_OK);
            assert_int_equal(f.number, n % 12);
            assert_int_equal(step_of(&f), n % 12);
        }
    }
    source_close(s);
    frame_finish(&f);
    folder_remove(&folder);
}

/* Cut at many places, and with bytes overwritten: what can be decoded comes, then an end or an error, never a hang. */
static void damaged_files_end_or_are_refused(void **state)
{
    struct folder folder;
    struct frame f = { 0 };
    (void)state;

    folder_make(&folder);
    const char *whole = folder_path(&folder, "whole.ts"), *clip = folder_path(&folder, "cut.ts");
    make_steps(whole);
    for (int k = 0; k < 12; k++) {
        struct source *s = NULL;
        struct reason why = { "" };
        if (k < 6)
            clips_run("head -c $(($(stat -c %%s %s) * %d / 6)) %s > %s", whole, k, whole, clip);
        else
            clips_run("cp %s %s && head -c 700 /dev/urandom | dd of=%s bs=1 seek=$(($(stat -c %%s %s) * %d / 6)) "
                      "conv=notrunc status=none",
                      whole, clip, clip, whole, k - 6);
        enum err e = source_open(&(struct source_desc){ .spec = clip }, &s, &why);
        unsigned frames = 0;
        while (!e && frames < 20) {
            e = source_next(s, &f, &why);
            frames += !e;
        }
        assert_true(frames <= 12);
        assert_true(e == ERR_END || why.text[0]);
        if (k > 7)
            assert_true(frames > 0);
        source_close(s);
    }
    frame_finish(&f);
    folder_remove(&folder);
}

static void file_without_a_keyframe_says_so(void **state)
{
    struct folder folder;
    struct frame f = { 0 };
    struct reason why = { "" };
    struct source *s = NULL;
    (void)state;

    folder_make(&folder);
    const char *whole = folder_path(&folder, "whole.mkv"), *clip = folder_path(&folder, "headless.mkv");
    clips_run("ffmpeg -v error -y -f lavfi -i testsrc2=s=64x32:r=25:d=1 -c:v libx264 -g 100 -pix_fmt yuv420p %s",
              whole);
    clips_run("ffmpeg -v error -y -i %s -c copy -bsf:v noise=drop=key -copyinkf %s", whole, clip);
    enum err e = source_open(&(struct source_desc){ .spec = clip }, &s, &why);
    if (!e)
        e = source_next(s, &f, &why);
    assert_int_equal(e, ERR_FORMAT);
    assert_non_null(strstr(why.text, "keyframe"));
    source_close(s);
    frame_finish(&f);
    folder_remove(&folder);
}

/* Two clips one after the other: in MPEG-TS the new size is in the packets, in FLV it comes with new extra data of the
 * codec; `skip` is the length of the second file's own header. */
static void check_change(const char *end, unsigned skip)
{
    struct folder folder;
    struct frame f = { 0 };
    struct reason why = { "" };
    unsigned small = 0, large = 0;
    char both[16], first[16], second[16];

    folder_make(&folder);
    snprintf(both, sizeof(both), "both.%s", end);
    snprintf(first, sizeof(first), "a.%s", end);
    snprintf(second, sizeof(second), "b.%s", end);
    const char *clip = folder_path(&folder, both), *a = folder_path(&folder, first), *b = folder_path(&folder, second);
    clips_run("ffmpeg -v error -y -f lavfi -i testsrc2=s=64x32:r=25:d=0.4 -c:v libx264 -pix_fmt yuv420p %s", a);
    clips_run("ffmpeg -v error -y -f lavfi -i testsrc2=s=128x64:r=25:d=0.4 -c:v libx264 -pix_fmt yuv420p %s", b);
    clips_run("{ cat %s; tail -c +%u %s; } > %s", a, skip + 1, b, clip);
    struct source *s = open_clip(&(struct source_desc){ .spec = clip });
    while (source_next(s, &f, &why) == ERR_OK) {
        small += f.width == 64;
        large += f.width == 128;
    }
    if (small != 10 || large != 10)
        fail_msg("%s: %u small and %u large frames: %s", end, small, large, why.text);
    source_close(s);
    frame_finish(&f);
    folder_remove(&folder);
}

static void size_and_codec_may_change_on_the_way(void **state)
{
    (void)state;
    check_change("ts", 0);
    check_change("flv", 13);
}

/* A stream whose curve is BT.1886 first and sRGB then, as its frames say: each is read by its own. */
static void colour_may_change_on_the_way(void **state)
{
    struct folder folder;
    struct frame f = { 0 };
    struct reason why = { "" };
    unsigned count = 0;
    (void)state;

    folder_make(&folder);
    const char *ramp = folder_path(&folder, "ramp.yuv"), *a = folder_path(&folder, "a.ts"),
               *b = folder_path(&folder, "b.ts"), *clip = folder_path(&folder, "both.ts");
    clips_ramp(ramp, 8, false, 3);
    clips_run(CLIP_RAW8 "-c:v libx264 -qp 0 " TAGS("bt709", "bt709", "bt709") "%s", ramp, a);
    clips_run(CLIP_RAW8
              "-c:v libx264 -qp 0 -x264-params transfer=iec61966-2-1 " TAGS("bt709", "iec61966-2-1", "bt709") "%s",
              ramp, b);
    clips_run("cat %s %s > %s", a, b, clip);
    struct source *s = open_clip(&(struct source_desc){ .spec = clip });
    for (; source_next(s, &f, &why) == ERR_OK; count++)
        check_ramp(&f, 8, false, count < 3 ? bt1886_light : srgb_light);
    assert_int_equal(count, 6);
    source_close(s);
    frame_finish(&f);
    folder_remove(&folder);
}

/* A billion frames a second, in the container and in the codec. */
static void absurd_rates_are_not_believed(void **state)
{
    struct folder folder;
    struct frame f = { 0 };
    struct reason why = { "" };
    (void)state;

    folder_make(&folder);
    const char *clip = folder_path(&folder, "fast.mkv");
    clips_run("ffmpeg -v error -y -f lavfi -i testsrc2=s=64x32:r=1000000:d=0.00001 -c:v libx264 -pix_fmt yuv420p "
              "-default_mode infer %s",
              clip);
    struct source *s = open_clip(&(struct source_desc){ .spec = clip });
    assert_true(source_rate(s) > 0.0 && source_rate(s) <= 240.0);
    assert_int_equal(source_next(s, &f, &why), ERR_OK);
    source_close(s);
    frame_finish(&f);
    folder_remove(&folder);
}

/* A playlist in a file that names another file; a text file named like a video. */
static void files_that_refer_to_others_are_refused(void **state)
{
    struct folder folder;
    struct reason why = { "" };
    struct source *s = NULL;
    (void)state;

    folder_make(&folder);
    clips_run(":");
    folder_put(&folder, "list.mp4", "#EXTM3U\n#EXT-X-TARGETDURATION:2\n#EXTINF:2,\n/etc/passwd\n#EXT-X-ENDLIST\n");
    assert_true(source_open(&(struct source_desc){ .spec = folder_path(&folder, "list.mp4") }, &s, &why) != ERR_OK);
    assert_non_null(strstr(why.text, "list.mp4"));
    folder_put(&folder, "text.mkv", "this is no video\n");
    assert_true(source_open(&(struct source_desc){ .spec = folder_path(&folder, "text.mkv") }, &s, &why) != ERR_OK);
    assert_non_null(strstr(why.text, "not a video that this program can read"));
    folder_remove(&folder);
}

static void urls_of_other_schemes_are_named(void **state)
{
    static const struct {
        const char *spec, *said;
    } rows[] = {
        { "ftp://host/sky.mp4", "ftp:// is not a source; sources are rtsp://" },
        { "file:///sky.mp4", "name files without file://, as /sky.mp4" },
        { "rtsp:///stream", "the host is missing; expected rtsp://HOST" },
        { "rtmp://:1935/a/b", "the host is missing" },
        { "srt://user:word@camera", "srt://camera: the port is missing; expected srt://HOST:PORT" },
        { "v4l2:video0", "expected v4l2:/dev/videoN" },
        { "v4l2:/etc/passwd", "is not a camera" },
        { "/dev/video7", "a camera is named v4l2:/dev/video7" },
    };
    struct source *s = NULL;
    struct reason why = { "" };
    char name[64];
    (void)state;

    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++) {
        assert_int_equal(source_open(&(struct source_desc){ .spec = rows[i].spec }, &s, &why), ERR_USAGE);
        if (!strstr(why.text, rows[i].said))
            fail_msg("%s: %s", rows[i].spec, why.text);
    }
    assert_string_equal(source_name("rtsp://user:p@ss@camera/1", name, sizeof(name)), "rtsp://camera/1");
    assert_string_equal(source_name("sky@home.exr", name, sizeof(name)), "sky@home.exr");
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(pq_of_hevc_arrives_in_candelas),         cmocka_unit_test(pq_of_vp9_arrives_in_candelas),
    cmocka_unit_test(pq_of_av1_arrives_in_candelas),          cmocka_unit_test(hlg_arrives_as_on_its_reference_display),
    cmocka_unit_test(eight_bits_of_bt709_are_bt1886),         cmocka_unit_test(full_range_and_srgb_are_honoured),
    cmocka_unit_test(flags_override_what_a_stream_says),      cmocka_unit_test(matrices_and_primaries_are_undone),
    cmocka_unit_test(frames_come_in_order_and_all_of_them),   cmocka_unit_test(seeking_goes_to_that_very_frame),
    cmocka_unit_test(damaged_files_end_or_are_refused),       cmocka_unit_test(file_without_a_keyframe_says_so),
    cmocka_unit_test(size_and_codec_may_change_on_the_way),   cmocka_unit_test(absurd_rates_are_not_believed),
    cmocka_unit_test(files_that_refer_to_others_are_refused), cmocka_unit_test(urls_of_other_schemes_are_named),
    cmocka_unit_test(colour_may_change_on_the_way),           cmocka_unit_test(an_image_stays_until_there_is_another),
};

UNIT_MAIN(tests)
