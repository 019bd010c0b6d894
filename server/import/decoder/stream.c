#include "import/decoder/internal.h"

#include "base/mem.h"

#include <libavcodec/avcodec.h>
#include <libavutil/stereo3d.h>
#include <string.h>

struct stream {
    AVCodecContext *codec; /* NULL: none was opened */
    AVPacket *packet;
    AVFrame *picture; /* the last that was decoded, until there is another; width 0: none */
    AVFrame *next;
    struct texels texels;
    struct stream_format format;
    bool draining;
};

/* libavcodec would ask whether standard error is a terminal, a system call that the sandbox forbids. */
static void be_silent(void *context, int level, const char *format, va_list arguments)
{
    (void)context;
    (void)level;
    (void)format;
    (void)arguments;
}

struct stream *stream_create(void)
{
    struct stream *s = mem_alloc(1, sizeof(*s));

    av_log_set_callback(be_silent);
    if (!s)
        return NULL;
    s->packet = av_packet_alloc();
    s->picture = av_frame_alloc();
    s->next = av_frame_alloc();
    if (s->packet && s->picture && s->next)
        return s;
    stream_destroy(s);
    return NULL;
}

void stream_destroy(struct stream *s)
{
    if (!s)
        return;
    avcodec_free_context(&s->codec);
    av_packet_free(&s->packet);
    av_frame_free(&s->picture);
    av_frame_free(&s->next);
    texels_finish(&s->texels);
    mem_free(s);
}

static const char *error_text(int code, char text[AV_ERROR_MAX_STRING_SIZE])
{
    return av_make_error_string(text, AV_ERROR_MAX_STRING_SIZE, code);
}

/* ---- The codec ---- */

static void fill_parameters(const struct stream_format *f, AVCodecParameters *p)
{
    p->codec_type = AVMEDIA_TYPE_VIDEO;
    p->codec_id = (enum AVCodecID)f->codec;
    p->codec_tag = (uint32_t)f->tag;
    p->format = f->pixel_format;
    p->profile = f->profile;
    p->level = f->level;
    p->bits_per_coded_sample = f->coded_bits;
    p->width = (int)f->width;
    p->height = (int)f->height;
    p->color_range = (enum AVColorRange)f->range;
    p->color_primaries = (enum AVColorPrimaries)f->primaries;
    p->color_trc = (enum AVColorTransferCharacteristic)f->transfer;
    p->color_space = (enum AVColorSpace)f->matrix;
    p->chroma_location = (enum AVChromaLocation)f->chroma_location;
}

static bool take_extradata(AVCodecParameters *p, const uint8_t *bytes, size_t size)
{
    if (size == 0)
        return true;
    p->extradata = av_mallocz(size + AV_INPUT_BUFFER_PADDING_SIZE);
    if (!p->extradata)
        return false;
    memcpy(p->extradata, bytes, size);
    p->extradata_size = (int)size;
    return true;
}

static enum err open_codec(struct stream *s, const struct wire_request *q, const uint8_t *bytes, struct reason *why)
{
    const AVCodec *codec = avcodec_find_decoder((enum AVCodecID)q->format.codec);
    const size_t side = q->max_side ? q->max_side : IMAGE_MAX_SIDE;
    char text[AV_ERROR_MAX_STRING_SIZE];

    if (!codec || codec->type != AVMEDIA_TYPE_VIDEO)
        return err_say(why, ERR_UNSUPPORTED, "%s: there is no decoder for its codec, %s", q->name,
                       q->format.codec_name);
    s->codec = avcodec_alloc_context3(codec);
    AVCodecParameters *p = avcodec_parameters_alloc();
    int failed = s->codec && p && take_extradata(p, bytes, q->size) ? 0 : AVERROR(ENOMEM);
    if (!failed) {
        fill_parameters(&q->format, p);
        failed = avcodec_parameters_to_context(s->codec, p);
    }
    avcodec_parameters_free(&p);
    if (!failed) {
        s->codec->thread_count = 1; /* the sandbox allows no threads */
        s->codec->pkt_timebase = AV_TIME_BASE_Q;
        s->codec->max_pixels = (int64_t)(side * ((side + 1) / 2));
        failed = avcodec_open2(s->codec, codec, NULL);
    }
    if (!failed)
        return ERR_OK;
    avcodec_free_context(&s->codec);
    return err_say(why, failed == AVERROR(ENOMEM) ? ERR_NOMEM : ERR_FORMAT, "%s: cannot decode %s: %s", q->name,
                   q->format.codec_name, error_text(failed, text));
}

static enum err begin(struct stream *s, const struct wire_request *q, const uint8_t *bytes, struct reason *why)
{
    avcodec_free_context(&s->codec);
    texels_finish(&s->texels);
    s->draining = false;
    if (q->transfer > SIGNAL_HLG || q->size > INT32_MAX - AV_INPUT_BUFFER_PADDING_SIZE)
        return err_say(why, ERR_RANGE, "%s: invalid request", q->name);
    s->texels.override = (enum signal_transfer)q->transfer;
    s->texels.peak_cdm2 = q->peak_cdm2;
    s->format = q->format;
    return open_codec(s, q, bytes, why);
}

/* ---- Images ---- */

static enum err next_picture(struct stream *s, const struct wire_request *q, struct wire_answer *a)
{
    char text[AV_ERROR_MAX_STRING_SIZE];

    const int got = avcodec_receive_frame(s->codec, s->next);
    if (got == AVERROR(EAGAIN) || got == AVERROR_EOF)
        return ERR_OK;
    if (got < 0)
        return err_say(&a->why, got == AVERROR(ENOMEM) ? ERR_NOMEM : ERR_FORMAT, "%s: a frame cannot be decoded: %s",
                       q->name, error_text(got, text));
    av_frame_unref(s->picture);
    av_frame_move_ref(s->picture, s->next);
    a->picture = 1;
    a->time_us = s->picture->best_effort_timestamp;
    return ERR_OK;
}

static enum err take_packet(struct stream *s, const struct wire_request *q, const uint8_t *bytes, struct wire_answer *a)
{
    char text[AV_ERROR_MAX_STRING_SIZE];

    if (q->size > INT32_MAX - AV_INPUT_BUFFER_PADDING_SIZE || av_new_packet(s->packet, (int)q->size) < 0)
        return err_say(&a->why, ERR_NOMEM, "%s: out of memory for a packet", q->name);
    memcpy(s->packet->data, bytes, q->size);
    s->packet->pts = q->time_us;
    s->packet->flags |= q->hidden ? AV_PKT_FLAG_DISCARD : 0;
    const int sent = avcodec_send_packet(s->codec, s->packet);
    av_packet_unref(s->packet);
    if (sent < 0 && sent != AVERROR(EAGAIN))
        return err_say(&a->why, sent == AVERROR(ENOMEM) ? ERR_NOMEM : ERR_FORMAT, "%s: a packet cannot be decoded: %s",
                       q->name, error_text(sent, text));
    return next_picture(s, q, a);
}

static enum err drain(struct stream *s, const struct wire_request *q, struct wire_answer *a)
{
    if (!s->draining)
        (void)avcodec_send_packet(s->codec, NULL); /* fails only if it was sent before */
    s->draining = true;
    return next_picture(s, q, a);
}

static enum err flush(struct stream *s)
{
    avcodec_flush_buffers(s->codec);
    av_frame_unref(s->picture);
    s->draining = false;
    return ERR_OK;
}

/* What the container says, else the codec's own messages. */
static uint32_t stereo_of(const struct stream *s)
{
    const AVFrameSideData *side = av_frame_get_side_data(s->picture, AV_FRAME_DATA_STEREO3D);
    const AVStereo3D *own = side ? (const void *)side->data : NULL;
    const bool inverted = own && own->flags & AV_STEREO3D_FLAG_INVERT;

    if (s->format.stereo != STEREO_NONE || !own)
        return s->format.stereo;
    return own->type == AV_STEREO3D_TOPBOTTOM    ? STEREO_TOP + inverted
           : own->type == AV_STEREO3D_SIDEBYSIDE ? STEREO_LEFT + inverted
                                                 : STEREO_NONE;
}

static unsigned orientation_of(const struct stream *s)
{
    const AVFrameSideData *side = av_frame_get_side_data(s->picture, AV_FRAME_DATA_DISPLAYMATRIX);

    return s->format.orientation > 1 || !side ? s->format.orientation : image_orientation_of((const void *)side->data);
}

/* One eye, upright. */
static enum err place(const struct stream *s, struct image *im)
{
    const uint32_t stereo = stereo_of(s), w = im->width, h = im->height;
    const unsigned orientation = orientation_of(s);
    const double aspect = (double)s->format.aspect;
    enum err e = ERR_OK;

    im->layout = (enum layout)s->format.layout;
    if (stereo != STEREO_NONE && im->layout == LAYOUT_AUTO && w == 2 * h) /* each eye is squeezed to half its size */
        im->layout = LAYOUT_LATLONG;
    if (stereo != s->format.stereo)
        image_note(im, "stereo: the left eye is used");
    if ((stereo == STEREO_TOP || stereo == STEREO_BOTTOM) && h > 1)
        e = image_place(im, w, h / 2, 0, stereo == STEREO_TOP ? 0 : -(int64_t)(h / 2));
    if ((stereo == STEREO_LEFT || stereo == STEREO_RIGHT) && w > 1)
        e = image_place(im, w / 2, h, stereo == STEREO_LEFT ? 0 : -(int64_t)(w / 2), 0);
    if (!e)
        e = image_orient(im, orientation);
    image_take_aspect(im, orientation >= 5 && aspect > 0.0 ? 1.0 / aspect : aspect);
    return e;
}

static enum err convert(struct stream *s, const struct wire_request *q, struct image *im, struct wire_answer *a)
{
    if (s->picture->width <= 0)
        return err_say(&a->why, ERR_FORMAT, "%s: no frame was decoded", q->name);
    enum err e = texels_convert(&s->texels, s->picture, q->name, im, &a->why);
    if (!e && place(s, im))
        e = err_say(&a->why, ERR_NOMEM, "%s: out of memory to place its image", q->name);
    if (!e) {
        a->picture = s->texels.signal->transfer;
        a->assumed = s->texels.signal->transfer_assumed;
    }
    a->time_us = s->picture->best_effort_timestamp;
    return e;
}

enum err stream_work(void *context, const struct wire_request *q, const uint8_t *bytes, struct image *im,
                     struct wire_answer *a)
{
    struct stream *s = context;

    if (q->kind == WIRE_STREAM)
        return begin(s, q, bytes, &a->why);
    if (!s->codec)
        return err_say(&a->why, ERR_FORMAT, "%s: no stream was started", q->name);
    switch (q->kind) {
    case WIRE_PACKET: return take_packet(s, q, bytes, a);
    case WIRE_NEXT: return next_picture(s, q, a);
    case WIRE_DRAIN: return drain(s, q, a);
    case WIRE_FLUSH: return flush(s);
    case WIRE_CONVERT: return convert(s, q, im, a);
    default: return err_say(&a->why, ERR_FORMAT, "%s: unknown request %u", q->name, q->kind);
    }
}
