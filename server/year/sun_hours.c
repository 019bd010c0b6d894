#include "year/sun_hours.h"

#include "base/log.h"
#include "base/mem.h"
#include "base/text.h"
#include "image/codec/encode.h"
#include "light/estimators/sunlight.h"
#include "light/resolve/resolve.h"
#include "sky/daylight/sky.h"
#include "year/annual.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define STEP (2.5 / 60.0) /* hours, of a few days, */
#define STEPS 8000        /* up to so many steps; else a moment of the file is one */
#define SUNSHINE 120.0    /* W m^-2, direct normal */
#define COLOURS 8         /* steps of the scale */

struct way {
    struct sun_step *at;
    size_t count, capacity;
    double hours; /* of sun in the open */
    char what[120];
};

static bool add_step(struct way *w, const struct sun_day *day, double from, double to)
{
    double a[3], b[3];

    sun_day_at(day, from, a);
    sun_day_at(day, to, b);
    const double below = fmin(a[1], b[1]), above = fmax(a[1], b[1]);
    if (above <= 0.0)
        return true;
    if (!mem_reserve(&w->at, w->count, &w->capacity, sizeof(*w->at)))
        return false;
    struct sun_step *s = &w->at[w->count++];
    for (int i = 0; i < 3; i++) {
        s->from[i] = (float)a[i];
        s->to[i] = (float)b[i];
    }
    s->hours = (float)(to - from);
    w->hours += (to - from) * (below < 0.0 ? above / (above - below) : 1.0);
    return true;
}

static bool add_day(struct way *w, const struct sun_day *day)
{
    bool all = true;

    for (int k = 0; k < (int)(24.0 / STEP + 0.5) && all; k++)
        all = add_step(w, day, k * STEP, (k + 1) * STEP);
    return all;
}

static enum err take_sky(const char *spec, double turn, struct way *w, struct reason *why)
{
    struct sky_desc sky;
    const enum err e = sky_parse(spec, &sky, why);

    if (e)
        return e;
    struct sun_day day = sky_day(&sky, 0);
    day.turn = turn;
    snprintf(w->what, sizeof(w->what), "day %d of the year at latitude %g", day.day, sky.latitude_degrees);
    return add_day(w, &day) ? ERR_OK : err_say(why, ERR_NOMEM, "out of memory");
}

static bool add_moment(struct way *w, const struct daylight *d, const struct moment *m, double turn, double pieces)
{
    struct sun_day day = epw_day(&d->weather, day_of_year(m->month, m->day));
    const double begin = m->clock - 0.5 * m->span;
    bool all = true;

    day.turn = turn - d->north;
    for (int k = 0; k < pieces && all; k++)
        all = add_step(w, &day, begin + m->span * k / pieces, begin + m->span * (k + 1) / pieces);
    return all;
}

static enum err take_weather(const char *spec, double turn, struct way *w, struct reason *why)
{
    struct daylight *d;
    enum err e = daylight_open(spec, &d, why);
    bool all = true;

    if (!e && (d->cie || d->matrix.mf))
        e = err_say(why, ERR_USAGE,
                    "--sun-hours needs the sun's way over a day or a year: --source sky:... or epw:FILE");
    const double fine = e ? 1.0 : ceil(d->year.step / STEP),
                 pieces = !e && fine * (double)d->count > STEPS ? 1.0 : fine;
    for (size_t i = 0; !e && i < d->count && all; i++) {
        const struct moment *m = daylight_moment(d, i);
        if (d->sun && m->direct_normal >= SUNSHINE)
            all = add_moment(w, d, m, turn, pieces);
    }
    if (!e)
        snprintf(w->what, sizeof(w->what), "%.60s, with sunshine in %.0f hours", d->weather.place, w->hours);
    daylight_close(d);
    return all ? e : err_say(why, ERR_NOMEM, "out of memory");
}

static enum err take_way(const struct setup *s, struct way *w, struct reason *why)
{
    const char *spec = s->source_desc.spec;
    const double turn = s->environment.rotation_degrees * PI / 180.0;

    if (daylight_is(spec))
        return take_weather(spec, turn, w, why);
    if (strncmp(spec, "sky:", 4) == 0)
        return take_sky(spec + 4, turn, w, why);
    return err_say(why, ERR_USAGE,
                   "--sun-hours needs the sun's way over a day or a year: --source sky:... or epw:FILE");
}

/* From points to pixels: the mean of what a pixel shows; NAN where it shows no surface. map: [height][width]. */
static enum err resolve(const struct gbuffer *g, const float *hours, float *map)
{
    const size_t points = (size_t)g->packet_count * PACKET, pixels = (size_t)g->width * g->height;
    float *lo = mem_alloc(3 * points, sizeof(*lo)), *rgb = mem_alloc(3 * pixels, sizeof(*rgb)),
          *whole = mem_alloc(3 * pixels, sizeof(*whole));
    const bool done = lo && rgb && whole;

    for (int turn = 0; turn < 2 && done; turn++) {
        for (size_t i = 0; i < points; i++)
            for (int c = 0; c < 3; c++)
                lo[(i / PACKET * 3 + (size_t)c) * PACKET + i % PACKET] = turn ? 1.0f : hours[i];
        resolve_pixels(g, lo, NULL, turn ? whole : rgb);
    }
    for (size_t i = 0; i < pixels && done; i++) {
        const float all = whole[3 * i] + whole[3 * i + 1] + whole[3 * i + 2];
        map[i] = all > 0.0f ? (rgb[3 * i] + rgb[3 * i + 1] + rgb[3 * i + 2]) / all : NAN;
    }
    mem_free(lo);
    mem_free(rgb);
    mem_free(whole);
    return done ? ERR_OK : ERR_NOMEM;
}

/* A round number of hours that is not below. */
static double scale_of(double hours)
{
    const double unit = pow(10.0, floor(log10(fmax(hours, 1.0) / COLOURS)));

    for (int k = 0;; k++) {
        static const double nice[] = { 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0 };
        if (k == 9 || COLOURS * unit * nice[k] >= hours)
            return COLOURS * unit * nice[k];
    }
}

static enum err write_values(const float *map, uint32_t width, uint32_t height, const char *path, struct reason *why)
{
    const size_t pixels = (size_t)width * height;
    float *rgb = mem_alloc(3 * pixels, sizeof(*rgb));

    if (!rgb)
        return err_say(why, ERR_NOMEM, "out of memory");
    for (size_t i = 0; i < 3 * pixels; i++)
        rgb[i] = isnan(map[i / 3]) ? 0.0f : map[i / 3];
    const struct exr_desc d = { .rgb = rgb, .width = width, .height = height };
    const enum err e = exr_write(&d, path, why);
    mem_free(rgb);
    return e;
}

static enum err write_map(const struct sun_hours_desc *desc, const struct way *w, const struct gbuffer *g,
                          const float *map, struct reason *why)
{
    const double most = scale_of(w->hours);
    double sum = 0.0, least = INFINITY, largest = 0.0;
    size_t seen = 0;

    for (size_t i = 0; i < (size_t)g->width * g->height; i++)
        if (!isnan(map[i])) {
            sum += map[i];
            least = fmin(least, map[i]);
            largest = fmax(largest, map[i]);
            seen++;
        }
    if (seen > 0)
        log_info("hours of sun: %s; in the open %.1f, here %.1f to %.1f, %.1f on average", w->what, w->hours, least,
                 largest, sum / (double)seen);
    if (text_ends_with(desc->path, ".exr"))
        return write_values(map, g->width, g->height, desc->path, why);
    log_info("hours of sun: colours from 0 (dark blue) to %g (red), with a line every %g", most, most / COLOURS);
    return false_colour_write(map, g->width, g->height, most, COLOURS, desc->path, why);
}

static enum err run(const struct sun_hours_desc *desc, const struct way *w, const struct prepared_scene *set,
                    struct reason *why)
{
    const struct gbuffer *g = set->gbuffer;
    float *hours = mem_alloc((size_t)g->packet_count * PACKET + 1, sizeof(*hours));
    float *map = mem_alloc((size_t)g->width * g->height, sizeof(*map));
    struct progress line;
    enum err e = hours && map ? ERR_OK : ERR_NOMEM;

    if (!e) {
        progress_begin(&line, "hours of sun", g->packet_count, stderr);
        sunlight_hours(g, set->rays, w->at, w->count, &line, hours);
        progress_end(&line);
        e = resolve(g, hours, map);
    }
    e = e ? err_say(why, e, "out of memory") : write_map(desc, w, g, map, why);
    mem_free(hours);
    mem_free(map);
    return e;
}

enum err sun_hours_write(const struct sun_hours_desc *desc, struct reason *why)
{
    struct prepared_scene *set = NULL;
    struct way w = { .count = 0 };

    if (!text_ends_with(desc->path, ".exr") && !text_ends_with(desc->path, ".png"))
        return err_say(why, ERR_USAGE, "--sun-hours %s: expected a file name that ends with .png or .exr", desc->path);
    enum err e = take_way(&desc->setup, &w, why);
    if (!e)
        e = set_create(&desc->setup.set_desc, &set, why);
    if (!e)
        e = run(desc, &w, set, why);
    set_destroy(set);
    mem_free(w.at);
    return e;
}
