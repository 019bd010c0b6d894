#include "import/decoder/decoder.h"

#include "import/decoder/internal.h"

#include <stdio.h>

bool video_is_open(const struct decoder *d)
{
    return d->child.pid != 0 && d->streaming;
}

static void begin(struct wire_request *q, enum wire_kind kind, const struct video_desc *desc)
{
    *q = (struct wire_request){ .magic = WIRE_MAGIC, .kind = kind, .max_side = desc->max_side };
    snprintf(q->name, sizeof(q->name), "%s", desc->name);
}

enum err video_open(struct decoder *d, const struct video_desc *desc, struct reason *why)
{
    struct wire_request q;
    struct wire_answer a;

    begin(&q, WIRE_STREAM, desc);
    q.size = desc->extra_size;
    q.format = *desc->format;
    q.transfer = desc->colour.transfer;
    q.peak_cdm2 = desc->colour.peak_cdm2;
    d->streaming = false;
    const enum err e = decoder_exchange(d, &q, desc->extra, &a, why);
    d->streaming = !e;
    return e;
}

static enum err ask_image(struct decoder *d, enum wire_kind kind, const struct video_desc *desc,
                          const struct video_packet *p, struct video_image *out, struct reason *why)
{
    struct wire_request q;
    struct wire_answer a;

    *out = (struct video_image){ .time_us = VIDEO_NO_TIME };
    begin(&q, kind, desc);
    q.size = p->size;
    q.time_us = p->time_us;
    q.hidden = p->hidden;
    const enum err e = decoder_exchange(d, &q, p->bytes, &a, why);
    if (!e)
        *out = (struct video_image){ a.picture == 1, a.time_us };
    return e;
}

enum err video_packet(struct decoder *d, const struct video_desc *desc, const struct video_packet *packet,
                      struct video_image *out, struct reason *why)
{
    return ask_image(d, WIRE_PACKET, desc, packet, out, why);
}

static const struct video_packet none = { NULL, 0, 0, false };

enum err video_next(struct decoder *d, const struct video_desc *desc, struct video_image *out, struct reason *why)
{
    return ask_image(d, WIRE_NEXT, desc, &none, out, why);
}

enum err video_drain(struct decoder *d, const struct video_desc *desc, struct video_image *out, struct reason *why)
{
    return ask_image(d, WIRE_DRAIN, desc, &none, out, why);
}

enum err video_flush(struct decoder *d, const struct video_desc *desc, struct reason *why)
{
    struct wire_request q;
    struct wire_answer a;

    begin(&q, WIRE_FLUSH, desc);
    return decoder_exchange(d, &q, NULL, &a, why);
}

enum err video_convert(struct decoder *d, const struct video_desc *desc, struct frame *f, struct video_state *out,
                       struct reason *why)
{
    struct wire_request q;
    struct wire_answer a;

    begin(&q, WIRE_CONVERT, desc);
    enum err e = decoder_exchange(d, &q, NULL, &a, why);
    if (e)
        return e;
    struct image im = { .max_side = desc->max_side };
    if (a.width == 0 || a.height == 0 || a.picture > SIGNAL_HLG || a.layout > LAYOUT_LAST ||
        image_check_size(&im, a.width, a.height, desc->name, NULL))
        return decoder_report_invalid(d, desc->name, why);
    e = frame_reserve_texels(f, a.width, a.height);
    if (e)
        return err_say(why, e, "%s: out of memory for %ux%u texels", desc->name, a.width, a.height);
    im.width = a.width;
    im.height = a.height;
    im.rgb = f->rgb; /* borrowed */
    decoder_take_texels(d, &im);
    decoder_trim(&d->picture, 3 * sizeof(float) * (size_t)a.width * a.height);
    *out = (struct video_state){ (enum signal_transfer)a.picture, a.assumed == 1, (enum layout)a.layout, "" };
    decode_printable(a.note, sizeof(a.note), out->note, sizeof(out->note));
    return ERR_OK;
}
