/* server/relightd_encode.c */
#include "relightd.h"

#include "clock.h"
#include "exr_write.h"
#include "log.h"
#include "mem.h"

#include <math.h>
#include <omp.h>

#define KEY_LEAST_S 0.25 /* between two key pictures */
#define LOOK_MS 50       /* between two looks at who cannot begin, while no picture comes */

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

/* What the picture is to look like: a lockstep sequence's, as was said. */
static struct settings looks_of(struct daemon *d, const struct shaded *in)
{
    return in->ticket.lockstep ? d->said : daemon_settings(d);
}

/* Of `display`, which took tone_ms to make. Milliseconds that this took. */
static double encode_jpeg(struct daemon *d, struct shaded *in, const uint8_t *display, double tone_ms, int quality)
{
    const uint32_t width = in->header.width, height = in->header.height;
    const double start = clock_seconds();
    const uint8_t *bytes;
    size_t size;

    if (jpeg_encode(d->jpeg, display, width, height, quality, &bytes, &size)) {
        log_error("a picture of %ux%u could not be encoded", width, height);
        return 0.0;
    }
    const double ms = 1e3 * (clock_seconds() - start);
    in->header.encoded_us = (uint32_t)(1e3 * (tone_ms + ms));
    publish(d, in, PROTOCOL_JPEG, bytes, size);
    return ms;
}

/* Likewise, of d->display: what it shows must be the next of the encoder's pictures. One that stands still is worth its
 * bytes. */
static double encode_h264(struct daemon *d, struct shaded *in, double tone_ms, int quality, bool key)
{
    const bool still = in->header.flags & PROTOCOL_PICTURE_FINER;
    const struct h264_desc desc = { in->header.width, in->header.height, still ? 100 : quality, key };
    const double start = clock_seconds();
    struct shaded coded = *in;
    struct h264_output out;

    const enum err e = h264_encode(d->h264, d->display, &desc, &out);
    if (e) {
        if (!d->h264_failed)
            log_warning("H.264 of %ux%u cannot be made: %s; viewers go back to JPEG", desc.width, desc.height,
                        err_text(e));
        d->h264_failed = true;
        d->key_s = clock_seconds(); /* tried again, but not all the time */
        return 0.0;
    }
    const double now = clock_seconds(), ms = 1e3 * (now - start);
    if (out.key)
        d->key_s = now;
    coded.header.flags |= out.key ? PROTOCOL_PICTURE_KEY : 0;
    coded.header.encoded_us = (uint32_t)(1e3 * (tone_ms + ms));
    publish(d, &coded, PROTOCOL_H264, out.bytes, out.size);
    return ms;
}

/* A key picture is some ten times as large as another, and all viewers get it: so they are not made at anybody's will.
 */
static bool key_is_due(const struct daemon *d, const struct server_demand *demand)
{
    return demand->h264_key && clock_seconds() - d->key_s >= KEY_LEAST_S;
}

/* The picture at half or a quarter of its sides: means of 2 x 2 or 4 x 4 pixels of light, before exposure and tone. A
 * border that does not fill a block is left out. */
static void encode_small(struct daemon *d, struct shaded *in, unsigned scale, uint8_t flag, int quality)
{
    const uint32_t width = in->header.width, block = 1u << scale;
    const struct tone_desc tone = { in->header.gain, looks_of(d, in).tone, d->kernels->level };
    struct shaded small = { d->small, in->header, in->ticket, false };

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
    const double start = clock_seconds();
    tone_map(small.rgb, small.header.width, small.header.height, &tone, d->small_display);
    encode_jpeg(d, &small, d->small_display, 1e3 * (clock_seconds() - start), quality);
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

/* The picture as it is shown, kept for those who come before the next one. Milliseconds. */
static double show(struct daemon *d, const struct shaded *in)
{
    const struct tone_desc tone = { in->header.gain, looks_of(d, in).tone, d->kernels->level };
    const double start = clock_seconds();

    tone_map(in->rgb, in->header.width, in->header.height, &tone, d->display);
    d->last = in->header;
    d->last.format = PROTOCOL_JPEG;
    d->last_jpeg = false;
    d->last_exr = 0;
    return 1e3 * (clock_seconds() - start);
}

/* The gain that is followed goes on being followed while a fixed one is in force. */
static void expose(struct daemon *d, struct shaded *in)
{
    const uint64_t frame = in->header.frame, passed = frame > d->exposed ? frame - d->exposed : 1;
    const struct settings now = looks_of(d, in);

    if (in->anew)
        exposure_init(&d->exposure);
    if (!(in->header.flags & PROTOCOL_PICTURE_FINER)) { /* else of a frame that was exposed already */
        d->gain = (float)exposure_step(&d->exposure, in->rgb, in->header.width, in->header.height, passed);
        d->exposed = frame;
    }
    const double gain = now.exposure_auto ? (double)d->gain * exp2(now.bias_stops) : exp2(now.exposure_stops);
    in->header.gain = (float)fmin(gain, 0x1p120);
}

/* Each format that somebody watches, once however many they are; JPEG also when nobody does, for whoever comes next. A
 * lockstep sequence's own format goes last: its recorder's word that it is stored lets the next frame in. */
static void encode_picture(struct daemon *d, struct shaded *in)
{
    struct server_demand demand;

    server_demand(d->server, &demand);
    const bool h264 = d->h264 && demand.formats >> PROTOCOL_H264 & 1;
    const bool jpeg = in->ticket.lockstep || !h264 || demand.formats >> PROTOCOL_JPEG & 1;
    const enum protocol_format wanted = demand.recorder_format ? demand.recorder_format : PROTOCOL_EXR_FLOAT;
    const enum protocol_format last = in->ticket.lockstep ? wanted : PROTOCOL_JPEG;
    const int quality = demand.jpeg_quality ? demand.jpeg_quality : d->quality;
    double ms;

    expose(d, in);
    const double tone_ms = ms = show(d, in);
    if (h264)
        ms += encode_h264(d, in, tone_ms, quality, key_is_due(d, &demand));
    for (int format = PROTOCOL_JPEG; format <= PROTOCOL_EXR_FLOAT + 1; format++) {
        const bool at_end = format > PROTOCOL_EXR_FLOAT;
        const enum protocol_format now = at_end ? last : (enum protocol_format)format;
        if (!at_end && now == last)
            continue;
        if (now == PROTOCOL_JPEG && jpeg) {
            ms += encode_jpeg(d, in, d->display, tone_ms, quality);
            d->last_jpeg = true;
        } else if (now != PROTOCOL_JPEG && (at_end || demand.formats >> now & 1)) {
            encode_exr(d, in, now);
            d->last_exr |= 1u << now;
        }
    }
    close_ticket(d, in);
    daemon_tell_encoded(d, ms);
    if (demand.halves)
        encode_small(d, in, 1, PROTOCOL_PICTURE_HALF, quality);
    if (demand.quarters)
        encode_small(d, in, 2, PROTOCOL_PICTURE_QUARTER, quality);
}

/* While no picture comes: the last one again, for those who cannot begin with what there is of it. */
static void encode_again(struct daemon *d)
{
    struct shaded in = { .header = d->last };
    struct server_demand demand;

    if (d->last.format == 0)
        return;
    server_demand(d->server, &demand);
    const int quality = demand.jpeg_quality ? demand.jpeg_quality : d->quality;
    in.header.flags |= PROTOCOL_PICTURE_REPEAT;
    if (demand.formats >> PROTOCOL_JPEG & 1 && !d->last_jpeg) {
        encode_jpeg(d, &in, d->display, 0.0, quality);
        d->last_jpeg = true;
    }
    if (demand.formats & (1u << PROTOCOL_EXR_HALF | 1u << PROTOCOL_EXR_FLOAT) & ~d->last_exr) /* the numbers are gone */
        atomic_store(&d->show_again, true);
    if (d->h264 && key_is_due(d, &demand))
        encode_h264(d, &in, 0.0, quality, true);
}

void *daemon_encode_main(void *arg)
{
    struct daemon *d = arg;

    omp_set_num_threads(1);
    while (!handoff_is_closed(&d->pictures)) {
        const int slot = handoff_take(&d->pictures, LOOK_MS);
        if (slot == HANDOFF_NONE) {
            encode_again(d);
            continue;
        }
        encode_picture(d, &d->shaded[slot]);
        handoff_release(&d->pictures, slot);
    }
    return NULL;
}
