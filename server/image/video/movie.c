#include "image/video/movie.h"

#include "base/file_store.h"
#include "base/mem.h"
#include "image/video/ffmpeg.h"
#include "image/video/yuv.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define KEY_S 2.0 /* a key frame at least this often, for seeking */

struct movie {
    struct movie_desc desc;
    char container[8];
    AVCodecContext *encoder;
    AVFrame *frame;
    AVPacket *packet;
    int64_t count;
    struct file_draft draft;
    struct mux *mux; /* opened with the first packet */
};

bool movie_available(void)
{
    return true;
}

static bool is_av1(const struct movie *m)
{
    return strcmp(m->container, "webm") == 0;
}

static const char *encoder_name(const struct movie *m)
{
    return is_av1(m) ? "libsvtav1" : "libx264";
}

static enum err say_refused(const struct movie *m, struct reason *why)
{
    return err_say(why, ERR_UNSUPPORTED, "libavcodec's %s refuses a video of %ux%u at %g frames per second%s",
                   encoder_name(m), m->desc.width, m->desc.height, m->desc.rate,
                   is_av1(m) ? "; AV1 needs 64x64 pixels at least" : "");
}

static bool set_all(void *encoder, const char *const (*pairs)[2])
{
    for (; (*pairs)[0]; pairs++)
        if (ffmpeg()->av_opt_set(encoder, (*pairs)[0], (*pairs)[1], 0) < 0)
            return false;
    return true;
}

/* Metadata as in mux.c, in the stream too: some players read it there. */
static bool set_h264(const struct movie *m)
{
    static const char *const any[][2] = { { "preset", "medium" }, { NULL, NULL } };
    static const char *const hdr[][2] = {
        { "x264-params", "mastering-display=G(8500,39850)B(6550,2300)R(35400,14600)WP(15635,16450)L(10000000,1):"
                         "cll=1000,0" },
        { NULL, NULL },
    };
    void *o = m->encoder->priv_data;

    return set_all(o, any) && (!m->desc.pq || set_all(o, hdr)) &&
           ffmpeg()->av_opt_set_double(o, "crf", 38.0 - 0.2 * m->desc.quality, 0) >= 0; /* as h264.c */
}

static bool set_av1(const struct movie *m)
{
    static const char *const any[][2] = { { "preset", "8" }, { NULL, NULL } };
    static const char *const hdr[][2] = {
        { "svtav1-params", "mastering-display=G(0.17,0.797)B(0.131,0.046)R(0.708,0.292)WP(0.3127,0.329)L(1000,0.0001):"
                           "content-light=1000,0" },
        { NULL, NULL },
    };
    void *o = m->encoder->priv_data;

    setenv("SVT_LOG", "1", 0); /* errors only: it writes to standard error */
    return set_all(o, any) && (!m->desc.pq || set_all(o, hdr)) &&
           ffmpeg()->av_opt_set_int(o, "crf", lrint(60.0 - 0.4 * m->desc.quality), 0) >= 0;
}

static void describe(AVCodecContext *c, const struct movie_desc *d)
{
    const AVRational rate = ffmpeg()->av_d2q(d->rate, 1001000);

    c->width = (int)(d->width + d->width % 2);
    c->height = (int)(d->height + d->height % 2);
    c->pix_fmt = d->pq ? AV_PIX_FMT_YUV420P10 : AV_PIX_FMT_YUV420P;
    c->color_range = AVCOL_RANGE_MPEG;
    c->color_primaries = d->pq ? AVCOL_PRI_BT2020 : AVCOL_PRI_BT709;
    c->color_trc = d->pq ? AVCOL_TRC_SMPTE2084 : AVCOL_TRC_BT709;
    c->colorspace = d->pq ? AVCOL_SPC_BT2020_NCL : AVCOL_SPC_BT709;
    c->chroma_sample_location = AVCHROMA_LOC_LEFT;
    c->framerate = rate;
    c->time_base = av_inv_q(rate);
    c->gop_size = (int)fmax(1.0, lrint(KEY_S * d->rate));
    c->flags |= AV_CODEC_FLAG_GLOBAL_HEADER;
}

static enum err open_encoder(struct movie *m, struct reason *why)
{
    const AVCodec *codec = ffmpeg()->avcodec_find_encoder_by_name(encoder_name(m));

    if (!codec)
        return err_say(why, ERR_UNSUPPORTED, "this libavcodec has no encoder %s", encoder_name(m));
    m->encoder = ffmpeg()->avcodec_alloc_context3(codec);
    m->frame = ffmpeg()->av_frame_alloc();
    m->packet = ffmpeg()->av_packet_alloc();
    if (!m->encoder || !m->frame || !m->packet)
        return err_say(why, ERR_NOMEM, "out of memory");
    describe(m->encoder, &m->desc);
    if (!(is_av1(m) ? set_av1(m) : set_h264(m)) || ffmpeg()->avcodec_open2(m->encoder, codec, NULL) < 0)
        return say_refused(m, why);
    m->frame->width = m->encoder->width;
    m->frame->height = m->encoder->height;
    m->frame->format = m->encoder->pix_fmt;
    return ffmpeg()->av_frame_get_buffer(m->frame, 0) < 0 ? err_say(why, ERR_NOMEM, "out of memory") : ERR_OK;
}

enum err movie_create(const struct movie_desc *desc, struct movie **out, struct reason *why)
{
    struct movie *m = mem_alloc(1, sizeof(*m));

    *out = NULL;
    if (!m)
        return err_say(why, ERR_NOMEM, "out of memory");
    if (!ffmpeg()) {
        mem_free(m);
        return err_say(why, ERR_UNSUPPORTED, "libavcodec and libavformat cannot be loaded");
    }
    m->desc = *desc;
    m->desc.path = m->desc.container = NULL;
    ffmpeg()->av_log_set_level(AV_LOG_QUIET); /* errors are returned */
    snprintf(m->container, sizeof(m->container), "%s", desc->container);
    enum err e = open_encoder(m, why);
    if (!e)
        e = file_draft_begin(&m->draft, desc->path, why);
    if (e) {
        movie_destroy(m);
        return e;
    }
    *out = m;
    return ERR_OK;
}

/* What can be written only front to back, as a pipe, gets its index in pieces. */
static const char *options_of(const struct movie *m)
{
    if (strcmp(m->container, "mp4") != 0)
        return NULL;
    return m->draft.replace ? "movflags=faststart+write_colr" : "movflags=frag_keyframe+empty_moov+write_colr";
}

static enum err open_mux(struct movie *m, struct reason *why)
{
    const AVCodecContext *c = m->encoder;
    const struct mux_stream stream = {
        .codec = is_av1(m) ? MUX_AV1 : MUX_H264,
        .colour = m->desc.pq ? MUX_PQ : MUX_BT709,
        .width = (uint32_t)c->width,
        .height = (uint32_t)c->height,
        .rate_num = c->framerate.num,
        .rate_den = c->framerate.den,
        .header = c->extradata,
        .header_size = (size_t)c->extradata_size,
    };
    const bool matroska = strcmp(m->container, "mkv") == 0;
    const struct mux_desc desc = {
        .format = matroska ? "matroska" : m->container,
        .path = m->draft.name,
        .options = options_of(m),
    };

    return mux_open(&desc, &stream, &m->mux, why);
}

/* Packets that the encoder has ready. */
static enum err drain(struct movie *m, struct reason *why)
{
    enum err e = ERR_OK;

    while (!e) {
        const int code = ffmpeg()->avcodec_receive_packet(m->encoder, m->packet);
        if (code == AVERROR(EAGAIN) || code == AVERROR_EOF)
            return ERR_OK;
        if (code < 0)
            return err_say(why, code == AVERROR(ENOMEM) ? ERR_NOMEM : ERR_UNSUPPORTED, "%s failed (error %d)",
                           encoder_name(m), code);
        const AVPacket *p = m->packet;
        if (!m->mux)
            e = open_mux(m, why);
        if (!e)
            e = mux_write(m->mux,
                          &(struct mux_packet){ .bytes = p->data,
                                                .size = (size_t)p->size,
                                                .shown = p->pts,
                                                .decoded = p->dts,
                                                .key = p->flags & AV_PKT_FLAG_KEY },
                          why);
        ffmpeg()->av_packet_unref(m->packet);
    }
    return e;
}

enum err movie_add(struct movie *m, const uint16_t *rgb, struct reason *why)
{
    const struct movie_desc *d = &m->desc;

    if (ffmpeg()->av_frame_make_writable(m->frame) < 0)
        return err_say(why, ERR_NOMEM, "out of memory");
    const AVFrame *f = m->frame;
    yuv_limited_from_rgb(
        rgb, d->width, d->height, d->pq,
        &(struct yuv_planes){ f->data[0], f->data[1], f->data[2], f->linesize[0], f->linesize[1], f->linesize[2] });
    m->frame->pts = m->count++;
    if (ffmpeg()->avcodec_send_frame(m->encoder, m->frame) < 0)
        return say_refused(m, why);
    return drain(m, why);
}

enum err movie_finish(struct movie *m, struct reason *why)
{
    enum err e = ERR_OK;

    if (m->count == 0)
        return ERR_OK;
    if (ffmpeg()->avcodec_send_frame(m->encoder, NULL) < 0)
        return say_refused(m, why);
    e = drain(m, why);
    if (e)
        return e;
    e = mux_close(m->mux, true, why);
    m->mux = NULL;
    if (!e)
        e = file_draft_commit(&m->draft, why);
    return e;
}

void movie_destroy(struct movie *m)
{
    struct reason ignored;

    if (!m)
        return;
    if (mux_close(m->mux, false, &ignored)) /* meaningless if no end is written */
        m->mux = NULL;
    file_draft_discard(&m->draft);
    ffmpeg()->avcodec_free_context(&m->encoder);
    ffmpeg()->av_frame_free(&m->frame);
    ffmpeg()->av_packet_free(&m->packet);
    mem_free(m);
}
