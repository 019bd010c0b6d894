#include "year/annual.h"

#include "base/file_store.h"
#include "base/mem.h"
#include "image/codec/encode.h"
#include "image/film/film.h"
#include "light/radiance/components.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static enum err add(struct annual *a, int month, int day, double clock, struct reason *why)
{
    if (a->image_count == IMAGES_MAX)
        return err_say(why, ERR_USAGE, "--pictures: at most %d", IMAGES_MAX);
    a->images[a->image_count++] = (struct annual_image){ .month = month, .day = day, .clock = clock };
    return ERR_OK;
}

/* The lit moment of an image; NULL: there is none. */
static const struct moment *moment_of(const struct annual *a, const struct annual_image *p)
{
    for (size_t i = 0; i < a->weather->count; i++) {
        const struct moment *m = daylight_moment(a->weather, i);
        if (m->month == p->month && m->day == p->day && p->clock >= m->clock - 0.5 * m->span - 1e-9 &&
            p->clock < m->clock + 0.5 * m->span - 1e-9)
            return m;
    }
    return NULL;
}

static enum err read_one(struct annual *a, const char *text, struct reason *why)
{
    unsigned month = 0, day = 0, hour = 0, minute = 0;
    int used = 0;

    if (sscanf(text, "%2u-%2uT%2u:%2u%n", &month, &day, &hour, &minute, &used) != 4 || text[used])
        return err_say(why, ERR_USAGE, "--pictures: '%s' is not MM-DDTHH:MM (such as 03-21T09:30), seasons or none",
                       text);
    if (hour > 23 || minute > 59)
        return err_say(why, ERR_USAGE, "--pictures: %s has no time of day; expected 00:00 to 23:59", text);
    enum err e = add(a, (int)month, (int)day, hour + minute / 60.0, why);
    if (!e && !moment_of(a, &a->images[a->image_count - 1]))
        e = err_say(why, ERR_USAGE, "--pictures: %s is not among the lit hours of %s", text, a->weather->file);
    return e;
}

enum err annual_images_read(struct annual *a, struct reason *why)
{
    static const int seasons[4][2] = { { 3, 21 }, { 6, 21 }, { 9, 21 }, { 12, 21 } };
    const char *at = a->desc.images ? a->desc.images : "seasons";
    enum err e = ERR_OK;

    if (strcmp(at, "none") == 0)
        return ERR_OK;
    for (int k = 0; strcmp(at, "seasons") == 0 && k < 12 && !e; k++) {
        const struct annual_image p = { seasons[k / 3][0], seasons[k / 3][1], 9.5 + 3.0 * (k % 3), false };
        if (moment_of(a, &p))
            e = add(a, p.month, p.day, p.clock, why);
        if (k == 11)
            return e;
    }
    while (*at && !e) {
        const size_t length = strcspn(at, ",");
        char one[32];
        snprintf(one, sizeof(one), "%.*s", (int)(length < 31 ? length : 31), at);
        at += length + (at[length] == ',');
        e = read_one(a, one, why);
    }
    return e;
}

struct annual_image *annual_image_of(struct annual *a, const struct moment *m)
{
    for (int k = 0; k < a->image_count; k++)
        if (!a->images[k].done && moment_of(a, &a->images[k]) == m)
            return &a->images[k];
    return NULL;
}

void annual_image_name(const struct annual_image *p, char *out, size_t size)
{
    const int minutes = (int)lround(60.0 * p->clock);

    snprintf(out, size, "picture-%02d%02d-%02d%02d", p->month, p->day, minutes / 60 % 100, minutes % 60);
}

static enum err store_png(const uint8_t *rgb, uint32_t width, uint32_t height, const char *path, struct reason *why)
{
    const struct png_desc d = { .samples = rgb, .width = width, .height = height };
    uint8_t *bytes = NULL;
    size_t size = 0;
    enum err e = png_encode(&d, &bytes, &size, why);

    if (!e)
        e = file_store(path, bytes, size, why);
    mem_free(bytes);
    return e;
}

enum err false_colour_write(const float *values, uint32_t width, uint32_t height, double most, int steps,
                            const char *path, struct reason *why)
{
    uint8_t *pixels = mem_alloc((size_t)width * height, 3);

    if (!pixels)
        return err_say(why, ERR_NOMEM, "out of memory");
    false_colour_map(values, width, height, most, steps, pixels);
    const enum err e = store_png(pixels, width, height, path, why);
    mem_free(pixels);
    return e;
}

/* As the eye sees it, exposed by itself. */
static enum err write_seen(struct annual *a, const char *path, struct reason *why)
{
    const struct setup *s = &a->desc.setup;
    const uint32_t width = s->set_desc.width, height = s->set_desc.height;
    const bool fixed = s->initial.exposure_stops < EXPOSURE_FOLLOW;
    double log2_mean = 0.0;
    uint8_t *pixels = mem_alloc((size_t)width * height, 3);

    if (!pixels)
        return err_say(why, ERR_NOMEM, "out of memory");
    (void)exposure_log2_mean(a->rgb, NULL, width, height, &log2_mean);
    const double gain = fixed ? exp2(s->initial.exposure_stops) : 0.18 / exp2(log2_mean);
    const struct tone_desc tone = { gain, s->initial.tone, s->kernels ? s->kernels->level : NULL };
    tone_map(a->rgb, width, height, &tone, pixels);
    const enum err e = store_png(pixels, width, height, path, why);
    mem_free(pixels);
    return e;
}

/* In W sr^-1 m^-2, as Radiance has it: luminance is 179 times the value. */
static enum err write_hdr(const struct annual *a, const struct moment *m, const char *path, struct reason *why)
{
    char lines[1024], when[40], view[RADIANCE_VIEW_LINE];
    const struct view *v = &a->set->view;

    moment_name(m, when, sizeof(when));
    radiance_view_line(v, view);
    snprintf(lines, sizeof(lines), "relight-render: %s, %s\n%s", a->weather->weather.place, when, view);
    for (char *c = lines; *c; c++)
        if ((unsigned char)*c > 126 || *c == '\r')
            *c = '?';
    const struct hdr_desc d = { a->rgb, v->width, v->height, lines };
    return hdr_write(&d, path, why);
}

#define LEAST_CDM2 1.0
#define DECADES 4
#define STEPS 8 /* outlined */

/* Luminance in false colour, logarithmic, the same in all images. */
static enum err write_luminance(const struct annual *a, const char *path, struct reason *why)
{
    const uint32_t width = a->set->view.width, height = a->set->view.height;
    const size_t count = (size_t)width * height;
    float *shares = mem_alloc(count, sizeof(*shares));

    if (!shares)
        return err_say(why, ERR_NOMEM, "out of memory");
    for (size_t i = 0; i < count; i++)
        shares[i] = (float)fmin(1.0, log10(fmax((double)a->cdm2[i], LEAST_CDM2) / LEAST_CDM2) / DECADES);
    const enum err e = false_colour_write(shares, width, height, 1.0, STEPS, path, why);
    mem_free(shares);
    return e;
}

enum err annual_image_write(struct annual *a, const struct moment *m, struct reason *why)
{
    const struct annual_image *p = annual_image_of(a, m);
    char name[64], file[96], path[LEDGER_PATH];

    annual_image_name(p, name, sizeof(name));
    snprintf(file, sizeof(file), "%s.png", name);
    ledger_path(a->desc.folder, file, path);
    enum err e = write_seen(a, path, why);
    snprintf(file, sizeof(file), "%s.hdr", name);
    ledger_path(a->desc.folder, file, path);
    if (!e)
        e = write_hdr(a, m, path, why);
    snprintf(file, sizeof(file), "%s-falsecolour.png", name);
    ledger_path(a->desc.folder, file, path);
    return e ? e : write_luminance(a, path, why);
}
