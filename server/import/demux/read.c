#include "import/demux/internal.h"

#include "image/codec/image.h"
#include "import/demux/demux.h"

#include "base/clock.h"
#include "base/mem.h"

#include <dlfcn.h>
#include <libavformat/avformat.h>
#include <libavutil/display.h>
#include <libavutil/pixdesc.h>
#include <libavutil/spherical.h>
#include <libavutil/stereo3d.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

#define OPEN_MS 12000 /* to connect and to find the format */
#define READ_MS 12000 /* for a packet */
#define PROBE_BYTES "5000000"
#define PROBE_US "3000000" /* of a live stream */
#define EXTRA_MAX (1 << 20)
#define BUFFER_BYTES (64 << 10) /* of one call to read */

/* A file in memory. */
struct input_file {
    const uint8_t *bytes;
    size_t size, at;
};

struct reading {
    struct reading_desc desc;
    struct input_file file;
    AVIOContext *io;
    AVFormatContext *context;
    int stream; /* index of the video */
    AVPacket *packet;
    int (*open)(AVFormatContext *s, AVIOContext **io, const char *url, int flags, AVDictionary **options);
    bool pending;     /* packet holds one that is not yet handed on */
    int64_t until_ms; /* for libavformat's waits */
    int codec;        /* of the format that was handed on */
    int width, height;
    uint8_t *extra; /* its codec's extra data, owned */
    int extra_size;
};

/* ---- Where its bytes come from: memory that maps a file, or the protocols that a URL may use ---- */

static int read_file(void *opaque, uint8_t *to, int size)
{
    struct input_file *f = opaque;
    const size_t left = f->size - f->at, n = (size_t)size < left ? (size_t)size : left;

    if (n == 0)
        return AVERROR_EOF;
    memcpy(to, f->bytes + f->at, n);
    f->at += n;
    return (int)n;
}

static int64_t seek_file(void *opaque, int64_t offset, int whence)
{
    struct input_file *f = opaque;
    const int64_t size = (int64_t)f->size;

    whence &= ~AVSEEK_FORCE;
    if (whence == AVSEEK_SIZE)
        return size;
    const int64_t from = whence == SEEK_CUR ? (int64_t)f->at : whence == SEEK_END ? size : 0;
    if (offset < -from || offset > size - from)
        return AVERROR(EINVAL);
    f->at = (size_t)(from + offset);
    return from + offset;
}

/* Reads and seeks in *f, which must outlive it. NULL: out of memory. */
static AVIOContext *input_from_file(struct input_file *f)
{
    unsigned char *buffer = av_malloc(BUFFER_BYTES);
    AVIOContext *io = buffer ? avio_alloc_context(buffer, BUFFER_BYTES, 0, f, read_file, NULL, seek_file) : NULL;

    if (!io)
        av_free(buffer);
    return io;
}

/* The protocols that this URL needs, for libavformat's protocol_whitelist; NULL: no network source. Never file: a
 * playlist or a redirection must not reach local files. */
static const char *input_protocols(const char *url)
{
    static const struct {
        const char *scheme, *protocols;
    } rows[] = {
        { "rtsp://", "rtsp,rtp,srtp,rtcp,udp,tcp" },
        { "rtsps://", "rtsps,rtsp,rtp,srtp,rtcp,udp,tcp,tls" },
        { "rtmp://", "rtmp,tcp" },
        { "rtmps://", "rtmps,rtmp,tcp,tls" },
        { "srt://", "srt" },
        { "http://", "http,https,tcp,tls,crypto,hls" },
        { "https://", "https,tcp,tls,crypto,hls" },
    };

    for (size_t i = 0; i < sizeof(rows) / sizeof(rows[0]); i++)
        if (strncasecmp(url, rows[i].scheme, strlen(rows[i].scheme)) == 0)
            return rows[i].protocols;
    return NULL;
}

/* The containers that this program reads, for libavformat's format_whitelist: none that refers to further files by
 * name, except playlists of network sources. */
static const char *input_formats(bool is_file)
{
    /* Names as libavformat has them: one of a demuxer's names suffices. */
    return is_file
               ? "mov,matroska,mpegts,mpeg,avi,flv,ivf,mxf,nut,asf,h264,hevc,obu,mjpeg,m4v"
               : "mov,matroska,mpegts,mpeg,avi,flv,live_flv,ivf,mxf,nut,asf,h264,hevc,obu,mjpeg,mpjpeg,m4v,hls,rtsp,"
                 "sdp,rtp";
}

/* ---- Messages of libavformat ---- */

/* The first message about something refused or a certificate, else the last error: its return codes say less. One
 * process reads one stream, and libavformat's callback has no context of ours. */
static char complaint[240];
static bool refused, untrusted;

static void note_complaint(void *context, int level, const char *format, va_list arguments)
{
    char line[sizeof(complaint)];
    int prefix = 0; /* without "[hls @ 0x55...]" */

    if (level > AV_LOG_WARNING || refused || untrusted)
        return;
    av_log_format_line2(context, level, format, arguments, line, sizeof(line), &prefix);
    const bool barred =
        strstr(line, "not on whitelist") || strstr(line, "blocked for security reasons") || strstr(line, "Not allowed");
    if (level > AV_LOG_ERROR && !barred)
        return;
    vsnprintf(line, sizeof(line), format, arguments);
    line[strcspn(line, "\r\n")] = 0;
    if (!line[0])
        return;
    memcpy(complaint, line, sizeof(line));
    refused = barred;
    untrusted = strstr(line, "certificate") != NULL; /* libavformat's texts with GnuTLS and with OpenSSL */
}

static enum err say_failed(const struct reading *r, struct demux_answer *a, const char *what, int code)
{
    char text[AV_ERROR_MAX_STRING_SIZE];

    if (untrusted)
        return err_say(&a->why, ERR_UNSUPPORTED,
                       "its certificate is not trusted (%s): use --source-ca to name a PEM file with the authority "
                       "that signed it, or accept any with --source-ca " DEMUX_ANY_CA,
                       complaint);
    if (refused && r->desc.file && strstr(complaint, "Format not on whitelist"))
        return err_say(&a->why, ERR_FORMAT, "it is not a video that this program can read, whatever its name says");
    if (refused && strstr(complaint, "Format not on whitelist"))
        return err_say(&a->why, ERR_FORMAT,
                       "it serves no video that this program can read; images of a web server are no source: download "
                       "them, or send them with relight-feed");
    if (refused)
        return err_say(
            &a->why, ERR_UNSUPPORTED,
            "it refers to something that it may not open: %s (network sources may use only network protocols, "
            "no files)",
            complaint);
    if (code == AVERROR_INVALIDDATA)
        return err_say(&a->why, ERR_FORMAT, "not a video that this program can read%s%s", complaint[0] ? ": " : "",
                       complaint);
    av_make_error_string(text, sizeof(text), code);
    const enum err e = code == AVERROR(ENOMEM) ? ERR_NOMEM : ERR_IO;
    if (strstr(complaint, text)) /* it says both */
        return err_say(&a->why, e, "%s: %s", what, complaint);
    return err_say(&a->why, e, "%s: %s%s%s", what, text, complaint[0] ? ": " : "", complaint);
}

static int is_late(void *context)
{
    const struct reading *r = context;

    return clock_ms() > r->until_ms;
}

/* ---- Opening ---- */

void reading_destroy(struct reading *r)
{
    if (!r)
        return;
    avformat_close_input(&r->context);
    if (r->io)
        av_freep(&r->io->buffer);
    avio_context_free(&r->io);
    av_packet_free(&r->packet);
    mem_free(r->extra);
    mem_free(r);
}

struct reading *reading_create(const struct reading_desc *desc)
{
    struct reading *r = mem_alloc(1, sizeof(*r));

    if (!r)
        return NULL;
    r->desc = *desc;
    r->packet = av_packet_alloc();
    av_log_set_callback(note_complaint);
    complaint[0] = 0;
    refused = untrusted = false;
    if (r->packet)
        return r;
    reading_destroy(r);
    return NULL;
}

/* libavdevice, for cameras. It draws in dozens of libraries, so it is loaded only when it is needed. */
static const AVInputFormat *find_device(const char *name, struct reason *why)
{
    char library[40];

    snprintf(library, sizeof(library), "libavdevice.so.%d", LIBAVFORMAT_VERSION_MAJOR); /* they share their number */
    void *handle = dlopen(library, RTLD_NOW);
    void (*register_all)(void) = NULL;
    void *symbol = handle ? dlsym(handle, "avdevice_register_all") : NULL;
    memcpy(&register_all, &symbol, sizeof(symbol)); /* ISO C has no conversion between the two kinds of pointer */
    if (register_all)
        register_all();
    const AVInputFormat *format = register_all ? av_find_input_format(name) : NULL;
    if (!format)
        (void)err_say(why, ERR_UNSUPPORTED, "cameras need the library %s (Debian's package libavdevice%d)", library,
                      LIBAVFORMAT_VERSION_MAJOR);
    return format;
}

static void set_trust(const struct reading *r, AVDictionary **options)
{
    const char *ca = r->desc.ca;
    const bool any = ca && strcmp(ca, DEMUX_ANY_CA) == 0;

    av_dict_set(options, "tls_verify", any ? "0" : "1", 0);
    if (ca && !any)
        av_dict_set(options, "ca_file", ca, 0);
}

static enum err set_options(const struct reading *r, const char *url, AVDictionary **options, struct demux_answer *a)
{
    const char *protocols = input_protocols(url);

    if (r->desc.device)
        return ERR_OK;
    av_dict_set(options, "format_whitelist", input_formats(r->desc.file != NULL), 0);
    av_dict_set(options, "protocol_whitelist", protocols ? protocols : "none", 0);
    if (r->desc.file)
        return ERR_OK;
    if (!protocols)
        return err_say(&a->why, ERR_USAGE, "no network source");
    av_dict_set(options, "rtsp_flags", "prefer_tcp", 0); /* works through firewalls, and loses nothing */
    av_dict_set(options, "probesize", PROBE_BYTES, 0);
    av_dict_set(options, "analyzeduration", PROBE_US, 0);
    return ERR_OK;
}

/* Refuses what a container in a file refers to. */
static int open_nothing(AVFormatContext *s, AVIOContext **io, const char *url, int flags, AVDictionary **options)
{
    (void)s;
    (void)io;
    (void)flags;
    (void)options;
    snprintf(complaint, sizeof(complaint), "'%.160s' is another file", url);
    refused = true;
    return AVERROR(EACCES);
}

/* Here and not among a demuxer's options: that of playlists does not hand them on to what it opens. */
static int open_url(AVFormatContext *s, AVIOContext **io, const char *url, int flags, AVDictionary **options)
{
    const struct reading *r = s->opaque;
    AVDictionary *own = NULL;

    if (!options)
        options = &own;
    set_trust(r, options);
    const int code = r->open(s, io, url, flags, options);
    av_dict_free(&own);
    return code;
}

static int open_context(struct reading *r, const char *url, const AVInputFormat *format, AVDictionary **options)
{
    r->context = avformat_alloc_context();
    if (!r->context)
        return AVERROR(ENOMEM);
    r->context->interrupt_callback = (AVIOInterruptCB){ is_late, r };
    if (r->desc.file) {
        r->file = (struct input_file){ r->desc.file, r->desc.file_bytes, 0 };
        r->io = input_from_file(&r->file);
        if (!r->io)
            return AVERROR(ENOMEM);
        r->context->pb = r->io;
        r->context->io_open = open_nothing;
    }
    r->context->opaque = r;
    if (!r->desc.file && !r->desc.device) {
        r->open = r->context->io_open;
        r->context->io_open = open_url;
    }
    return avformat_open_input(&r->context, r->desc.file ? "" : url, format, options);
}

static enum err choose_stream(struct reading *r, struct demux_answer *a)
{
    r->stream = av_find_best_stream(r->context, AVMEDIA_TYPE_VIDEO, -1, -1, NULL, 0);
    if (r->stream < 0)
        return err_say(&a->why, ERR_UNSUPPORTED, "it contains no video");
    for (unsigned i = 0; i < r->context->nb_streams; i++)
        r->context->streams[i]->discard = (int)i == r->stream ? AVDISCARD_DEFAULT : AVDISCARD_ALL;
    return ERR_OK;
}

/* ---- Formats ---- */

static int64_t to_us(int64_t time, AVRational base)
{
    return time == AV_NOPTS_VALUE ? INT64_MIN : av_rescale_q(time, base, AV_TIME_BASE_Q);
}

/* Adds to the note. */
static void note(struct stream_format *f, const char *format, ...) PRINTF_LIKE(2, 3);

static void note(struct stream_format *f, const char *format, ...)
{
    const size_t at = strlen(f->note), between = at > 0 && at + 2 < sizeof(f->note) ? 2 : 0;
    va_list args;

    memcpy(f->note + at, "; ", between);
    va_start(args, format);
    vsnprintf(f->note + at + between, sizeof(f->note) - at - between, format, args);
    va_end(args);
}

/* The projection that the container states. */
static uint8_t find_layout(const AVStream *st, struct stream_format *f)
{
    const AVSphericalMapping *m = (const void *)av_stream_get_side_data(st, AV_PKT_DATA_SPHERICAL, NULL);
    const AVCodecParameters *p = st->codecpar;

    if (!m)
        return LAYOUT_AUTO;
    if (m->yaw || m->pitch || m->roll)
        note(f, "its spherical metadata turn the image by %d, %d and %d degrees, which are ignored: use --rotate",
             m->yaw / 65536, m->pitch / 65536, m->roll / 65536);
    if (m->projection == AV_SPHERICAL_EQUIRECTANGULAR)
        return LAYOUT_LATLONG;
    if (m->projection == AV_SPHERICAL_CUBEMAP && m->padding == 0)
        return p->width == 6 * p->height ? LAYOUT_CUBE_6X1 : LAYOUT_CUBE_3X2;
    note(f, "its projection (%s) is not supported; --layout says what it is",
         m->projection == AV_SPHERICAL_CUBEMAP ? "a cube map with padding"
                                               : av_spherical_projection_name(m->projection));
    return LAYOUT_AUTO;
}

static uint8_t find_stereo(const AVStream *st, struct stream_format *f)
{
    const AVStereo3D *s = (const void *)av_stream_get_side_data(st, AV_PKT_DATA_STEREO3D, NULL);
    const bool inverted = s && s->flags & AV_STEREO3D_FLAG_INVERT;

    if (!s || s->type == AV_STEREO3D_2D)
        return STEREO_NONE;
    if (s->type == AV_STEREO3D_TOPBOTTOM || s->type == AV_STEREO3D_SIDEBYSIDE) {
        note(f, "stereo, %s: the left eye is used",
             s->type == AV_STEREO3D_TOPBOTTOM ? "one above the other" : "side by side");
        return (uint8_t)((s->type == AV_STEREO3D_TOPBOTTOM ? STEREO_TOP : STEREO_LEFT) + inverted);
    }
    note(f, "both eyes of its stereo (%s) are in the image", av_stereo3d_type_name(s->type));
    return STEREO_NONE;
}

static uint8_t find_orientation(const AVStream *st, struct stream_format *f)
{
    const int32_t *matrix = (const void *)av_stream_get_side_data(st, AV_PKT_DATA_DISPLAYMATRIX, NULL);
    const unsigned orientation = matrix ? image_orientation_of(matrix) : 1;

    if (orientation == 0)
        note(f, "its display matrix, which turns it by %.4g degrees, is ignored: use --rotate",
             av_display_rotation_get(matrix));
    return (uint8_t)orientation;
}

static void find_place(const AVFormatContext *c, AVStream *st, struct stream_format *f)
{
    const AVRational aspect = av_guess_sample_aspect_ratio((AVFormatContext *)(uintptr_t)c, st, NULL);
    const int count = avformat_index_get_entries_count(st);
    int hidden = 0;

    f->layout = find_layout(st, f);
    f->stereo = find_stereo(st, f);
    f->orientation = find_orientation(st, f);
    f->aspect = aspect.num > 0 && aspect.den > 0 ? (float)av_q2d(aspect) : 0.0f;
    for (int i = 0; i < count; i++) /* those that an edit list leaves out are decoded, but not shown */
        hidden += (avformat_index_get_entry(st, i)->flags & AVINDEX_DISCARD_FRAME) != 0;
    if (hidden > 0)
        f->frames = (uint64_t)(count - hidden);
}

static void fill_format(const struct reading *r, struct stream_format *f)
{
    AVStream *st = r->context->streams[r->stream];
    const AVCodecParameters *p = st->codecpar;
    const AVRational rate =
        st->avg_frame_rate.num > 0 && st->avg_frame_rate.den > 0 ? st->avg_frame_rate : st->r_frame_rate;

    *f = (struct stream_format){
        .codec = (int32_t)p->codec_id,
        .tag = (int32_t)p->codec_tag,
        .pixel_format = p->format,
        .profile = p->profile,
        .level = p->level,
        .coded_bits = p->bits_per_coded_sample,
        .range = (int32_t)p->color_range,
        .chroma_location = (int32_t)p->chroma_location,
        .primaries = (uint8_t)p->color_primaries,
        .transfer = (uint8_t)p->color_trc,
        .matrix = (uint8_t)p->color_space,
        .width = p->width > 0 ? (uint32_t)p->width : 0,
        .height = p->height > 0 ? (uint32_t)p->height : 0,
        .rate = rate.num > 0 && rate.den > 0 ? av_q2d(rate) : 0.0,
        .frames = st->nb_frames > 0 ? (uint64_t)st->nb_frames : 0,
        .duration_us = r->context->duration > 0 ? r->context->duration : 0,
        .start_us = st->start_time == AV_NOPTS_VALUE ? 0 : to_us(st->start_time, st->time_base),
        .realtime_us = r->context->start_time_realtime > 0 ? r->context->start_time_realtime : 0,
    };
    find_place(r->context, st, f);
    snprintf(f->codec_name, sizeof(f->codec_name), "%s", avcodec_get_name(p->codec_id));
}

static bool is_same_format(const struct reading *r)
{
    const AVCodecParameters *p = r->context->streams[r->stream]->codecpar;

    return r->codec == (int)p->codec_id && r->extra_size == p->extradata_size && r->width == p->width &&
           r->height == p->height &&
           (p->extradata_size <= 0 || memcmp(r->extra, p->extradata, (size_t)p->extradata_size) == 0);
}

static enum err hand_on_format(struct reading *r, struct demux_answer *a)
{
    const AVCodecParameters *p = r->context->streams[r->stream]->codecpar;
    const int size = p->extradata_size > 0 ? p->extradata_size : 0;

    if (size > EXTRA_MAX || (size_t)size > r->desc.packet_bytes)
        return err_say(&a->why, ERR_RANGE, "its codec has %d bytes of extra data", size);
    mem_free(r->extra);
    r->extra = mem_alloc((size_t)size + 1, 1);
    if (!r->extra)
        return err_say(&a->why, ERR_NOMEM, "out of memory");
    if (size)
        memcpy(r->extra, p->extradata, (size_t)size);
    memcpy(r->desc.packet, r->extra, (size_t)size);
    r->extra_size = size;
    r->codec = (int)p->codec_id;
    r->width = p->width;
    r->height = p->height;
    a->kind = DEMUX_FORMAT;
    a->size = (uint64_t)size;
    fill_format(r, &a->format);
    return ERR_OK;
}

enum err reading_open(struct reading *r, const char *url, struct demux_answer *a)
{
    AVDictionary *options = NULL;
    const AVInputFormat *format = r->desc.device ? find_device(r->desc.device, &a->why) : NULL;

    if (r->desc.device && !format)
        return ERR_UNSUPPORTED;
    r->until_ms = clock_ms() + OPEN_MS;
    enum err e = set_options(r, url, &options, a);
    int code = e ? 0 : open_context(r, url, format, &options);
    av_dict_free(&options);
    if (!e && code < 0)
        return say_failed(r, a, r->desc.file ? "not a video that this program can read" : "cannot be opened", code);
    if (!e)
        code = avformat_find_stream_info(r->context, NULL);
    if (!e && code < 0)
        return say_failed(r, a, "its format cannot be determined", code);
    if (!e)
        e = choose_stream(r, a);
    return e ? e : hand_on_format(r, a);
}

/* ---- Packets ---- */

/* Streams may replace their codec's extra data on the way. */
static bool take_new_extradata(AVCodecParameters *p, const AVPacket *packet)
{
    size_t size = 0;
    const uint8_t *bytes = av_packet_get_side_data(packet, AV_PKT_DATA_NEW_EXTRADATA, &size);

    if (!bytes || size > EXTRA_MAX)
        return true;
    uint8_t *copy = av_mallocz(size + AV_INPUT_BUFFER_PADDING_SIZE);
    if (!copy)
        return false;
    memcpy(copy, bytes, size);
    av_freep(&p->extradata);
    p->extradata = copy;
    p->extradata_size = (int)size;
    return true;
}

static enum err read_packet(struct reading *r, struct demux_answer *a)
{
    for (;;) {
        av_packet_unref(r->packet);
        const int code = av_read_frame(r->context, r->packet);
        if (code == AVERROR(EAGAIN) && !is_late(r))
            continue;
        if (code == AVERROR_EOF && refused)
            return say_failed(r, a, "", code);
        if (code == AVERROR_EOF)
            return ERR_END;
        if (code < 0)
            return say_failed(r, a, is_late(r) ? "nothing came for 12 s" : "broke off", code);
        if (r->packet->stream_index == r->stream && r->packet->size > 0)
            return ERR_OK;
    }
}

enum err reading_next(struct reading *r, struct demux_answer *a)
{
    if (!r->context)
        return err_say(&a->why, ERR_FORMAT, "nothing is open");
    r->until_ms = clock_ms() + READ_MS;
    if (!r->pending) {
        const enum err e = read_packet(r, a);
        if (e)
            return e;
        r->pending = true;
    }
    AVStream *st = r->context->streams[r->stream];
    if (!take_new_extradata(st->codecpar, r->packet))
        return err_say(&a->why, ERR_NOMEM, "out of memory");
    if (!is_same_format(r))
        return hand_on_format(r, a);
    r->pending = false;
    if ((size_t)r->packet->size > r->desc.packet_bytes)
        return err_say(&a->why, ERR_RANGE, "a packet of %d bytes; the limit is %zu", r->packet->size,
                       r->desc.packet_bytes);
    memcpy(r->desc.packet, r->packet->data, (size_t)r->packet->size);
    a->kind = DEMUX_PACKET;
    a->size = (uint64_t)r->packet->size;
    a->key = (r->packet->flags & AV_PKT_FLAG_KEY) != 0;
    a->hidden = (r->packet->flags & AV_PKT_FLAG_DISCARD) != 0;
    a->format.realtime_us = r->context->start_time_realtime > 0 ? r->context->start_time_realtime : 0;
    a->time_us = to_us(r->packet->pts != AV_NOPTS_VALUE ? r->packet->pts : r->packet->dts, st->time_base);
    return ERR_OK;
}

enum err reading_seek(struct reading *r, int64_t time_us, struct demux_answer *a)
{
    if (!r->context)
        return err_say(&a->why, ERR_FORMAT, "nothing is open");
    r->until_ms = clock_ms() + OPEN_MS;
    r->pending = false;
    av_packet_unref(r->packet);
    const AVStream *st = r->context->streams[r->stream];
    int code = av_seek_frame(r->context, r->stream, av_rescale_q(time_us, AV_TIME_BASE_Q, st->time_base),
                             AVSEEK_FLAG_BACKWARD);
    if (code < 0) /* for streams without an index, from the start */
        code = av_seek_frame(r->context, -1, 0, AVSEEK_FLAG_BYTE);
    return code < 0 ? err_say(&a->why, ERR_UNSUPPORTED, "it cannot seek") : ERR_OK;
}
