#include "year/annual_internal.h"

#include "base/file_store.h"
#include "base/mem.h"
#include "image/codec/hdr_write.h"
#include "image/codec/jpeg.h"
#include "image/film/film.h"
#include "light/radiance/components.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
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

/* As the eye sees it, exposed by itself. */
static enum err write_seen(struct annual *a, const char *path, struct reason *why)
{
    const struct setup *s = &a->desc.setup;
    const uint32_t width = s->set_desc.width, height = s->set_desc.height;
    const bool fixed = s->initial.exposure_stops < EXPOSURE_FOLLOW;
    double log2_mean = 0.0;
    uint8_t *pixels = mem_alloc((size_t)width * height, 3), *bytes = NULL;
    size_t size = 0;

    if (!pixels)
        return err_say(why, ERR_NOMEM, "out of memory");
    (void)exposure_log2_mean(a->rgb, NULL, width, height, &log2_mean);
    const double gain = fixed ? exp2(s->initial.exposure_stops) : 0.18 / exp2(log2_mean);
    const struct tone_desc tone = { gain, s->initial.tone, s->kernels ? s->kernels->level : NULL };
    tone_map(a->rgb, width, height, &tone, pixels);
    const struct png_desc d = { .samples = pixels, .width = width, .height = height };
    enum err e = png_encode(&d, &bytes, &size, why);
    if (!e)
        e = file_store(path, bytes, size, why);
    mem_free(pixels);
    mem_free(bytes);
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

static int ascending(const void *a, const void *b)
{
    const float x = *(const float *)a, y = *(const float *)b;
    return x < y ? -1 : x > y;
}

/* The power of ten above 99 % of the pixels: three decades below it take the scale. */
static double ceiling(const struct annual *a)
{
    const size_t pixels = (size_t)a->set->view.width * a->set->view.height;
    float *sorted = mem_alloc_raw(pixels, sizeof(*sorted));
    double top = 10000.0;

    if (sorted) {
        memcpy(sorted, a->cdm2, pixels * sizeof(*sorted));
        qsort(sorted, pixels, sizeof(*sorted), ascending);
        top = fmax(sorted[(size_t)(0.99 * (double)(pixels - 1))], 0.01);
    }
    mem_free(sorted);
    return pow(10.0, ceil(log10(top)));
}

enum err annual_image_write(struct annual *a, const struct moment *m, struct reason *why)
{
    const double top = ceiling(a);
    const struct paint_scale scale = { 1e-3 * top, top, true, "CD/M2" };
    const struct annual_image *p = annual_image_of(a, m);
    const struct view *v = &a->set->view;
    char name[64], file[96], path[LEDGER_PATH], title[96], when[40];

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
    moment_name(m, when, sizeof(when));
    snprintf(title, sizeof(title), "LUMINANCE, %s", when);
    return e ? e : map_luminance(a->cdm2, v->width, v->height, title, &scale, path, why);
}
