#include "import/decoder/video.h"

#include "import/decoder/internal.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

bool video_is_open(const struct decoder *d)
{
    return d->child.pid != 0 && d->streaming;
}

/* Sends the request with `size` bytes beside it. On ERR_OK *a is a valid answer. */
static enum err exchange(struct decoder *d, struct wire_request *q, const uint8_t *bytes, struct wire_answer *a,
                         struct reason *why)
{
    char text[sizeof(a->why.text)];
    int status;
    bool idle;

    if (q->size > d->file_bytes)
        return err_say(why, ERR_RANGE, "%s: a packet of %" PRIu64 " bytes; the limit is %zu", q->name, q->size,
                       d->file_bytes);
    if (q->kind != WIRE_STREAM && !video_is_open(d))
        return err_say(why, ERR_FORMAT, "%s: the decoder was restarted", q->name);
    const enum err e = decoder_ready(d, q->name, why);
    if (e)
        return e;
    if (q->kind != WIRE_STREAM && !d->streaming) /* decoder_ready has replaced the process */
        return err_say(why, ERR_FORMAT, "%s: the decoder was restarted", q->name);
    if (bytes && q->size > 0)
        memcpy(d->file.at, bytes, q->size);
    decoder_trim(&d->file, q->size);
    const enum child_receipt receipt = decoder_ask(d, q, a, &status, &idle);
    if (receipt != CHILD_RECEIVED)
        return decoder_report_crash(d, receipt, status, q->name, why);
    if (a->magic != WIRE_MAGIC || a->result < ERR_OK || a->result >= ERR_END)
        return decoder_report_invalid(d, q->name, why);
    d->crashes_in_row = 0;
    if (a->result == ERR_OK)
        return ERR_OK;
    return err_say(why, (enum err)a->result, "%s",
                   decode_printable(a->why.text, sizeof(a->why.text), text, sizeof(text)));
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
    const enum err e = exchange(d, &q, desc->extra, &a, why);
    d->streaming = !e;
    return e;
}

static enum err ask_image(struct decoder *d, struct wire_request *q, const uint8_t *bytes, struct video_image *out,
                            struct reason *why)
{
    struct wire_answer a;

    *out = (struct video_image){ .time_us = VIDEO_NO_TIME };
    const enum err e = exchange(d, q, bytes, &a, why);
    if (!e)
        *out = (struct video_image){ a.picture == 1, a.time_us };
    return e;
}

enum err video_packet(struct decoder *d, const struct video_desc *desc, const uint8_t *bytes, size_t size,
                      int64_t time_us, struct video_image *out, struct reason *why)
{
    struct wire_request q;

    begin(&q, WIRE_PACKET, desc);
    q.size = size;
    q.time_us = time_us;
    return ask_image(d, &q, bytes, out, why);
}

enum err video_next(struct decoder *d, const struct video_desc *desc, struct video_image *out, struct reason *why)
{
    struct wire_request q;

    begin(&q, WIRE_NEXT, desc);
    return ask_image(d, &q, NULL, out, why);
}

enum err video_drain(struct decoder *d, const struct video_desc *desc, struct video_image *out, struct reason *why)
{
    struct wire_request q;

    begin(&q, WIRE_DRAIN, desc);
    return ask_image(d, &q, NULL, out, why);
}

enum err video_flush(struct decoder *d, const struct video_desc *desc, struct reason *why)
{
    struct wire_request q;
    struct wire_answer a;

    begin(&q, WIRE_FLUSH, desc);
    return exchange(d, &q, NULL, &a, why);
}

enum err video_convert(struct decoder *d, const struct video_desc *desc, struct frame *f, struct video_state *out,
                       struct reason *why)
{
    struct wire_request q;
    struct wire_answer a;

    begin(&q, WIRE_CONVERT, desc);
    enum err e = exchange(d, &q, NULL, &a, why);
    if (e)
        return e;
    struct image im = { .max_side = desc->max_side };
    if (a.width == 0 || a.height == 0 || a.picture > SIGNAL_HLG ||
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
    *out = (struct video_state){ (enum signal_transfer)a.picture, a.assumed == 1 };
    return ERR_OK;
}
