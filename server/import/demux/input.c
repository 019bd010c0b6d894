#include "import/demux/input.h"

#include <libavformat/avformat.h>
#include <string.h>
#include <strings.h>

#define BUFFER_BYTES (64 << 10)

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

AVIOContext *input_from_file(struct input_file *f)
{
    unsigned char *buffer = av_malloc(BUFFER_BYTES);
    AVIOContext *io = buffer ? avio_alloc_context(buffer, BUFFER_BYTES, 0, f, read_file, NULL, seek_file) : NULL;

    if (!io)
        av_free(buffer);
    return io;
}

void input_finish(AVIOContext **io)
{
    if (*io)
        av_freep(&(*io)->buffer);
    avio_context_free(io);
}

const char *input_protocols(const char *url)
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

const char *input_formats(bool is_file)
{
    /* Names as libavformat has them: one of a demuxer's names suffices. */
    return is_file
               ? "mov,matroska,mpegts,mpeg,avi,flv,ivf,mxf,nut,asf,h264,hevc,obu,mjpeg,m4v"
               : "mov,matroska,mpegts,mpeg,avi,flv,live_flv,ivf,mxf,nut,asf,h264,hevc,obu,mjpeg,mpjpeg,m4v,hls,rtsp,"
                 "sdp,rtp";
}
