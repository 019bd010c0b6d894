#include "net/publish/sink.h"

#include "image/video/h264.h"

enum err sink_open(const struct sink_desc *desc, struct sink **out, struct reason *why)
{
    *out = NULL;
    switch (desc->target->kind) {
    case PUBLISH_HLS: return hls_open(desc, out, why);
    case PUBLISH_RECORD: return record_open(desc, out, why);
    default: return network_open(desc, out, why);
    }
}

enum err sink_write(struct sink *s, const struct sink_unit *unit, struct reason *why)
{
    return s->ops->write(s, unit, why);
}

void sink_close(struct sink *s)
{
    if (s)
        s->ops->close(s);
}

/* ---- A muxer with a clock ---- */

enum err sink_stream_open(const struct sink_desc *desc, const struct mux_desc *to, bool bare, struct sink_stream *out,
                          struct reason *why)
{
    const struct mux_stream stream = {
        .codec = MUX_H264,
        .colour = MUX_SRGB,
        .width = desc->width,
        .height = desc->height,
        .header = desc->header,
        .header_size = desc->header_size,
    };

    *out = (struct sink_stream){ .bare = bare };
    return mux_open(to, &stream, &out->mux, why);
}

/* Times rise by at least a millisecond, the tick of FLV. */
enum err sink_stream_write(struct sink_stream *s, const struct sink_unit *unit, struct reason *why)
{
    const size_t header = s->bare && unit->key ? annexb_header_size(unit->bytes, unit->size) : 0;
    const int64_t least = MUX_TICKS / 1000;

    if (!s->begun)
        s->first_us = unit->time_us;
    int64_t at = (unit->time_us - s->first_us) * (MUX_TICKS / 1000) / 1000;
    if (s->begun && at < s->last + least)
        at = s->last + least;
    const struct mux_packet packet = {
        .bytes = unit->bytes + header,
        .size = unit->size - header,
        .shown = at,
        .decoded = at,
        .duration = s->begun ? at - s->last : MUX_TICKS / 30, /* the next one will correct it where it can */
        .key = unit->key,
    };
    s->begun = true;
    s->last = at;
    return mux_write(s->mux, &packet, why);
}

enum err sink_stream_close(struct sink_stream *s, bool complete, struct reason *why)
{
    const enum err e = mux_close(s->mux, complete, why);

    s->mux = NULL;
    return e;
}
