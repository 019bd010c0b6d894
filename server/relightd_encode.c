/* server/relightd_encode.c */
#include "relightd.h"

#include "clock.h"
#include "exr_write.h"
#include "log.h"
#include "mem.h"

#include <omp.h>

static void publish(struct daemon *d, struct shaded *in, enum protocol_format format, const uint8_t *bytes, size_t size)
{
    in->header.format = format;
    struct picture *p = picture_create(&in->header, bytes, size);

    if (p)
        server_publish_for(d->server, p, &in->ticket);
    else
        log_error("no memory for a picture of %zu bytes", size);
}

/* Whoever sent the frame must not wait for a picture that will not come; after server_publish_for this says nothing. */
static void close_ticket(struct daemon *d, const struct shaded *in)
{
    server_frame_fate(d->server, &in->ticket, SERVER_REFUSED, "its picture could not be encoded");
}

static void encode_jpeg(struct daemon *d, struct shaded *in, int quality)
{
    const uint32_t width = in->header.width, height = in->header.height;
    const double start = clock_seconds();
    const struct tone_desc tone = { in->header.gain, daemon_settings(d).tone, d->kernels->level };
    const uint8_t *bytes;
    size_t size;

    tone_map(in->rgb, width, height, &tone, d->display);
    if (jpeg_encode(d->jpeg, d->display, width, height, quality, &bytes, &size)) {
        log_error("a picture of %ux%u could not be encoded", width, height);
        return;
    }
    const double ms = 1e3 * (clock_seconds() - start);
    in->header.encoded_us = (uint32_t)(1e3 * ms);
    publish(d, in, PROTOCOL_JPEG, bytes, size);
    daemon_tell_encoded(d, ms);
}

/* The picture at half or a quarter of its sides: means of 2 x 2 or 4 x 4 pixels of light, before exposure and tone. A
 * border that does not fill a block is left out. */
static void encode_small(struct daemon *d, struct shaded *in, unsigned scale, uint8_t flag, int quality)
{
    const uint32_t width = in->header.width, block = 1u << scale;
    struct shaded small = { d->small, in->header, in->ticket };

    small.header.width = in->header.width >> scale;
    small.header.height = in->header.height >> scale;
    small.header.flags |= flag;
    if (small.header.width == 0 || small.header.height == 0)
        return;
    for (uint32_t y = 0; y < small.header.height; y++)
        for (uint32_t x = 0; x < 3 * small.header.width; x++) {
            float sum = 0.0f;
            for (uint32_t j = 0; j < block; j++)
                for (uint32_t i = 0; i < block; i++)
                    sum += in->rgb[3 * ((size_t)(block * y + j) * width + block * (x / 3) + i) + x % 3];
            small.rgb[3 * (size_t)small.header.width * y + x] = sum / (float)(block * block);
        }
    encode_jpeg(d, &small, quality);
}

static void encode_exr(struct daemon *d, struct shaded *in, enum protocol_format format)
{
    const struct exr_desc desc = {
        in->rgb, in->header.width, in->header.height, format == PROTOCOL_EXR_HALF ? EXR_HALF : EXR_FLOAT, NULL, 0
    };
    const double start = clock_seconds();
    struct reason why;
    uint8_t *bytes;
    size_t size;

    if (exr_encode(&desc, &bytes, &size, &why)) {
        log_error("frame %llu: %s", (unsigned long long)in->header.frame, why.text);
        return;
    }
    in->header.encoded_us = (uint32_t)(1e6 * (clock_seconds() - start));
    publish(d, in, format, bytes, size);
    mem_free(bytes);
}

/* Each format that somebody watches, once however many they are; JPEG always, for whoever comes next. A lockstep
 * sequence's own format goes last: its recorder's word that it is stored lets the next frame in. */
static void encode_picture(struct daemon *d, struct shaded *in)
{
    struct server_demand demand;
    const uint64_t frame = in->header.frame, passed = frame > d->exposed ? frame - d->exposed : 1;

    server_demand(d->server, &demand);
    const enum protocol_format wanted = demand.recorder_format ? demand.recorder_format : PROTOCOL_EXR_FLOAT;
    const enum protocol_format last = in->ticket.lockstep ? wanted : PROTOCOL_JPEG;
    if (!(in->header.flags & PROTOCOL_PICTURE_FINER)) { /* of a frame that was exposed already */
        d->gain = (float)exposure_step(&d->exposure, in->rgb, in->header.width, in->header.height, passed);
        d->exposed = frame;
    }
    in->header.gain = d->gain;
    for (int format = PROTOCOL_JPEG; format <= PROTOCOL_EXR_FLOAT + 1; format++) {
        const bool at_end = format > PROTOCOL_EXR_FLOAT;
        const enum protocol_format now = at_end ? last : (enum protocol_format)format;
        if (!at_end && (now == last || !(demand.formats >> now & 1 || now == PROTOCOL_JPEG)))
            continue;
        if (now == PROTOCOL_JPEG)
            encode_jpeg(d, in, demand.jpeg_quality ? demand.jpeg_quality : d->quality);
        else
            encode_exr(d, in, now);
    }
    close_ticket(d, in);
    const int quality = demand.jpeg_quality ? demand.jpeg_quality : d->quality;
    if (demand.halves)
        encode_small(d, in, 1, PROTOCOL_PICTURE_HALF, quality);
    if (demand.quarters)
        encode_small(d, in, 2, PROTOCOL_PICTURE_QUARTER, quality);
}

void *daemon_encode_main(void *arg)
{
    struct daemon *d = arg;

    omp_set_num_threads(1);
    while (!handoff_is_closed(&d->pictures)) {
        const int slot = handoff_take(&d->pictures, 200);
        if (slot == HANDOFF_NONE)
            continue;
        encode_picture(d, &d->shaded[slot]);
        handoff_release(&d->pictures, slot);
    }
    return NULL;
}
