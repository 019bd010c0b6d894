/* Publishes over RTMP, RTSP and SRT, with libavformat's protocols. */
#include "base/mem.h"
#include "net/publish/sink.h"

struct network {
    struct sink sink;
    struct sink_stream stream;
    bool failed;
};

static enum err network_write(struct sink *s, const struct sink_unit *unit, struct reason *why)
{
    struct network *n = (struct network *)s;
    const enum err e = sink_stream_write(&n->stream, unit, why);

    n->failed = e != ERR_OK;
    return e;
}

static void network_close(struct sink *s)
{
    struct network *n = (struct network *)s;
    struct reason ignored;

    if (sink_stream_close(&n->stream, !n->failed, &ignored))
        n->failed = true; /* the other end may be gone before */
    mem_free(n);
}

enum err network_open(const struct sink_desc *desc, struct sink **out, struct reason *why)
{
    static const struct sink_ops ops = { network_write, network_close };
    /* [1] By itself the kernel would hold several megabytes for a slow receiver, many seconds old.
     * [2] With its length a receiver has an image when its last byte comes, not when the next image begins. */
    static const struct {
        const char *format, *options;
        bool bare;
    } of[] = {
        [PUBLISH_RTMP] = { "flv", "flvflags=no_duration_filesize:send_buffer_size=524288", true }, /* [1] */
        [PUBLISH_RTSP] = { "rtsp", "rtsp_transport=tcp", false },
        [PUBLISH_SRT] = { "mpegts", "omit_video_pes_length=0", false }, /* [2] */
    };
    const struct mux_desc to = {
        .format = of[desc->target->kind].format,
        .url = desc->target->url,
        .options = of[desc->target->kind].options,
        .cancelled = desc->cancelled,
        .user = desc->user,
    };
    struct network *n = mem_alloc(1, sizeof(*n));

    if (!n)
        return err_say(why, ERR_NOMEM, "out of memory");
    n->sink.ops = &ops;
    const enum err e = sink_stream_open(desc, &to, of[desc->target->kind].bare, &n->stream, why);
    if (e) {
        mem_free(n);
        return e;
    }
    *out = &n->sink;
    return ERR_OK;
}
