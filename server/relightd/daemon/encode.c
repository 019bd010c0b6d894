#include "relightd/daemon/encode.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "image/codec/encode.h"
#include "image/film/film.h"

#include <math.h>
#include <omp.h>
#include <string.h>

#define SOON_S 1.0 /* a newer image is awaited for this long before the current one is made again for a rendition */
#define POLL_MS 50 /* how soon a new viewer is noticed while no image comes */

void encode_publish(struct encode_thread *t, struct shaded *in, unsigned track, const uint8_t *bytes, size_t size)
{
    struct sent_image *p = image_create(&in->header, bytes, size);

    if (!p) {
        log_error("no memory for an image of %zu bytes", size);
        return;
    }
    image_set_track(p, track);
    if (in->header.format == PROTOCOL_H264 && track == SHARED_PUBLISH_TRACK)
        publisher_push(t->shared->publisher, p, (int64_t)(1e6 * clock_seconds()));
    server_publish_for(t->shared->server, p, &in->ticket);
}

/* Exposure and tone curve for the image; lockstep images use the initial settings. */
static struct settings display_settings(struct encode_thread *t, const struct shaded *in)
{
    return in->ticket.lockstep ? t->shared->config.setup.initial : settings_now(&t->shared->settings);
}

/* Encodes and publishes `display`, which took tone_ms to make. Returns the milliseconds spent. */
static double encode_jpeg(struct encode_thread *t, struct shaded *in, const uint8_t *display, double tone_ms,
                          int quality)
{
    const uint32_t width = in->header.width, height = in->header.height;
    const double start = clock_seconds();
    const uint8_t *bytes;
    size_t size;

    if (jpeg_encode(t->jpeg, display, width, height, quality, &bytes, &size)) {
        log_error("an image of %ux%u could not be encoded", width, height);
        return 0.0;
    }
    const double ms = 1e3 * (clock_seconds() - start);
    in->header.encoded_us = (uint32_t)(1e3 * (tone_ms + ms));
    in->header.format = PROTOCOL_JPEG;
    encode_publish(t, in, 0, bytes, size);
    return ms;
}

void encode_display(struct encode_thread *t, const struct shaded *in, const float *rgb, uint32_t width, uint32_t height,
                    uint8_t *display)
{
    const struct tone_desc tone = { in->header.gain, display_settings(t, in).tone,
                                    t->shared->config.setup.kernels->level };

    tone_map(rgb, width, height, &tone, display);
}

/* Makes t->display[scale], half or a quarter of the size. Returns the milliseconds spent. */
static double make_small_display(struct encode_thread *t, const struct shaded *in, unsigned scale)
{
    const uint32_t w = in->header.width >> scale, h = in->header.height >> scale;
    const double start = clock_seconds();

    if (w > 0 && h > 0) {
        scale_linear(in->rgb, in->header.width, in->header.height, t->small, w, h);
        encode_display(t, in, t->small, w, h, t->display[scale]);
        t->display_valid |= 1u << scale;
    }
    return 1e3 * (clock_seconds() - start);
}

/* The header of the same image at another size. */
static struct shaded scaled(const struct shaded *in, unsigned scale)
{
    static const uint8_t flags[SERVER_SCALES] = { 0, PROTOCOL_PICTURE_HALF, PROTOCOL_PICTURE_QUARTER };
    struct shaded out = *in;

    out.header.width >>= scale;
    out.header.height >>= scale;
    out.header.flags |= flags[scale];
    return out;
}

static bool wants_small_jpeg(const struct server_demand *demand, unsigned scale)
{
    return scale == 1 ? demand->halves : demand->quarters;
}

/* Encodes the image at half or a quarter of its size for viewers of that size. */
static void encode_small(struct encode_thread *t, const struct shaded *in, unsigned scale,
                         const struct server_demand *demand, int quality)
{
    const bool jpeg = wants_small_jpeg(demand, scale), video = demand->h264 & SERVER_TRACKS_OF(scale);
    struct shaded small = scaled(in, scale);

    if (!jpeg && !video)
        return;
    const double tone_ms = make_small_display(t, in, scale);
    if (!(t->display_valid >> scale & 1))
        return;
    video_encode(t, &small, scale, tone_ms, demand);
    if (jpeg) {
        encode_jpeg(t, &small, t->display[scale], tone_ms, quality);
        t->sent_jpeg |= 1u << scale;
    }
}

static void encode_exr(struct encode_thread *t, struct shaded *in, enum protocol_format format)
{
    const struct exr_desc desc = {
        .rgb = in->rgb,
        .width = in->header.width,
        .height = in->header.height,
        .depth = format == PROTOCOL_EXR_HALF ? EXR_HALF : EXR_FLOAT,
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
    encode_publish(t, in, 0, bytes, size);
    mem_free(bytes);
}

/* Encodes the change map for its subscribers. It answers no producer. */
static void encode_changes(struct encode_thread *t, const struct shaded *in)
{
    const struct png_desc desc = { .samples = in->changes, .width = in->header.width, .height = in->header.height };
    const double start = clock_seconds();
    struct protocol_picture header = in->header;
    struct sent_image *p = NULL;
    struct reason why = { "out of memory" };
    uint8_t *bytes = NULL;
    size_t size;

    if (!in->has_changes)
        return;
    if (png_encode(&desc, &bytes, &size, &why) == ERR_OK) {
        header.format = PROTOCOL_CHANGES;
        header.encoded_us = (uint32_t)(1e6 * (clock_seconds() - start));
        p = image_create(&header, bytes, size);
    }
    if (p)
        server_publish(t->shared->server, p);
    else
        log_error("frame %llu: no change map: %s", (unsigned long long)header.frame, why.text);
    mem_free(bytes);
}

/* Makes t->display[0], which is kept for viewers that connect before the next image. Returns the milliseconds
 * spent. */
static double make_display(struct encode_thread *t, const struct shaded *in)
{
    const double start = clock_seconds();

    encode_display(t, in, in->rgb, in->header.width, in->header.height, t->display[0]);
    t->current = in->header;
    t->current.format = PROTOCOL_JPEG;
    t->current_s = start;
    t->display_valid = 1;
    t->sent_jpeg = 0;
    t->sent_exr = 0;
    memset(t->rendered, 0, sizeof(t->rendered));
    return 1e3 * (clock_seconds() - start);
}

/* Sets the image's gain. Automatic exposure keeps adapting while a fixed gain is in force. EXPOSURE_AUTO measures the
 * first image of a camera and the one it is turned on with, and keeps that value. */
static void expose(struct encode_thread *t, struct shaded *in)
{
    const uint64_t frame = in->header.frame, passed = frame > t->exposed ? frame - t->exposed : 1;
    const struct settings now = display_settings(t, in);

    const bool hold = now.exposure_stops == EXPOSURE_AUTO, finer = in->header.flags & PROTOCOL_PICTURE_FINER;
    if (in->new_view || (hold && !t->held))
        exposure_init(&t->exposure);
    t->held = hold;
    if (!t->exposure.started || !(hold || finer)) { /* else exposure has seen this frame */
        t->gain = (float)exposure_step(&t->exposure, in->rgb, in->header.width, in->header.height, passed);
        t->exposed = frame;
    }
    const double gain =
        now.exposure_stops >= EXPOSURE_FOLLOW ? (double)t->gain * exp2(now.bias_stops) : exp2(now.exposure_stops);
    in->header.gain = (float)fmin(gain, 0x1p120);
}

/* Encodes once per format, independent of the number of viewers. JPEG is also encoded without viewers, for the next one
 * to connect. The format of a lockstep recorder is last, because its acknowledgement admits the next frame. */
void encode_image(struct encode_thread *t, struct shaded *in)
{
    struct server_demand demand;

    shared_demand(t->shared, &demand);
    video_drop_unwatched(t, &demand);
    const bool jpeg = in->ticket.lockstep || !demand.h264 || demand.formats >> PROTOCOL_JPEG & 1;
    const enum protocol_format wanted = demand.recorder_format ? demand.recorder_format : PROTOCOL_EXR_FLOAT;
    const enum protocol_format last = in->ticket.lockstep ? wanted : PROTOCOL_JPEG;
    const int quality = demand.jpeg_quality ? demand.jpeg_quality : atomic_load(&t->shared->settings.jpeg_quality);
    double ms;

    server_begin_image(t->shared->server);
    expose(t, in);
    const double tone_ms = ms = make_display(t, in);
    ms += video_encode(t, in, 0, tone_ms, &demand);
    for (int format = PROTOCOL_JPEG; format <= PROTOCOL_EXR_FLOAT + 1; format++) {
        const bool at_end = format > PROTOCOL_EXR_FLOAT;
        const enum protocol_format now = at_end ? last : (enum protocol_format)format;
        if (!at_end && now == last)
            continue;
        if (now == PROTOCOL_JPEG && jpeg) {
            ms += encode_jpeg(t, in, t->display[0], tone_ms, quality);
            t->sent_jpeg |= 1;
        } else if (now != PROTOCOL_JPEG && (at_end || demand.formats >> now & 1)) {
            encode_exr(t, in, now);
            t->sent_exr |= 1u << now;
        }
    }
    encode_changes(t, in);
    /* The producer must not wait for an image that failed to encode. Does nothing after server_publish_for. */
    server_frame_fate(t->shared->server, &in->ticket, SERVER_REFUSED, "its image could not be encoded");
    status_image_encoded(&t->shared->status, ms);
    for (unsigned scale = 1; scale < SERVER_SCALES; scale++)
        encode_small(t, in, scale, &demand, quality);
    renditions_encode(t, in, &demand, quality);
}

/* While no image arrives: encodes the current one again for viewers that connected since, or had reached their rate.
 * Requests renditions of the linear image, which is gone, from the shade thread. */
static void encode_current_again(struct encode_thread *t)
{
    const struct shaded in = { .header = t->current };
    struct server_demand demand;

    if (t->current.format == 0)
        return;
    shared_demand(t->shared, &demand);
    video_drop_unwatched(t, &demand);
    const int quality = demand.jpeg_quality ? demand.jpeg_quality : atomic_load(&t->shared->settings.jpeg_quality);
    bool gone = demand.formats & (1u << PROTOCOL_EXR_HALF | 1u << PROTOCOL_EXR_FLOAT) & ~t->sent_exr;
    for (unsigned scale = 0; scale < SERVER_SCALES; scale++) {
        struct shaded small = scaled(&in, scale);
        const bool watched = scale == 0 ? demand.formats >> PROTOCOL_JPEG & 1 : wants_small_jpeg(&demand, scale);
        const bool jpeg = watched && !(t->sent_jpeg >> scale & 1);
        if (!jpeg && !(demand.h264 & SERVER_TRACKS_OF(scale)))
            continue;
        if (!(t->display_valid >> scale & 1)) {
            gone = gone || (small.header.width > 0 && small.header.height > 0);
            continue;
        }
        video_encode_again(t, &small, scale, &demand);
        small.header.flags |= PROTOCOL_PICTURE_REPEAT;
        if (jpeg) {
            encode_jpeg(t, &small, t->display[scale], 0.0, quality);
            t->sent_jpeg |= 1u << scale;
        }
    }
    const bool lacks = !renditions_encode(t, &in, &demand, quality);
    if (gone || (lacks && clock_seconds() - t->current_s >= SOON_S))
        atomic_store(&t->shared->repeat_requested, true);
}

/* ---- The thread ---- */

static void *run(void *arg)
{
    struct encode_thread *t = arg;
    struct image_slots *images = &t->shared->images;

    omp_set_num_threads(1);
    while (!handoff_is_closed(&images->handoff)) {
        const int slot = handoff_take(&images->handoff, video_wait_ms(t, POLL_MS));
        if (slot == HANDOFF_NONE) {
            encode_current_again(t);
            continue;
        }
        encode_image(t, &images->slot[slot]);
        handoff_release(&images->handoff, slot);
    }
    return NULL;
}

enum err encode_thread_create(struct shared *shared, struct encode_thread **out, struct reason *why)
{
    const struct prepared_scene_desc *size = &shared->config.setup.set_desc;
    const size_t pixels = (size_t)size->width * size->height;
    struct encode_thread *t = mem_alloc(1, sizeof(*t));
    bool ok = t != NULL;

    *out = NULL;
    if (ok) {
        t->shared = shared;
        exposure_init(&t->exposure);
        t->jpeg = jpeg_encoder_create();
        t->small = mem_alloc(pixels / 4 + 1, 3 * sizeof(float));
        ok = t->jpeg && t->small;
    }
    for (int scale = 0; scale < SERVER_SCALES && ok; scale++) {
        t->display[scale] = mem_alloc((pixels >> 2 * scale) + 1, 3);
        ok = t->display[scale] != NULL;
    }
    if (!ok) {
        encode_thread_destroy(t);
        return err_say(why, ERR_NOMEM, "no memory for images of %ux%u", size->width, size->height);
    }
    *out = t;
    return ERR_OK;
}

enum err encode_thread_start(struct encode_thread *t, struct reason *why)
{
    t->running = pthread_create(&t->thread, NULL, run, t) == 0;
    return t->running ? ERR_OK : err_say(why, ERR_NOMEM, "a thread could not be started");
}

void encode_thread_destroy(struct encode_thread *t)
{
    if (!t)
        return;
    if (t->running)
        pthread_join(t->thread, NULL);
    video_finish(t);
    jpeg_encoder_destroy(t->jpeg);
    for (int scale = 0; scale < SERVER_SCALES; scale++)
        mem_free(t->display[scale]);
    mem_free(t->small);
    mem_free(t);
}
