/* H.264: one encoder for each track with viewers (net/stream/server.h). Each image of a chain needs the previous one,
 * so none can be dropped after encoding. A track that has reached its rate therefore skips the next image before
 * encoding. The last image before a pause reaches every track as soon as its rate allows. */
#include "relightd/daemon/encode.h"

#include "base/clock.h"
#include "base/log.h"

#include <math.h>

#define KEY_LEAST_S 0.25 /* between two keyframes */

/* For publishing: players start and files are cut at keyframes, and players expect a steady stream, so a still image
 * is repeated, which costs a few bytes. */
#define PUBLISH_KEY_S 2.0
#define PUBLISH_REPEAT_S 0.1

static bool is_published(struct encode_thread *t, unsigned track)
{
    bool key;

    return track == SHARED_PUBLISH_TRACK && publisher_wants(t->shared->publisher, &key);
}

/* A keyframe is some ten times as large as another image and goes to all viewers of the track, so keyframes are
 * limited. */
static bool key_is_due(struct encode_thread *t, unsigned track, const struct server_demand *demand)
{
    const double passed_s = clock_seconds() - t->video[track].key_s;

    return (demand->h264_keys >> track & 1 && passed_s >= KEY_LEAST_S) ||
           (is_published(t, track) && passed_s >= PUBLISH_KEY_S);
}

/* Maximum images per second of the track. */
static double track_rate(struct encode_thread *t, unsigned track)
{
    const double all = settings_now(&t->shared->settings).fps, rate = server_track_rate(track);

    return rate > 0.0 ? fmin(rate, all) : all;
}

/* Maximum bits per second of the track. --h264-mbit applies to the full size and rate; other tracks get the same
 * fraction of their sufficient rate. */
static double track_bits(struct encode_thread *t, unsigned track, const struct shaded *in)
{
    const struct daemon_config *c = &t->shared->config;
    const double enough = h264_max_useful_rate(in->header.width, in->header.height, track_rate(t, track));

    if (c->h264_bits <= 0.0)
        return enough;
    return c->h264_bits * enough /
           h264_max_useful_rate(c->setup.set_desc.width, c->setup.set_desc.height, track_rate(t, 0));
}

/* Refined images of a still image get full quality. */
static double encode(struct encode_thread *t, const struct shaded *in, unsigned track, double tone_ms,
                     const struct server_demand *demand, bool key)
{
    struct video_track *v = &t->video[track];
    const bool still = in->header.flags & PROTOCOL_PICTURE_FINER;
    const double start = clock_seconds(), rate = server_track_rate(track);
    const struct h264_desc desc = {
        .width = in->header.width,
        .height = in->header.height,
        .quality = still                  ? 100
                   : demand->jpeg_quality ? demand->jpeg_quality
                                          : atomic_load(&t->shared->settings.jpeg_quality),
        .bits_per_second = track_bits(t, track, in),
        .time_us = (int64_t)(1e6 * start),
        .key = key,
    };
    struct shaded coded = *in;
    struct h264_output out;

    v->behind = false;
    if (rate > 0.0) /* a delay below one interval is made up for, so that the average rate holds */
        v->due_s = fmax(v->due_s, start - 1.0 / rate) + 1.0 / rate;
    if (!v->encoder)
        v->encoder = h264_encoder_create();
    const enum err e =
        v->encoder ? h264_encode(v->encoder, t->display[server_track_scale(track)], &desc, &out) : ERR_NOMEM;
    if (e) {
        if (!t->h264_failed)
            log_warning("H.264 of %ux%u failed: %s; viewers go back to JPEG", in->header.width, in->header.height,
                        err_text(e));
        t->h264_failed = true;
        v->key_s = clock_seconds(); /* try again, but not with every image */
        return 0.0;
    }
    const double now = clock_seconds(), ms = 1e3 * (now - start);
    v->coded_s = now;
    if (out.key)
        v->key_s = now;
    coded.header.format = PROTOCOL_H264;
    coded.header.flags |= out.key ? PROTOCOL_PICTURE_KEY : 0;
    coded.header.encoded_us = (uint32_t)(1e3 * (tone_ms + ms));
    encode_publish(t, &coded, track, out.bytes, out.size);
    return ms;
}

void video_drop_unwatched(struct encode_thread *t, const struct server_demand *demand)
{
    for (unsigned track = 0; track < SERVER_TRACKS; track++) {
        struct video_track *v = &t->video[track];
        if (demand->h264 >> track & 1)
            continue;
        h264_encoder_destroy(v->encoder);
        *v = (struct video_track){ .key_s = v->key_s, .due_s = v->due_s };
    }
}

double video_encode(struct encode_thread *t, const struct shaded *in, unsigned scale, double tone_ms,
                    const struct server_demand *demand)
{
    const double now = clock_seconds();
    double ms = 0.0;

    for (unsigned track = scale * SERVER_RATES; track < (scale + 1) * SERVER_RATES; track++) {
        struct video_track *v = &t->video[track];
        const bool key = key_is_due(t, track, demand);
        if (!(demand->h264 >> track & 1))
            continue;
        v->behind = now < v->due_s && !key;
        if (!v->behind)
            ms += encode(t, in, track, tone_ms, demand, key);
    }
    return ms;
}

void video_encode_again(struct encode_thread *t, const struct shaded *in, unsigned scale,
                        const struct server_demand *demand)
{
    struct shaded repeated = *in;

    repeated.header.flags |= PROTOCOL_PICTURE_REPEAT;
    for (unsigned track = scale * SERVER_RATES; track < (scale + 1) * SERVER_RATES; track++) {
        const struct video_track *v = &t->video[track];
        const bool key = key_is_due(t, track, demand);
        if (!(demand->h264 >> track & 1))
            continue;
        if (v->behind && clock_seconds() >= v->due_s)
            encode(t, in, track, 0.0, demand, key);
        else if (!v->behind && (key || (is_published(t, track) && clock_seconds() - v->coded_s >= PUBLISH_REPEAT_S)))
            encode(t, &repeated, track, 0.0, demand, key);
    }
}

int video_wait_ms(struct encode_thread *t, int most_ms)
{
    double wait_ms = most_ms;

    for (unsigned track = 0; track < SERVER_TRACKS; track++)
        if (t->video[track].behind)
            wait_ms = fmin(wait_ms, ceil(1e3 * (t->video[track].due_s - clock_seconds())));
    return wait_ms > 1.0 ? (int)wait_ms : 1;
}

void video_finish(struct encode_thread *t)
{
    for (unsigned track = 0; track < SERVER_TRACKS; track++)
        h264_encoder_destroy(t->video[track].encoder);
}
