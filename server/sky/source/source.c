#include "sky/source/source_internal.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "base/vec.h"
#include "sky/daylight/sun.h"

#include <assert.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#define FIRST_WAITS 150 /* of SOURCE_WAIT_MS: 30 s for the first image of a live stream */

static bool starts_with(const char *text, const char *start)
{
    return strncmp(text, start, strlen(start)) == 0;
}

static bool in_range(const struct source *s, uint64_t number)
{
    return !s->frames.given || (number >= s->frames.first && number <= s->frames.last);
}

/* A web server's video of known length is read like a file. */
static enum err open_video(struct source *s, const struct source_desc *d, enum demux_kind kind, struct reason *why)
{
    const struct footage_desc desc = { .spec = d->spec, .colour = d->colour, .ca = d->ca };

    s->kind = SOURCE_VIDEO;
    enum err e = demux_check(d->spec, d->ca, why);
    if (!e && (kind == DEMUX_FILE || kind == DEMUX_WEB))
        e = footage_open(&desc, &s->footage, why);
    if (e == ERR_IO && kind == DEMUX_WEB && d->wait) {
        log_warning("%s; waiting for it", why->text);
        e = ERR_OK;
    } else if (e || kind == DEMUX_FILE || (kind == DEMUX_WEB && footage_format(s->footage)->duration_us > 0)) {
        return e;
    }
    e = live_start(&desc, s->footage, d->tries, &s->live, why);
    if (!e) {
        s->kind = SOURCE_LIVE;
        s->footage = NULL;
    }
    return e;
}

static enum err open_daylight(struct source *s, const struct source_desc *d, struct reason *why)
{
    const enum err e = daylight_open(d->spec, &s->daylight, why);

    if (e)
        return e;
    s->kind = SOURCE_DAYLIGHT;
    for (size_t i = 0; i < s->daylight->count; i++) {
        if (!in_range(s, daylight_moment(s->daylight, i)->number))
            continue;
        s->daylight_first = s->daylight_count == 0 ? i : s->daylight_first;
        s->daylight_count++;
    }
    if (s->daylight_count > 0)
        return ERR_OK;
    return err_say(why, ERR_USAGE,
                   "%s: no daylight in the frames from %" PRIu64 " to %" PRIu64 "; the numbers run from %" PRIu64
                   " to %" PRIu64,
                   d->spec, s->frames.first, s->frames.last, daylight_moment(s->daylight, 0)->number,
                   daylight_moment(s->daylight, s->daylight->count - 1)->number);
}

static enum err open_spec(struct source *s, const struct source_desc *d, struct reason *why)
{
    const char *spec = d->spec;
    enum demux_kind video;

    if (daylight_is(spec))
        return open_daylight(s, d, why);
    if (starts_with(spec, "push:"))
        return err_say(why, ERR_USAGE, "'%s': only relightd accepts frames pushed over the network", spec);
    if (starts_with(spec, "watch:")) {
        if (!spec[strlen("watch:")])
            return err_say(why, ERR_USAGE, "%s: the folder is missing; expected watch:DIR", spec);
        const enum err e = watch_init(&s->watch, spec + strlen("watch:"), why);
        s->kind = e ? s->kind : SOURCE_WATCH;
        return e;
    }
    if (starts_with(spec, "sky:")) {
        s->kind = SOURCE_SKY;
        s->sky_frame = s->frames.given ? s->frames.first : 0;
        if (s->frames.given && s->frames.last > FRAME_NUMBER_MAX)
            return err_say(why, ERR_USAGE, "%s: no frame can have a number above %" PRIu64, spec, FRAME_NUMBER_MAX);
        return sky_parse(spec + strlen("sky:"), &s->sky, why);
    }
    enum err e = demux_kind_of(spec, &video, why);
    if (!e && video != DEMUX_NOTHING)
        return open_video(s, d, video, why);
    if (!e)
        e = files_from_spec(spec, &s->files, why);
    s->repeats = !e && d->turn != 0.0 && s->files.count == 1;
    if (s->repeats)
        return ERR_OK;
    return e ? e : files_select(&s->files, &s->frames, spec, why);
}

const char *source_name(const char *spec, char *out, size_t size)
{
    return demux_name(spec, out, size);
}

enum err source_open(const struct source_desc *desc, struct source **out, struct reason *why)
{
    *out = NULL;
    assert(desc->spec);
    if (desc->frames.given && desc->frames.first > desc->frames.last)
        return err_say(why, ERR_USAGE, "%s: the frame range ends before it starts", desc->spec);
    struct source *s = mem_alloc(1, sizeof(*s));
    if (!s)
        return err_say(why, ERR_NOMEM, "%s: out of memory", desc->spec);
    s->desc = *desc;
    s->kind = SOURCE_FILES;
    s->frames = desc->frames;
    s->loop = desc->loop;
    s->wait_ms = SOURCE_WAIT_MS;
    enum err e = open_spec(s, desc, why);
    if (!e && between_is_used(&desc->between) && s->kind != SOURCE_WATCH && s->kind != SOURCE_LIVE)
        e = held_create(s, &desc->between, why);
    if (e)
        source_close(s);
    else
        *out = s;
    return e;
}

void source_close(struct source *s)
{
    if (!s)
        return;
    files_finish(&s->files);
    if (s->kind == SOURCE_WATCH)
        watch_finish(&s->watch);
    footage_close(s->footage);
    live_stop(s->live);
    daylight_close(s->daylight);
    held_destroy(s->held);
    mem_free(s);
}

/* Invalidates the frame's contents. */
static void forget(struct frame *f)
{
    f->kind = FRAME_NONE;
    f->layout[0] = '\0';
}

static enum err next_file(struct source *s, struct frame *f, struct reason *why)
{
    const uint64_t count = source_count_skies(s); /* 0: there is no last */

    if (count > 0 && s->files.next == count) {
        if (!s->loop)
            return ERR_END;
        s->files.next = 0;
    }
    forget(f);
    s->position = s->files.next;
    const enum err e = files_read(&s->files.items[s->repeats ? 0 : s->files.next], f, why);
    if (s->repeats)
        f->number = s->files.next + (s->frames.given ? s->frames.first : 0);
    s->files.next++;
    f->capture_us = 0; /* the modification time of an existing file is when it was copied or converted, not when the
                          light was captured */
    return e;
}

static enum err next_watched(struct source *s, struct frame *f, struct reason *why)
{
    const struct file_item *item = NULL;

    const enum err e = watch_next(&s->watch, s->wait_ms, &item, why);
    if (e == ERR_END || (item && s->frames.given && item->number > s->frames.last))
        return ERR_END;
    forget(f);
    if (e || !item || !in_range(s, item->number))
        return e;
    const enum err failed = files_read(item, f, why);
    if (!failed && f->capture_us == 0)
        log_warning("%s: its modification time cannot be a capture time; the time is unknown", f->name);
    return failed;
}

static enum err next_sky(struct source *s, struct frame *f, struct reason *why)
{
    struct sky_state state;

    if (s->sky_ended) {
        if (!s->loop)
            return ERR_END;
        s->sky_ended = false;
        s->sky_frame = s->frames.first;
    }
    forget(f);
    f->capture_us = clock_wall_us(); /* computed light is as old as its computation */
    if (frame_reserve_texels(f, s->sky.width, s->sky.height))
        return err_say(why, ERR_NOMEM, "sky: out of memory for %" PRIu32 "x%" PRIu32 " texels", s->sky.width,
                       s->sky.height);
    f->number = s->sky_frame;
    s->position = s->sky_frame - (s->frames.given ? s->frames.first : 0);
    sky_state_at(&s->sky, f->number, &state);
    snprintf(f->name, sizeof(f->name), "sky: frame %" PRIu64 ", sun at %.1f degrees", f->number,
             state.sun_elevation * 57.29577951308232);
    f->units = s->sky.scale;
    sky_render(&s->sky, &state, f->rgb);
    if (s->frames.given && s->sky_frame == s->frames.last)
        s->sky_ended = true;
    else if (s->sky_frame < FRAME_NUMBER_MAX) /* else it stands still */
        s->sky_frame++;
    return ERR_OK;
}

static enum err next_daylight(struct source *s, struct frame *f, struct reason *why)
{
    const struct daylight *d = s->daylight;
    char when[40];

    if (s->daylight_next == s->daylight_count) {
        if (!s->loop)
            return ERR_END;
        s->daylight_next = 0;
    }
    forget(f);
    f->capture_us = clock_wall_us();
    if (frame_reserve_texels(f, d->width, d->height))
        return err_say(why, ERR_NOMEM, "%s: out of memory for %" PRIu32 "x%" PRIu32 " texels", s->desc.spec, d->width,
                       d->height);
    snprintf(f->layout, sizeof(f->layout), "%s", d->matrix.mf ? "latlong" : "");
    const struct moment *m = daylight_moment(d, s->daylight_first + s->daylight_next);
    s->position = s->daylight_next++;
    f->number = m->number;
    moment_name(m, when, sizeof(when));
    if (d->cie)
        snprintf(f->name, sizeof(f->name), "cie: %s", cie_name(d->cie));
    else if (d->matrix.mf)
        snprintf(f->name, sizeof(f->name), "%.200s: time step %" PRIu64, d->file, m->number);
    else
        snprintf(f->name, sizeof(f->name), "%.100s: %s, sun at %.1f degrees", d->weather.place, when,
                 m->altitude * 57.29577951308232);
    f->units = d->scale;
    daylight_render(d, m, f->rgb);
    return ERR_OK;
}

/* The next image within the range, from wherever in the video it stands. */
static enum err next_picture(struct source *s, struct frame *f, struct reason *why)
{
    bool ready = false;
    enum err e = ERR_OK;

    do {
        e = footage_next(s->footage, SOURCE_WAIT_MS, &ready, why);
    } while (!e && (!ready || (s->picture++, !in_range(s, s->picture - 1) && s->picture <= s->frames.last)));
    if (e == ERR_END)
        s->length = s->picture;
    s->video_ended = e != ERR_OK;
    if (!e && !in_range(s, s->picture - 1)) {
        s->video_ended = true;
        e = ERR_END;
    }
    if (e)
        return e;
    forget(f);
    f->capture_us = 0;
    f->number = s->picture - 1;
    s->position = f->number - (s->frames.given ? s->frames.first : 0);
    return footage_convert(s->footage, f, why);
}

static enum err next_video(struct source *s, struct frame *f, struct reason *why)
{
    enum err e = ERR_END;

    if (!s->video_ended)
        e = next_picture(s, f, why);
    if (e == ERR_END && s->loop) {
        e = footage_restart(s->footage, why);
        s->picture = 0;
        s->video_ended = e != ERR_OK;
        if (!e)
            e = next_picture(s, f, why);
    }
    if (e && e != ERR_END)
        forget(f);
    return e;
}

/* What was waited for is a video of known length. */
static enum err become_video(struct source *s, struct reason *why)
{
    live_stop(s->live);
    s->live = NULL;
    const enum err e = open_video(s, &s->desc, DEMUX_WEB, why);
    if (e)
        s->kind = SOURCE_LIVE; /* to be tried again */
    return e;
}

static enum err next_live(struct source *s, struct frame *f, struct reason *why)
{
    if (!s->live || live_is_recording(s->live)) {
        forget(f);
        return become_video(s, why);
    }
    if (s->frames.given && s->picture > s->frames.last)
        return ERR_END;
    forget(f);
    const enum err e = live_next(s->live, s->wait_ms, f, why);
    if (e || f->kind == FRAME_NONE)
        return e;
    f->number = s->picture++;
    if (!in_range(s, f->number))
        forget(f);
    return ERR_OK;
}

static enum err next(struct source *s, struct frame *f, struct reason *why)
{
    switch (s->kind) {
    case SOURCE_FILES: return next_file(s, f, why);
    case SOURCE_WATCH: return next_watched(s, f, why);
    case SOURCE_SKY: return next_sky(s, f, why);
    case SOURCE_VIDEO: return next_video(s, f, why);
    case SOURCE_LIVE: return next_live(s, f, why);
    case SOURCE_DAYLIGHT: return next_daylight(s, f, why);
    }
    return ERR_END;
}

enum err source_next_sky(struct source *s, struct frame *f, struct reason *why)
{
    const enum err e = next(s, f, why);

    if (!e && f->kind != FRAME_NONE)
        f->turn = fmod(s->desc.turn * (double)f->number, 360.0);
    return e;
}

void source_set_wait(struct source *s, int most_ms)
{
    s->wait_ms = most_ms;
}

enum err source_next(struct source *s, struct frame *f, struct reason *why)
{
    return s->held ? held_next(s, f, why) : source_next_sky(s, f, why);
}

/* Frames within the range: counted in a pass, else from the container. */
static uint64_t video_count(const struct source *s)
{
    const struct stream_format *f = footage_format(s->footage);
    const double by_time = 1e-6 * (double)f->duration_us * footage_rate(s->footage);
    uint64_t count = s->length ? s->length : f->frames;

    if (count == 0 && by_time >= 1.0 && by_time < 1e9)
        count = (uint64_t)(by_time + 0.5);
    if (count > FRAME_NUMBER_MAX)
        count = 0;
    if (!s->frames.given || count == 0)
        return count;
    const uint64_t end = s->frames.last < count ? s->frames.last + 1 : count;
    return end > s->frames.first ? end - s->frames.first : 0;
}

static uint64_t range_count(const struct source *s)
{
    return s->frames.given ? s->frames.last - s->frames.first + 1 : 0;
}

uint64_t source_first_number(const struct source *s)
{
    switch (s->kind) {
    case SOURCE_FILES: return s->repeats ? s->frames.first : s->files.items[0].number;
    case SOURCE_DAYLIGHT: return daylight_moment(s->daylight, s->daylight_first)->number;
    default: return s->frames.given ? s->frames.first : 0;
    }
}

uint64_t source_count_skies(const struct source *s)
{
    switch (s->kind) {
    case SOURCE_FILES: return s->repeats ? range_count(s) : s->files.count;
    case SOURCE_LIVE:
    case SOURCE_WATCH: return 0;
    case SOURCE_SKY: return range_count(s);
    case SOURCE_VIDEO: return video_count(s);
    case SOURCE_DAYLIGHT: return s->daylight_count;
    }
    return 0;
}

uint64_t source_count(const struct source *s)
{
    return s->held ? held_count(s) : source_count_skies(s);
}

double source_rate(const struct source *s)
{
    return s->kind == SOURCE_VIDEO ? footage_rate(s->footage) : 0.0;
}

bool source_is_connected(struct source *s, struct reason *why)
{
    return s->kind != SOURCE_LIVE || (s->live && live_is_connected(s->live, why));
}

bool source_gave_up(struct source *s)
{
    return s->live && live_gave_up(s->live);
}

enum source_kind source_kind(const struct source *s)
{
    return s->kind;
}

uint64_t source_position(const struct source *s)
{
    return s->held ? held_position(s) : s->position;
}

/* By time: exact where the images are evenly spaced. */
static bool seek_video(struct source *s, uint64_t picture)
{
    const double rate = footage_rate(s->footage);
    const double us = 1e6 * ((double)picture - 0.5) / rate;
    struct reason why;

    if (!(us < 1e15))
        return false;
    if ((picture == 0 || footage_seek(s->footage, (int64_t)us, &why)) && footage_restart(s->footage, &why)) {
        log_warning("%s", why.text);
        s->video_ended = true;
        return false;
    }
    s->picture = picture;
    s->video_ended = false;
    return true;
}

bool source_seek_sky(struct source *s, uint64_t position)
{
    const uint64_t length = source_count_skies(s);

    if (s->kind == SOURCE_WATCH || s->kind == SOURCE_LIVE || (length > 0 && position >= length))
        return false;
    if (position > FRAME_NUMBER_MAX - (s->frames.given ? s->frames.first : 0))
        return false;
    if (s->kind == SOURCE_VIDEO)
        return seek_video(s, position + (s->frames.given ? s->frames.first : 0));
    if (s->kind == SOURCE_FILES) {
        s->files.next = (size_t)position;
    } else if (s->kind == SOURCE_DAYLIGHT) {
        s->daylight_next = (size_t)position;
    } else {
        s->sky_frame = position + (s->frames.given ? s->frames.first : 0);
        s->sky_ended = false;
    }
    return true;
}

bool source_seek(struct source *s, uint64_t position)
{
    return s->held ? held_seek(s, position) : source_seek_sky(s, position);
}

bool source_step(struct source *s, int64_t by)
{
    const int64_t length = (int64_t)source_count(s), last = (int64_t)FRAME_NUMBER_MAX;
    int64_t to = (int64_t)source_position(s); /* at most `last`, as is the sum */

    by = by < -last ? -last : by > last - to ? last - to : by;
    to += by;

    if (s->kind == SOURCE_WATCH || s->kind == SOURCE_LIVE)
        return false;
    if (length > 0 && s->loop)
        to = (to % length + length) % length;
    else if (length > 0 && to >= length)
        to = length - 1;
    return source_seek(s, to < 0 ? 0 : (uint64_t)to);
}

/* Hours since midnight of frame 0's day, for the last frame returned. */
static double sky_hours(const struct source *s)
{
    return s->sky.hour + s->sky.speed_hours * (double)(s->position + (s->frames.given ? s->frames.first : 0));
}

bool source_set_hour(struct source *s, double hour)
{
    if (s->kind != SOURCE_SKY)
        return false;
    const double midnight = 24.0 * floor(sky_hours(s) / 24.0);
    const uint64_t first = s->frames.given ? s->frames.first : 0;
    s->sky.hour = midnight + hour - s->sky.speed_hours * (double)(s->held ? s->position + first : s->sky_frame);
    s->sky_ended = false;
    held_restart(s);
    return true;
}

const struct sky_desc *source_sky(const struct source *s)
{
    return s->kind != SOURCE_SKY ? NULL : s->held ? held_sky(s) : &s->sky;
}

enum err source_first(const struct source_desc *desc, struct frame *f, struct reason *why)
{
    struct source *s = NULL;
    enum err e = source_open(desc, &s, why);

    if (!e)
        e = source_next(s, f, why);
    /* a live stream connects meanwhile, unless it has given up */
    for (int i = 0; i < FIRST_WAITS && !e && f->kind == FRAME_NONE && s->kind == SOURCE_LIVE && !source_gave_up(s); i++)
        e = source_next(s, f, why);
    source_close(s);
    if (e == ERR_END || (!e && f->kind == FRAME_NONE))
        e = err_say(why, ERR_IO, "%s: contains no frame", desc->spec);
    return e;
}

/* NULL: the source is no weather file. */
static const struct moment *moment_now(const struct source *s)
{
    const struct daylight *d = s->daylight;
    return d && !d->cie && !d->matrix.mf ? daylight_moment(d, s->daylight_first + (size_t)s->position) : NULL;
}

bool source_place(const struct source *s, struct source_place *out)
{
    const struct moment *m = moment_now(s);

    if (!m)
        return false;
    const double degrees = 180.0 / PI, azimuth = degrees * atan2(-m->sun[0], m->sun[2]);
    struct sun_day sun_day = epw_day(&s->daylight->weather, day_of_year(m->month, m->day));

    sun_day.turn = -s->daylight->north;
    *out = (struct source_place){
        .day = (uint32_t)sun_day.day,
        .sun_day = sun_day,
        .hour = m->clock,
        .latitude = s->daylight->weather.latitude,
        .longitude = s->daylight->weather.longitude,
        .zone = s->daylight->weather.zone,
        .north = degrees * s->daylight->north,
        .units = s->daylight->scale,
        .sun_elevation = degrees * m->altitude,
        .sun_azimuth = azimuth < 0.0 ? azimuth + 360.0 : azimuth,
    };
    return true;
}

bool source_set_moment(struct source *s, uint32_t day, double hour)
{
    const struct moment *now = moment_now(s);
    double nearest = INFINITY;
    size_t found = 0;

    if (!now)
        return false;
    const double wanted_day = day > 0 ? (double)day : (double)day_of_year(now->month, now->day);
    const double wanted_hour = hour >= 0.0 ? hour : now->clock;
    for (size_t i = 0; i < s->daylight_count; i++) {
        const struct moment *m = daylight_moment(s->daylight, s->daylight_first + i);
        const double apart = fabs(day_of_year(m->month, m->day) - wanted_day);
        const double far = 1000.0 * fmin(apart, 365.0 - apart) + fabs(m->clock - wanted_hour);
        if (far < nearest) {
            nearest = far;
            found = i;
        }
    }
    return source_seek(s, found * (s->held ? s->desc.between.hold : 1));
}
