/* H.264 of what is shown: an encoder for each track that somebody watches (stream/server.h), on the encode thread. Of a
 * chain none can be left out afterwards: so a track that has had its share of pictures is not given the next one. The
 * last one it gets in any case, when its time has come. */
#include "relightd.h"

#include "clock.h"
#include "log.h"

#include <math.h>

#define KEY_LEAST_S 0.25 /* between two key pictures */

/* A key picture is some ten times as large as another, and all viewers of the track get it: so they are not made at
 * anybody's will. */
static bool key_is_due(const struct video_track *t, unsigned track, const struct server_demand *demand)
{
    return demand->h264_keys >> track & 1 && clock_seconds() - t->key_s >= KEY_LEAST_S;
}

/* Pictures a second of the track, at most. */
static double rate_of(struct daemon *d, unsigned track)
{
    const double all = daemon_settings(d).fps, rate = server_track_rate(track);

    return rate > 0.0 ? fmin(rate, all) : all;
}

/* What was asked for is of the whole picture at its full rate; of a smaller or slower one it is as much less as what is
 * worth while is. */
static double bits_of(struct daemon *d, unsigned track, const struct shaded *in)
{
    const double enough = h264_enough(in->header.width, in->header.height, rate_of(d, track));

    return d->h264_bits > 0.0
               ? d->h264_bits * enough / h264_enough(d->set_desc.width, d->set_desc.height, rate_of(d, 0))
               : enough;
}

static void failed(struct daemon *d, const struct shaded *in, enum err e)
{
    if (!d->h264_failed)
        log_warning("H.264 of %ux%u cannot be made: %s; viewers go back to JPEG", in->header.width, in->header.height,
                    err_text(e));
    d->h264_failed = true;
}

/* One that stands still is worth its bytes. */
static double encode(struct daemon *d, const struct shaded *in, unsigned track, double tone_ms,
                     const struct server_demand *demand, bool key)
{
    struct video_track *t = &d->video[track];
    const bool still = in->header.flags & PROTOCOL_PICTURE_FINER;
    const double start = clock_seconds(), rate = server_track_rate(track);
    const struct h264_desc desc = {
        .width = in->header.width,
        .height = in->header.height,
        .quality = still                  ? 100
                   : demand->jpeg_quality ? demand->jpeg_quality
                                          : d->quality,
        .bits_a_second = bits_of(d, track, in),
        .time_us = (int64_t)(1e6 * start),
        .key = key,
    };
    struct shaded coded = *in;
    struct h264_output out;

    t->behind = false;
    if (rate > 0.0) /* late by less than one interval is made up for, so that the average holds */
        t->due_s = fmax(t->due_s, start - 1.0 / rate) + 1.0 / rate;
    if (!t->encoder)
        t->encoder = h264_encoder_create();
    const enum err e =
        t->encoder ? h264_encode(t->encoder, d->display[server_track_scale(track)], &desc, &out) : ERR_NOMEM;
    if (e) {
        failed(d, in, e);
        t->key_s = clock_seconds(); /* tried again, but not all the time */
        return 0.0;
    }
    const double now = clock_seconds(), ms = 1e3 * (now - start);
    if (out.key)
        t->key_s = now;
    coded.header.format = PROTOCOL_H264;
    coded.header.flags |= out.key ? PROTOCOL_PICTURE_KEY : 0;
    coded.header.encoded_us = (uint32_t)(1e3 * (tone_ms + ms));
    daemon_publish(d, &coded, track, out.bytes, out.size);
    return ms;
}

void daemon_video_rest(struct daemon *d, const struct server_demand *demand)
{
    for (unsigned track = 0; track < SERVER_TRACKS; track++) {
        struct video_track *t = &d->video[track];
        if (demand->h264 >> track & 1)
            continue;
        h264_encoder_destroy(t->encoder);
        *t = (struct video_track){ .key_s = t->key_s, .due_s = t->due_s };
    }
}

double daemon_video_encode(struct daemon *d, const struct shaded *in, unsigned scale, double tone_ms,
                           const struct server_demand *demand)
{
    const double now = clock_seconds();
    double ms = 0.0;

    for (unsigned track = scale * SERVER_RATES; track < (scale + 1) * SERVER_RATES; track++) {
        struct video_track *t = &d->video[track];
        const bool key = key_is_due(t, track, demand);
        if (!(demand->h264 >> track & 1))
            continue;
        t->behind = now < t->due_s && !key;
        if (!t->behind)
            ms += encode(d, in, track, tone_ms, demand, key);
    }
    return ms;
}

void daemon_video_again(struct daemon *d, const struct shaded *in, unsigned scale, const struct server_demand *demand)
{
    struct shaded repeated = *in;

    repeated.header.flags |= PROTOCOL_PICTURE_REPEAT;
    for (unsigned track = scale * SERVER_RATES; track < (scale + 1) * SERVER_RATES; track++) {
        const struct video_track *t = &d->video[track];
        const bool key = key_is_due(t, track, demand);
        if (!(demand->h264 >> track & 1))
            continue;
        if (t->behind && clock_seconds() >= t->due_s)
            encode(d, in, track, 0.0, demand, key);
        else if (key && !t->behind)
            encode(d, &repeated, track, 0.0, demand, true);
    }
}

int daemon_video_wait_ms(struct daemon *d, int most_ms)
{
    double wait_ms = most_ms;

    for (unsigned track = 0; track < SERVER_TRACKS; track++)
        if (d->video[track].behind)
            wait_ms = fmin(wait_ms, ceil(1e3 * (d->video[track].due_s - clock_seconds())));
    return wait_ms > 1.0 ? (int)wait_ms : 1;
}

void daemon_video_finish(struct daemon *d)
{
    for (unsigned track = 0; track < SERVER_TRACKS; track++)
        h264_encoder_destroy(d->video[track].encoder);
}
