#include "sky/source/footage.h"

#include "base/log.h"
#include "base/mem.h"
#include "sky/source/source.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

enum phase {
    PHASE_PACKETS, /* the decoder wants a packet */
    PHASE_MORE,    /* the last packet may hold more images */
    PHASE_DRAIN,   /* no packet is left, or a new format follows: images held back */
    PHASE_ENDED,
};

struct footage {
    struct footage_desc desc;
    char name[200];
    struct demux *demux;
    struct decoder *decoder;
    struct video_desc video; /* of `format` and `extra` */
    struct stream_format format;
    uint8_t *extra; /* owned */
    enum phase phase;
    bool opened;      /* the decoder has been given the format */
    bool has_next;    /* after PHASE_DRAIN, this format follows */
    bool await_key;   /* until the next keyframe, packets cannot be decoded */
    int64_t least_us; /* earlier images are passed over; VIDEO_NO_TIME: none */
    int64_t time_us;
    uint64_t packets, pictures; /* since the start */
    bool told_damage, told_colour;
};

bool source_has_video(void)
{
    return demux_available();
}

/* ---- Formats ---- */

/* The codec's extra data are borrowed from the demuxer only until the next packet. */
static enum err keep_format(struct footage *f, const struct demux_item *item, struct reason *why)
{
    uint8_t *extra = mem_alloc(item->size + 1, 1);

    if (!extra)
        return err_say(why, ERR_NOMEM, "%s: out of memory", f->name);
    memcpy(extra, item->bytes, item->size);
    mem_free(f->extra);
    f->extra = extra;
    f->format = item->format;
    f->video.extra = extra;
    f->video.extra_size = item->size;
    if (f->format.note[0])
        log_warning("%s: %s", f->name, f->format.note);
    return ERR_OK;
}

static enum err open_decoder(struct footage *f, struct reason *why)
{
    const enum err e = video_open(f->decoder, &f->video, why);

    f->opened = !e;
    f->await_key = true;
    return e;
}

static enum err take_format(struct footage *f, const struct demux_item *item, struct reason *why)
{
    const bool first = !f->opened;

    enum err e = keep_format(f, item, why);
    if (!e && first)
        return open_decoder(f, why);
    f->has_next = !e; /* first the images that the old codec holds back */
    f->phase = PHASE_DRAIN;
    return e;
}

/* ---- Opening ---- */

/* Connects, and takes the format, which is the first that comes. */
static enum err connect(struct footage *f, struct reason *why)
{
    struct demux_item item;

    demux_close(f->demux);
    f->demux = NULL;
    f->phase = PHASE_PACKETS;
    f->opened = f->has_next = false;
    f->await_key = true;
    f->least_us = f->time_us = VIDEO_NO_TIME;
    f->packets = f->pictures = 0;
    enum err e = demux_open(&(struct demux_desc){ .spec = f->desc.spec, .ca = f->desc.ca, .stop = f->desc.stop },
                            &f->demux, why);
    if (!e)
        e = demux_next(f->demux, 0, &item, why);
    return e ? e : take_format(f, &item, why);
}

enum err footage_open(const struct footage_desc *desc, struct footage **out, struct reason *why)
{
    *out = NULL;
    struct footage *f = mem_alloc(1, sizeof(*f));
    if (!f)
        return err_say(why, ERR_NOMEM, "out of memory");
    f->desc = *desc;
    demux_name(desc->spec, f->name, sizeof(f->name));
    f->video = (struct video_desc){ .format = &f->format, .colour = desc->colour, .name = f->name };
    enum err e = decoder_create(&(struct decoder_desc){ .video = true, .stop = desc->stop }, &f->decoder, why);
    if (!e)
        e = connect(f, why);
    if (e)
        footage_close(f);
    else
        *out = f;
    return e;
}

void footage_close(struct footage *f)
{
    if (!f)
        return;
    demux_close(f->demux);
    decoder_destroy(f->decoder);
    mem_free(f->extra);
    mem_free(f);
}

/* ---- Images ---- */

/* A damaged packet costs its images; the first is reported. If it has ended the decoder, a new one starts at the next
 * keyframe. */
static enum err pass_over(struct footage *f, enum err e, const struct reason *fault, struct reason *why)
{
    if (e == ERR_NOMEM || e == ERR_END)
        return err_say(why, e, "%s", fault->text);
    if (!f->told_damage)
        log_warning("%s; such packets are skipped", fault->text);
    f->told_damage = true;
    f->phase = PHASE_PACKETS;
    return video_is_open(f->decoder) ? ERR_OK : open_decoder(f, why);
}

static enum err take_packet(struct footage *f, const struct demux_item *item, struct video_image *picture,
                            struct reason *why)
{
    struct reason fault;

    f->packets++;
    f->format.realtime_us = item->format.realtime_us;
    if (f->await_key && !item->key)
        return ERR_OK;
    f->await_key = false;
    f->phase = PHASE_MORE;
    const struct video_packet packet = { item->bytes, item->size, item->time_us, item->hidden };
    const enum err e = video_packet(f->decoder, &f->video, &packet, picture, &fault);
    return e ? pass_over(f, e, &fault, why) : ERR_OK;
}

static enum err drain(struct footage *f, struct video_image *picture, struct reason *why)
{
    struct reason fault;

    if (video_is_open(f->decoder) && video_drain(f->decoder, &f->video, picture, &fault) == ERR_OK && picture->ready)
        return ERR_OK;
    f->phase = f->has_next ? PHASE_PACKETS : PHASE_ENDED;
    f->has_next = false;
    return f->phase == PHASE_PACKETS ? open_decoder(f, why) : ERR_OK;
}

/* One step: at most one packet or image. *quiet: nothing came. */
static enum err step(struct footage *f, int wait_ms, struct video_image *picture, bool *quiet, struct reason *why)
{
    struct demux_item item;
    struct reason fault;
    enum err e;

    switch (f->phase) {
    case PHASE_MORE:
        e = video_next(f->decoder, &f->video, picture, &fault);
        if (e)
            return pass_over(f, e, &fault, why);
        if (!picture->ready)
            f->phase = PHASE_PACKETS;
        return ERR_OK;
    case PHASE_DRAIN: return drain(f, picture, why);
    case PHASE_ENDED: return ERR_END;
    case PHASE_PACKETS: break;
    }
    e = demux_next(f->demux, wait_ms, &item, why);
    if (e == ERR_END && !(f->desc.stop && atomic_load(f->desc.stop))) {
        f->phase = PHASE_DRAIN;
        return ERR_OK;
    }
    *quiet = !e && item.event == DEMUX_QUIET;
    if (e || *quiet)
        return e;
    return item.event == DEMUX_FORMAT ? take_format(f, &item, why) : take_packet(f, &item, picture, why);
}

enum err footage_next(struct footage *f, int wait_ms, bool *ready, struct reason *why)
{
    struct video_image picture;
    bool quiet = false;

    *ready = false;
    if (!f->demux)
        return ERR_END;
    while (!quiet && !*ready) {
        picture = (struct video_image){ .time_us = VIDEO_NO_TIME };
        const enum err e = step(f, wait_ms, &picture, &quiet, why);
        if (e == ERR_END && f->pictures == 0 && f->packets > 0)
            return err_say(why, ERR_FORMAT, "%s: none of its %" PRIu64 " packets gives an image%s", f->name, f->packets,
                           f->await_key ? ": there is no keyframe" : "");
        if (e)
            return e;
        f->pictures += picture.ready;
        *ready = picture.ready && (f->least_us == VIDEO_NO_TIME || picture.time_us >= f->least_us);
    }
    if (*ready) {
        f->least_us = VIDEO_NO_TIME;
        f->time_us = picture.time_us;
    }
    return ERR_OK;
}

int64_t footage_time_us(const struct footage *f)
{
    return f->time_us;
}

const struct stream_format *footage_format(const struct footage *f)
{
    return &f->format;
}

double footage_rate(const struct footage *f)
{
    return f->format.rate > 0.0 && f->format.rate <= FOOTAGE_RATE_MAX ? f->format.rate : FOOTAGE_RATE;
}

/* ---- Texels ---- */

static void tell_colour(struct footage *f, const struct frame *out, const struct video_state *state)
{
    const bool hdr = state->transfer == SIGNAL_PQ || state->transfer == SIGNAL_HLG || state->transfer == SIGNAL_LINEAR;

    if (f->told_colour)
        return;
    f->told_colour = true;
    log_info("%s: %s, %ux%u, %.4g frames/s, %s", f->name, f->format.codec_name, out->width, out->height, f->format.rate,
             signal_transfer_name(state->transfer));
    if (state->note[0])
        log_warning("%s: %s", f->name, state->note);
    if (state->assumed)
        log_warning("%s: it does not state its transfer function; %s is assumed, set another with --source-transfer",
                    f->name, signal_transfer_name(state->transfer));
    if (!hdr)
        log_warning("%s: not HDR: values brighter than white, such as the sun, are clipped", f->name);
    if (f->format.rate > FOOTAGE_RATE_MAX)
        log_warning("%s: it claims %.4g frames/s; it is played at %g", f->name, f->format.rate, FOOTAGE_RATE);
}

enum err footage_convert(struct footage *f, struct frame *out, struct reason *why)
{
    struct video_state state;

    const enum err e = video_convert(f->decoder, &f->video, out, &state, why);
    if (e) {
        out->kind = FRAME_NONE;
        return e;
    }
    tell_colour(f, out, &state);
    snprintf(out->name, sizeof(out->name), "%s", f->name);
    snprintf(out->layout, sizeof(out->layout), "%s", layout_name(state.layout));
    return ERR_OK;
}

/* ---- Places ---- */

enum err footage_seek(struct footage *f, int64_t time_us, struct reason *why)
{
    struct reason fault;

    if (!f->demux || !f->opened)
        return err_say(why, ERR_UNSUPPORTED, "%s: nothing was read yet", f->name);
    const int64_t to_us = f->format.start_us + time_us;
    enum err e = demux_seek(f->demux, to_us, why);
    if (!e && (!video_is_open(f->decoder) || video_flush(f->decoder, &f->video, &fault)))
        e = open_decoder(f, why);
    f->phase = PHASE_PACKETS;
    f->has_next = false;
    f->await_key = true;
    f->least_us = time_us > 0 ? to_us : VIDEO_NO_TIME;
    f->packets = f->pictures = 0;
    return e;
}

enum err footage_restart(struct footage *f, struct reason *why)
{
    struct reason fault;

    if (f->phase == PHASE_ENDED && footage_seek(f, 0, &fault) == ERR_OK)
        return ERR_OK;
    return connect(f, why);
}
