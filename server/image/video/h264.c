#include "image/video/h264.h"

#include "base/log.h"
#include "base/mem.h"
#include "image/video/ffmpeg.h"
#include "image/video/yuv.h"

#include <assert.h>
#include <math.h>

#define SIDE_MAX 16384  /* as IMAGE_MAX_SIDE */
#define NOMINAL 30      /* nominal frames per second for libx264 */
#define ENOUGH_BITS 0.5 /* bits per pixel: three times what a noise-free frame needs at quality 90 */
#define CAP_NONE 1e9    /* bits per second; no limit */
#define CAP_MIN 16e3    /* below this a frame is little more than its header */

struct h264_encoder {
    const AVCodec *codec;
    AVCodecContext *context; /* NULL until the size is known */
    AVFrame *frame;
    AVPacket *packet;
    int64_t count;   /* frames since it was opened */
    int64_t time_us; /* time of the last frame */
};

static const AVCodec *find(void)
{
    return ffmpeg() ? ffmpeg()->avcodec_find_encoder_by_name("libx264") : NULL;
}

bool h264_built(void)
{
    return true;
}

bool h264_available(void)
{
    return find() != NULL;
}

struct h264_encoder *h264_encoder_create(void)
{
    struct h264_encoder *h = find() ? mem_alloc(1, sizeof(*h)) : NULL;

    if (!h)
        return NULL;
    ffmpeg()->av_log_set_level(AV_LOG_QUIET); /* it would log every opening; errors are returned anyway */
    h->codec = find();
    h->frame = ffmpeg()->av_frame_alloc();
    h->packet = ffmpeg()->av_packet_alloc();
    if (!h->frame || !h->packet) {
        h264_encoder_destroy(h);
        return NULL;
    }
    return h;
}

void h264_encoder_destroy(struct h264_encoder *h)
{
    if (!h)
        return;
    ffmpeg()->avcodec_free_context(&h->context);
    ffmpeg()->av_frame_free(&h->frame);
    ffmpeg()->av_packet_free(&h->packet);
    mem_free(h);
}

/* The constant rate factor, smaller is better: 18 for quality 100, 21 for 85, 38 for 1. */
static double rate_factor(int quality)
{
    return 38.0 - 0.2 * quality;
}

/* Zero latency: no frame waits for a later one, and the stream declares that frames are not reordered, which decoders
 * need to output each frame at once. Keyframes appear only on request, each with its parameter sets. */
static enum err set_up(AVCodecContext *c)
{
    const struct {
        const char *key, *value;
    } options[] = {
        { "preset", "superfast" },
        { "tune", "zerolatency" },
        { "forced-idr", "1" },
        { "x264-params", "keyint=infinite:scenecut=0" },
    };

    for (size_t i = 0; i < sizeof(options) / sizeof(options[0]); i++)
        if (ffmpeg()->av_opt_set(c->priv_data, options[i].key, options[i].value, 0) < 0)
            return ERR_UNSUPPORTED;
    /* The input is sRGB with BT.709 primaries; declare it explicitly. */
    c->pix_fmt = AV_PIX_FMT_YUV420P;
    c->color_range = AVCOL_RANGE_JPEG;
    c->colorspace = AVCOL_SPC_BT709;
    c->color_primaries = AVCOL_PRI_BT709;
    c->color_trc = AVCOL_TRC_IEC61966_2_1;
    c->chroma_sample_location = AVCHROMA_LOC_CENTER;
    c->time_base = (AVRational){ 1, NOMINAL }; /* only the rate cap uses it */
    c->framerate = (AVRational){ NOMINAL, 1 };
    c->max_b_frames = 0;
    c->thread_count = 1; /* the other processors are rendering */
    return ERR_OK;
}

double h264_max_useful_rate(uint32_t width, uint32_t height, double rate)
{
    return ENOUGH_BITS * (double)width * (double)height * rate;
}

/* libx264's rate control adds one nominal frame interval's share of bits per frame and subtracts each frame's size.
 * Frames arrive irregularly, so the share is scaled by the time since the previous frame. (With real timestamps libx264
 * would delay each frame until it knows its duration.) */
static void set_cap(struct h264_encoder *h, const struct h264_desc *desc)
{
    const double most = fmax(desc->bits_per_second > 0.0 ? fmin(desc->bits_per_second, CAP_NONE) : CAP_NONE, CAP_MIN);
    const double passed_s = h->count > 0 ? 1e-6 * (double)(desc->time_us - h->time_us) : 1.0 / NOMINAL;
    const double share_s = fmin(fmax(passed_s, 1e-3), H264_CAP_S);

    h->time_us = desc->time_us;
    h->context->rc_max_rate = (int64_t)(most * share_s * NOMINAL);
    h->context->rc_buffer_size = (int)(most * H264_CAP_S);
}

static enum err open_for(struct h264_encoder *h, int width, int height, const struct h264_desc *desc)
{
    ffmpeg()->avcodec_free_context(&h->context);
    ffmpeg()->av_frame_unref(h->frame);
    h->count = 0;
    h->context = ffmpeg()->avcodec_alloc_context3(h->codec);
    if (!h->context)
        return ERR_NOMEM;
    h->context->width = width;
    h->context->height = height;
    enum err e = set_up(h->context);
    set_cap(h, desc);
    if (!e && (ffmpeg()->av_opt_set_double(h->context->priv_data, "crf", rate_factor(desc->quality), 0) < 0 ||
               ffmpeg()->avcodec_open2(h->context, h->codec, NULL) < 0))
        e = ERR_UNSUPPORTED;
    h->frame->width = width;
    h->frame->height = height;
    h->frame->format = AV_PIX_FMT_YUV420P;
    if (!e && ffmpeg()->av_frame_get_buffer(h->frame, 0) < 0)
        e = ERR_NOMEM;
    if (e)
        ffmpeg()->avcodec_free_context(&h->context);
    return e;
}

/* One frame in, one out. After an error the encoder is reopened, so that no later frame depends on the failed one. */
static enum err run(struct h264_encoder *h, bool key)
{
    ffmpeg()->av_packet_unref(h->packet);
    h->frame->pts = h->count;
    h->frame->pict_type = key ? AV_PICTURE_TYPE_I : AV_PICTURE_TYPE_NONE;
    int failed = ffmpeg()->avcodec_send_frame(h->context, h->frame);
    if (!failed)
        failed = ffmpeg()->avcodec_receive_packet(h->context, h->packet);
    if (!failed) {
        h->count++;
        return ERR_OK;
    }
    log_debug("libavcodec: error %d at frame %lld", failed, (long long)h->count);
    ffmpeg()->avcodec_free_context(&h->context);
    return failed == AVERROR(ENOMEM) ? ERR_NOMEM : ERR_UNSUPPORTED;
}

enum err h264_encode(struct h264_encoder *h, const uint8_t *rgb, const struct h264_desc *desc, struct h264_output *out)
{
    const int width = (int)(desc->width + desc->width % 2), height = (int)(desc->height + desc->height % 2);
    enum err e = ERR_OK;

    assert(desc->quality >= 1 && desc->quality <= 100);
    *out = (struct h264_output){ 0 };
    if (desc->width < 1 || desc->height < 1 || desc->width > SIDE_MAX || desc->height > SIDE_MAX)
        return ERR_RANGE;
    if (!h->context || h->context->width != width || h->context->height != height)
        e = open_for(h, width, height, desc);
    /* The encoder may still reference the last frame's planes. */
    if (!e && ffmpeg()->av_frame_make_writable(h->frame) < 0)
        e = ERR_NOMEM;
    if (e)
        return e;
    const AVFrame *f = h->frame;
    yuv_from_rgb(
        rgb, desc->width, desc->height,
        &(struct yuv_planes){ f->data[0], f->data[1], f->data[2], f->linesize[0], f->linesize[1], f->linesize[2] });
    if (h->count > 0)
        set_cap(h, desc);
    if (ffmpeg()->av_opt_set_double(h->context->priv_data, "crf", rate_factor(desc->quality), 0) < 0)
        return ERR_UNSUPPORTED;
    e = run(h, desc->key || h->count == 0);
    if (e)
        return e;
    *out = (struct h264_output){ h->packet->data, (size_t)h->packet->size, h->packet->flags & AV_PKT_FLAG_KEY };
    return ERR_OK;
}
