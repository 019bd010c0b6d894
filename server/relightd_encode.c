/* server/relightd_encode.c */
#include "relightd.h"

#include "clock.h"
#include "exr_write.h"
#include "log.h"
#include "mem.h"

#include <math.h>
#include <omp.h>

#define LOOK_MS 50 /* between two looks at who cannot begin, while no picture comes */

void daemon_publish(struct daemon *d, struct shaded *in, unsigned track, const uint8_t *bytes, size_t size)
{
    struct picture *p = picture_create(&in->header, bytes, size);

    if (!p) {
        log_error("no memory for a picture of %zu bytes", size);
        return;
    }
    picture_set_track(p, track);
    server_publish_for(d->server, p, &in->ticket);
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
    in->header.format = PROTOCOL_JPEG;
    daemon_publish(d, in, 0, bytes, size);
    return ms;
}

/* The picture at half or a quarter of its sides, as it is shown: means of 2 x 2 or 4 x 4 pixels of light, before
 * exposure and tone. A border that does not fill a block is left out. Milliseconds. */
static double show_small(struct daemon *d, const struct shaded *in, unsigned scale)
{
    const struct tone_desc tone = { in->header.gain, looks_of(d, in).tone, d->kernels->level };
    const uint32_t width = in->header.width, block = 1u << scale, w = width >> scale, h = in->header.height >> scale;
    const double start = clock_seconds();

    for (uint32_t y = 0; y < h; y++)
        for (uint32_t x = 0; x < 3 * w; x++) {
            float sum = 0.0f;
            for (uint32_t j = 0; j < block; j++)
                for (uint32_t i = 0; i < block; i++)
                    sum += in->rgb[3 * ((size_t)(block * y + j) * width + block * (x / 3) + i) + x % 3];
            d->small[3 * (size_t)w * y + x] = sum / (float)(block * block);
        }
    if (w > 0 && h > 0) {
        tone_map(d->small, w, h, &tone, d->display[scale]);
        d->shown |= 1u << scale;
    }
    return 1e3 * (clock_seconds() - start);
}

/* The same picture at another size. */
static struct shaded scaled(const struct shaded *in, unsigned scale)
{
    static const uint8_t flags[SERVER_SCALES] = { 0, PROTOCOL_PICTURE_HALF, PROTOCOL_PICTURE_QUARTER };
    struct shaded out = *in;

    out.header.width >>= scale;
    out.header.height >>= scale;
    out.header.flags |= flags[scale];
    return out;
}

static bool small_jpeg(const struct server_demand *demand, unsigned scale)
{
    return scale == 1 ? demand->halves : demand->quarters;
}

/* What viewers want of the picture at half or a quarter of its sides. */
static void encode_small(struct daemon *d, const struct shaded *in, unsigned scale, const struct server_demand *demand,
                         int quality)
{
    const bool jpeg = small_jpeg(demand, scale), video = demand->h264 & SERVER_TRACKS_OF(scale);
    struct shaded small = scaled(in, scale);

    if (!jpeg && !video)
        return;
    const double tone_ms = show_small(d, in, scale);
    if (!(d->shown >> scale & 1))
        return;
    daemon_video_encode(d, &small, scale, tone_ms, demand);
    if (jpeg) {
        encode_jpeg(d, &small, d->display[scale], tone_ms, quality);
        d->last_jpeg |= 1u << scale;
    }
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
    in->header.format = format;
    daemon_publish(d, in, 0, bytes, size);
    mem_free(bytes);
}

/* The picture as it is shown, kept for those who come before the next one. Milliseconds. */
static double show(struct daemon *d, const struct shaded *in)
{
    const struct tone_desc tone = { in->header.gain, looks_of(d, in).tone, d->kernels->level };
    const double start = clock_seconds();

    tone_map(in->rgb, in->header.width, in->header.height, &tone, d->display[0]);
    d->last = in->header;
    d->last.format = PROTOCOL_JPEG;
    d->shown = 1;
    d->last_jpeg = 0;
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
    daemon_video_rest(d, &demand);
    const bool jpeg = in->ticket.lockstep || !demand.h264 || demand.formats >> PROTOCOL_JPEG & 1;
    const enum protocol_format wanted = demand.recorder_format ? demand.recorder_format : PROTOCOL_EXR_FLOAT;
    const enum protocol_format last = in->ticket.lockstep ? wanted : PROTOCOL_JPEG;
    const int quality = demand.jpeg_quality ? demand.jpeg_quality : d->quality;
    double ms;

    expose(d, in);
    const double tone_ms = ms = show(d, in);
    ms += daemon_video_encode(d, in, 0, tone_ms, &demand);
    for (int format = PROTOCOL_JPEG; format <= PROTOCOL_EXR_FLOAT + 1; format++) {
        const bool at_end = format > PROTOCOL_EXR_FLOAT;
        const enum protocol_format now = at_end ? last : (enum protocol_format)format;
        if (!at_end && now == last)
            continue;
        if (now == PROTOCOL_JPEG && jpeg) {
            ms += encode_jpeg(d, in, d->display[0], tone_ms, quality);
            d->last_jpeg |= 1;
        } else if (now != PROTOCOL_JPEG && (at_end || demand.formats >> now & 1)) {
            encode_exr(d, in, now);
            d->last_exr |= 1u << now;
        }
    }
    close_ticket(d, in);
    daemon_tell_encoded(d, ms);
    for (unsigned scale = 1; scale < SERVER_SCALES; scale++)
        encode_small(d, in, scale, &demand, quality);
}

/* While no picture comes: the last one again, for those who cannot begin with what there is of it, or had it too soon
 * after another. What is made of its numbers, which are gone, has them made again. */
static void encode_again(struct daemon *d)
{
    const struct shaded in = { .header = d->last };
    struct server_demand demand;

    if (d->last.format == 0)
        return;
    server_demand(d->server, &demand);
    daemon_video_rest(d, &demand);
    const int quality = demand.jpeg_quality ? demand.jpeg_quality : d->quality;
    bool gone = demand.formats & (1u << PROTOCOL_EXR_HALF | 1u << PROTOCOL_EXR_FLOAT) & ~d->last_exr;
    for (unsigned scale = 0; scale < SERVER_SCALES; scale++) {
        struct shaded small = scaled(&in, scale);
        const bool watched = scale == 0 ? demand.formats >> PROTOCOL_JPEG & 1 : small_jpeg(&demand, scale);
        const bool jpeg = watched && !(d->last_jpeg >> scale & 1);
        if (!jpeg && !(demand.h264 & SERVER_TRACKS_OF(scale)))
            continue;
        if (!(d->shown >> scale & 1)) {
            gone = gone || (small.header.width > 0 && small.header.height > 0);
            continue;
        }
        daemon_video_again(d, &small, scale, &demand);
        small.header.flags |= PROTOCOL_PICTURE_REPEAT;
        if (jpeg) {
            encode_jpeg(d, &small, d->display[scale], 0.0, quality);
            d->last_jpeg |= 1u << scale;
        }
    }
    if (gone)
        atomic_store(&d->show_again, true);
}

void *daemon_encode_main(void *arg)
{
    struct daemon *d = arg;

    omp_set_num_threads(1);
    while (!handoff_is_closed(&d->pictures)) {
        const int slot = handoff_take(&d->pictures, daemon_video_wait_ms(d, LOOK_MS));
        if (slot == HANDOFF_NONE) {
            encode_again(d);
            continue;
        }
        encode_picture(d, &d->shaded[slot]);
        handoff_release(&d->pictures, slot);
    }
    return NULL;
}
