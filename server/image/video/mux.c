#include "image/video/movie.h"

#include "base/file_store.h"
#include "base/mem.h"
#include "image/video/ffmpeg.h"

#include <stdio.h>
#include <string.h>

struct mux {
    AVFormatContext *context;
    AVPacket *packet;
    AVRational tick;
    bool opened; /* the header is written */
    bool (*write)(void *user, const uint8_t *bytes, size_t size);
    bool (*cancelled)(void *user);
    void *user;
};

#define BUFFER_BYTES (64 << 10) /* of one call to write */

static enum err say_av(struct reason *why, int code, const char *step)
{
    char text[AV_ERROR_MAX_STRING_SIZE];

    ffmpeg()->av_strerror(code, text, sizeof(text));
    if (code == AVERROR(ENOMEM))
        return err_say(why, ERR_NOMEM, "%s: out of memory", step);
    return err_say(why, code == AVERROR_MUXER_NOT_FOUND ? ERR_UNSUPPORTED : ERR_IO, "%s: %s", step, text);
}

/* Mastering display and light level of HDR: what a screen needs to map to its own range. */
static enum err add_mastering(AVStream *s)
{
    AVMasteringDisplayMetadata *display = ffmpeg()->av_mastering_display_metadata_alloc();
    size_t level_size = 0;
    AVContentLightMetadata *level = ffmpeg()->av_content_light_metadata_alloc(&level_size);

    if (!display || !level) {
        ffmpeg()->av_free(display);
        ffmpeg()->av_free(level);
        return ERR_NOMEM;
    }
    static const int primaries[3][2] = { { 35400, 14600 }, { 8500, 39850 }, { 6550, 2300 } }; /* units of 0.00002 */
    for (int c = 0; c < 3; c++)
        for (int k = 0; k < 2; k++)
            display->display_primaries[c][k] = (AVRational){ primaries[c][k], 50000 };
    display->white_point[0] = (AVRational){ 15635, 50000 };
    display->white_point[1] = (AVRational){ 16450, 50000 };
    display->max_luminance = (AVRational){ MUX_PQ_PEAK * 10000, 10000 };
    display->min_luminance = (AVRational){ 1, 10000 };
    display->has_primaries = display->has_luminance = 1;
    level->MaxCLL = MUX_PQ_PEAK; /* a bound; the mean over a frame is not known before the last one: 0 */
    if (ffmpeg()->av_stream_add_side_data(s, AV_PKT_DATA_MASTERING_DISPLAY_METADATA, (uint8_t *)display,
                                          sizeof(*display)) < 0) {
        ffmpeg()->av_free(display);
        ffmpeg()->av_free(level);
        return ERR_NOMEM;
    }
    if (ffmpeg()->av_stream_add_side_data(s, AV_PKT_DATA_CONTENT_LIGHT_LEVEL, (uint8_t *)level, level_size) < 0) {
        ffmpeg()->av_free(level);
        return ERR_NOMEM;
    }
    return ERR_OK;
}

static void set_colour(AVCodecParameters *p, enum mux_colour colour)
{
    static const struct {
        int range, primaries, transfer, matrix, format, chroma;
    } of[] = {
        [MUX_BT709] = { AVCOL_RANGE_MPEG, AVCOL_PRI_BT709, AVCOL_TRC_BT709, AVCOL_SPC_BT709, AV_PIX_FMT_YUV420P,
                        AVCHROMA_LOC_LEFT },
        [MUX_PQ] = { AVCOL_RANGE_MPEG, AVCOL_PRI_BT2020, AVCOL_TRC_SMPTE2084, AVCOL_SPC_BT2020_NCL,
                     AV_PIX_FMT_YUV420P10, AVCHROMA_LOC_LEFT },
        [MUX_SRGB] = { AVCOL_RANGE_JPEG, AVCOL_PRI_BT709, AVCOL_TRC_IEC61966_2_1, AVCOL_SPC_BT709, AV_PIX_FMT_YUV420P,
                       AVCHROMA_LOC_CENTER },
    };

    p->color_range = of[colour].range;
    p->color_primaries = of[colour].primaries;
    p->color_trc = of[colour].transfer;
    p->color_space = of[colour].matrix;
    p->chroma_location = of[colour].chroma;
    p->format = of[colour].format;
}

static enum err add_stream(struct mux *m, const struct mux_stream *d)
{
    AVStream *s = ffmpeg()->avformat_new_stream(m->context, NULL);

    if (!s)
        return ERR_NOMEM;
    AVCodecParameters *p = s->codecpar;
    p->codec_type = AVMEDIA_TYPE_VIDEO;
    p->codec_id = d->codec == MUX_AV1 ? AV_CODEC_ID_AV1 : AV_CODEC_ID_H264;
    p->width = (int)d->width;
    p->height = (int)d->height;
    set_colour(p, d->colour);
    if (d->header_size > 0) {
        p->extradata = ffmpeg()->av_mallocz(d->header_size + AV_INPUT_BUFFER_PADDING_SIZE);
        if (!p->extradata)
            return ERR_NOMEM;
        memcpy(p->extradata, d->header, d->header_size);
        p->extradata_size = (int)d->header_size;
    }
    s->time_base = m->tick;
    if (d->rate_num > 0)
        s->avg_frame_rate = s->r_frame_rate = (AVRational){ d->rate_num, d->rate_den };
    return d->colour == MUX_PQ ? add_mastering(s) : ERR_OK;
}

static int is_cancelled(void *opaque)
{
    const struct mux *m = opaque;

    return m->cancelled(m->user);
}

static int pass_on(void *opaque, uint8_t *bytes, int size)
{
    const struct mux *m = opaque;

    return m->write(m->user, bytes, (size_t)size) ? size : AVERROR(EIO);
}

/* Sends to m->write what libavformat writes. */
static int open_callback(struct mux *m)
{
    unsigned char *buffer = ffmpeg()->av_malloc(BUFFER_BYTES);

    m->context->pb = buffer ? ffmpeg()->avio_alloc_context(buffer, BUFFER_BYTES, 1, m, NULL, pass_on, NULL) : NULL;
    if (!m->context->pb) {
        ffmpeg()->av_free(buffer);
        return AVERROR(ENOMEM);
    }
    m->context->flags |= AVFMT_FLAG_CUSTOM_IO;
    return 0;
}

static int open_output(struct mux *m, const char *url, AVDictionary **options)
{
    AVFormatContext *c = m->context;

    if (m->write)
        return open_callback(m);
    if (c->oformat->flags & AVFMT_NOFILE) /* it connects when it writes the header */
        return 0;
    return ffmpeg()->avio_open2(&c->pb, url, AVIO_FLAG_WRITE, &c->interrupt_callback, options);
}

static enum err open_context(struct mux *m, const struct mux_desc *d, const struct mux_stream *stream,
                             struct reason *why)
{
    AVDictionary *options = NULL;
    char file[FILE_STORE_PATH + sizeof("file:")]; /* without "file:", a colon in the path would end a protocol's name */
    const char *url = d->url ? d->url : file;

    if (d->path && file_is_stdout(d->path))
        snprintf(file, sizeof(file), "pipe:1");
    else
        snprintf(file, sizeof(file), "file:%s", d->path ? d->path : "");
    int code = ffmpeg()->avformat_alloc_output_context2(&m->context, NULL, d->format, url);
    if (code < 0)
        return say_av(why, code, d->format);
    if (d->cancelled)
        m->context->interrupt_callback = (AVIOInterruptCB){ is_cancelled, m };
    if (add_stream(m, stream))
        return err_say(why, ERR_NOMEM, "out of memory");
    if (d->options && ffmpeg()->av_dict_parse_string(&options, d->options, "=", ":", 0) < 0) {
        ffmpeg()->av_dict_free(&options);
        return err_say(why, ERR_NOMEM, "out of memory");
    }
    code = open_output(m, url, &options);
    if (code < 0) {
        ffmpeg()->av_dict_free(&options);
        return say_av(why, code, d->url ? "connecting" : "opening it");
    }
    m->context->flags |= AVFMT_FLAG_FLUSH_PACKETS;
    code = ffmpeg()->avformat_write_header(m->context, &options);
    m->opened = code >= 0;
    ffmpeg()->av_dict_free(&options);
    return code < 0 ? say_av(why, code, d->url ? "connecting" : "the beginning") : ERR_OK;
}

enum err mux_open(const struct mux_desc *desc, const struct mux_stream *stream, struct mux **out, struct reason *why)
{
    struct mux *m = ffmpeg() ? mem_alloc(1, sizeof(*m)) : NULL;
    struct reason ignored;

    *out = NULL;
    if (!ffmpeg())
        return err_say(why, ERR_UNSUPPORTED, "libavformat cannot be loaded");
    if (!m)
        return err_say(why, ERR_NOMEM, "out of memory");
    m->tick = stream->rate_num > 0 ? (AVRational){ stream->rate_den, stream->rate_num } : (AVRational){ 1, MUX_TICKS };
    m->write = desc->write;
    m->cancelled = desc->cancelled;
    m->user = desc->user;
    m->packet = ffmpeg()->av_packet_alloc();
    const enum err e = m->packet ? open_context(m, desc, stream, why) : err_say(why, ERR_NOMEM, "out of memory");
    if (e) {
        if (mux_close(m, false, &ignored))
            m = NULL; /* which it is in every case */
        return e;
    }
    *out = m;
    return ERR_OK;
}

enum err mux_write(struct mux *m, const struct mux_packet *packet, struct reason *why)
{
    AVPacket *p = m->packet;

    const int room = ffmpeg()->av_new_packet(p, (int)packet->size);
    if (room < 0)
        return err_say(why, ERR_NOMEM, "out of memory");
    memcpy(p->data, packet->bytes, packet->size);
    p->pts = packet->shown;
    p->dts = packet->decoded;
    p->duration = packet->duration > 0 ? packet->duration : 1;
    p->flags = packet->key ? AV_PKT_FLAG_KEY : 0;
    ffmpeg()->av_packet_rescale_ts(p, m->tick, m->context->streams[0]->time_base);
    int code = ffmpeg()->av_write_frame(m->context, p);
    ffmpeg()->av_packet_unref(p);
    /* a write that was buffered fails in the buffer's own time */
    if (code >= 0 && m->context->pb && m->context->pb->error < 0)
        code = m->context->pb->error;
    if (code < 0)
        return say_av(why, code, "writing");
    return ERR_OK;
}

static int close_callback(AVFormatContext *c)
{
    ffmpeg()->avio_flush(c->pb);
    const int code = c->pb->error;
    ffmpeg()->av_freep(&c->pb->buffer);
    ffmpeg()->avio_context_free(&c->pb);
    return code;
}

enum err mux_close(struct mux *m, bool complete, struct reason *why)
{
    enum err e = ERR_OK;

    if (!m)
        return ERR_OK;
    AVFormatContext *c = m->context;
    if (c) {
        int code = m->opened && complete ? ffmpeg()->av_write_trailer(c) : 0;
        if (c->pb) {
            if (code >= 0 && c->pb->error < 0)
                code = c->pb->error;
            const int closed = m->write ? close_callback(c) : ffmpeg()->avio_closep(&c->pb);
            if (code >= 0 && complete)
                code = closed;
        }
        if (code < 0)
            e = say_av(why, code, "the end");
        ffmpeg()->avformat_free_context(c);
    }
    ffmpeg()->av_packet_free(&m->packet);
    mem_free(m);
    return e;
}
