#include "sky/daylight/sky.h"

#include "base/log.h"
#include "base/luminance.h"
#include "base/mem.h"
#include "base/vec.h"
#include "sky/daylight/reinhart.h"
#include "sky/daylight/sun.h"

#include <assert.h>
#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define DEGREE (PI / 180.0)

const char *const daylight_help =
    "epw: FILE         an EnergyPlus weather file; one frame for each hour with daylight\n"
    "days=all          MM-DD, or MM-DD:MM-DD from the first to the last\n"
    "hours=0-24        clock hours (local standard time)\n"
    "step=60           minutes from frame to frame, a divisor of a day; default: as the file\n"
    "efficacy=perez    lux from watts: perez, file (its illuminances), or a number in lm/W\n"
    "cie: TYPE         a sky of ISO 15469, 1 to 15, or 16, the traditional overcast sky; one frame\n"
    "lux=10000         horizontal illuminance of that sky without the sun\n"
    "altitude=45       of the sun, degrees; azimuth=180: from north over east\n"
    "direct=0          normal illuminance of that sun, lux\n"
    "mtx: FILE         a matrix of Radiance's gendaymtx; one frame for each time step with light, numbered from 0\n"
    "suns=FILE         mtx: with sharp suns, those of gendaymtx -D FILE\n"
    "north=0           epw and cie: where north is, degrees from +Z towards east, as seen from above\n"
    "ground=0.2        likewise: albedo of the ground below the horizon\n"
    "only=all          likewise: sun or sky alone\n"
    "scale=1           all: output units per W sr^-1 m^-2\n"
    "size=1024x512     epw and cie: texels; must be 2:1 with an even height\n";

bool daylight_is(const char *spec)
{
    return strncmp(spec, "epw:", 4) == 0 || strncmp(spec, "cie:", 4) == 0 || strncmp(spec, "mtx:", 4) == 0;
}

/* ---- Parsing ---- */

struct keys {
    struct daylight *d;
    struct moments_desc choice;
    char suns[4096];                       /* of mtx: */
    double lux, altitude, azimuth, direct; /* of cie: */
    const char *scheme;
};

static const struct number_key {
    const char *name;
    bool epw, cie;
    size_t offset; /* in struct keys */
    double least, most, unit;
} number_keys[] = {
    { "step", true, false, offsetof(struct keys, choice.step_minutes), 1.0, 1440.0, 1.0 },
    { "lux", false, true, offsetof(struct keys, lux), 0.0, 200000.0, 1.0 },
    { "altitude", false, true, offsetof(struct keys, altitude), 0.0, 90.0, DEGREE },
    { "azimuth", false, true, offsetof(struct keys, azimuth), -360.0, 360.0, DEGREE },
    { "direct", false, true, offsetof(struct keys, direct), 0.0, 200000.0, 1.0 },
};

static enum err take_number(const char *scheme, const char *name, const char *value, double least, double most,
                            double *out, struct reason *why)
{
    char *end;

    *out = strtod(value, &end);
    if (end == value || *end || !(*out >= least && *out <= most))
        return err_say(why, ERR_USAGE, "%s %s=%s is not a number from %g to %g", scheme, name, value, least, most);
    return ERR_OK;
}

static enum err take_day(const char *value, const char *text, size_t length, int *out, bool *leap, struct reason *why)
{
    static const int days[12] = { 31, 29, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31 };
    int month = 0, day = 0, used = 0;
    char one[16];

    snprintf(one, sizeof(one), "%.*s", (int)(length < 15 ? length : 15), text);
    if (sscanf(one, "%2d-%2d%n", &month, &day, &used) != 2 || one[used] || month < 1 || month > 12 || day < 1 ||
        day > days[month - 1])
        return err_say(why, ERR_USAGE, "epw: days=%s: '%s' is not a date; expected MM-DD or MM-DD:MM-DD", value, one);
    *out = day_of_year(month, day); /* 29 February is the 60th, as 1 March */
    *leap = month == 2 && day == 29;
    return ERR_OK;
}

static enum err take_days(struct moments_desc *c, const char *value, struct reason *why)
{
    const char *colon = strchr(value, ':');
    const size_t first = colon ? (size_t)(colon - value) : strlen(value);
    bool from_leap = false, to_leap = false;

    if (strcmp(value, "all") == 0)
        return ERR_OK;
    enum err e = take_day(value, value, first, &c->first_day, &from_leap, why);
    c->last_day = c->first_day;
    to_leap = from_leap;
    if (!e && colon)
        e = take_day(value, colon + 1, strlen(colon + 1), &c->last_day, &to_leap, why);
    c->leap_day = from_leap && to_leap;
    c->last_day -= to_leap && !from_leap;
    return e;
}

static enum err take_hours(struct moments_desc *c, const char *value, struct reason *why)
{
    int used = 0;

    if (sscanf(value, "%lf-%lf%n", &c->first_hour, &c->last_hour, &used) != 2 || value[used] ||
        !(c->first_hour >= 0.0 && c->first_hour < c->last_hour && c->last_hour <= 24.0))
        return err_say(why, ERR_USAGE, "epw: hours=%s is not A-B with clock hours from 0 to 24", value);
    return ERR_OK;
}

static enum err take_efficacy(struct moments_desc *c, const char *value, struct reason *why)
{
    if (strcmp(value, "perez") == 0)
        c->efficacy = EFFICACY_PEREZ;
    else if (strcmp(value, "file") == 0)
        c->efficacy = EFFICACY_FILE;
    else {
        c->efficacy = EFFICACY_FIXED;
        if (take_number("epw:", "efficacy", value, 1.0, 683.0, &c->lm_per_w, NULL))
            return err_say(why, ERR_USAGE, "epw: efficacy=%s is not perez, file or a number from 1 to 683 (lm/W)",
                           value);
    }
    return ERR_OK;
}

static enum err take_size(struct keys *k, const char *value, struct reason *why)
{
    unsigned w = 0, h = 0;
    int used = 0;

    if (sscanf(value, "%5ux%5u%n", &w, &h, &used) != 2 || value[used] || h < 2 || h % 2 || w != 2 * h ||
        w > SKY_SIDE_MAX)
        return err_say(why, ERR_USAGE,
                       "%s size=%s is not WIDTHxHEIGHT; expected 2:1 from 4x2 to %dx%d with an even height", k->scheme,
                       value, SKY_SIDE_MAX, SKY_SIDE_MAX / 2);
    k->d->width = w;
    k->d->height = h;
    return ERR_OK;
}

/* Keys of both kinds; *known: it is one of them. */
static enum err take_common(struct keys *k, const char *name, const char *value, bool *known, struct reason *why)
{
    struct daylight *d = k->d;
    enum err e = ERR_OK;

    *known = true;
    if (strcmp(name, "north") == 0) {
        e = take_number(k->scheme, name, value, -360.0, 360.0, &d->north, why);
        d->north *= DEGREE;
    } else if (strcmp(name, "ground") == 0) {
        e = take_number(k->scheme, name, value, 0.0, 1.0, &d->ground_albedo, why);
    } else if (strcmp(name, "scale") == 0) {
        e = take_number(k->scheme, name, value, 1e-9, 1e9, &d->scale, why);
    } else if (strcmp(name, "size") == 0) {
        e = take_size(k, value, why);
    } else if (strcmp(name, "only") == 0) {
        d->sun = strcmp(value, "sky") != 0;
        d->sky = strcmp(value, "sun") != 0;
        if (d->sun && d->sky && strcmp(value, "all") != 0)
            e = err_say(why, ERR_USAGE, "%s only=%s is not sun, sky or all", k->scheme, value);
    } else {
        *known = false;
    }
    return e;
}

static enum err take_key(struct keys *k, const char *name, const char *value, struct reason *why)
{
    const bool epw = !k->d->cie;
    bool known;

    if (strcmp(k->scheme, "mtx:") == 0 && strcmp(name, "suns") == 0) {
        snprintf(k->suns, sizeof(k->suns), "%s", value);
        return ERR_OK;
    }
    if (strcmp(k->scheme, "mtx:") == 0 && strcmp(name, "scale") != 0)
        return err_say(why, ERR_USAGE, "mtx: unknown key '%s'; expected suns or scale", name);
    const enum err e = take_common(k, name, value, &known, why);

    if (e || known)
        return e;
    if (epw && strcmp(name, "days") == 0)
        return take_days(&k->choice, value, why);
    if (epw && strcmp(name, "hours") == 0)
        return take_hours(&k->choice, value, why);
    if (epw && strcmp(name, "efficacy") == 0)
        return take_efficacy(&k->choice, value, why);
    for (size_t i = 0; i < sizeof(number_keys) / sizeof(number_keys[0]); i++) {
        const struct number_key *n = &number_keys[i];
        double *out = (double *)((char *)k + n->offset);
        if (strcmp(name, n->name) != 0 || !(epw ? n->epw : n->cie))
            continue;
        const enum err failed = take_number(k->scheme, name, value, n->least, n->most, out, why);
        *out *= n->unit;
        return failed;
    }
    return err_say(why, ERR_USAGE, "%s unknown key '%s'; expected %s, north, ground, only, scale or size", k->scheme,
                   name, epw ? "days, hours, step, efficacy" : "lux, altitude, azimuth, direct");
}

/* The first comma that a key follows: file names may contain commas. */
static const char *keys_of(const char *text)
{
    for (const char *at = strchr(text, ','); at; at = strchr(at + 1, ',')) {
        size_t n = 0;
        while (isalpha((unsigned char)at[1 + n]))
            n++;
        if (n > 0 && at[1 + n] == '=')
            return at;
    }
    return text + strlen(text);
}

static enum err take_keys(struct keys *k, const char *text, struct reason *why)
{
    char key[4096];

    while (*text) {
        text++; /* the comma */
        const size_t length = strcspn(text, ",");
        snprintf(key, sizeof(key), "%.*s", (int)(length < sizeof(key) - 1 ? length : sizeof(key) - 1), text);
        text += length;
        char *equals = strchr(key, '=');
        if (!equals)
            return err_say(why, ERR_USAGE, "%s '%s' has no value; expected KEY=VALUE", k->scheme, key);
        *equals = '\0';
        const enum err e = take_key(k, key, equals + 1, why);
        if (e)
            return e;
    }
    return ERR_OK;
}

/* ---- Opening ---- */

static enum err list_lit(struct daylight *d, struct reason *why)
{
    d->lit = mem_alloc(d->year.count, sizeof(*d->lit));
    if (!d->lit)
        return err_say(why, ERR_NOMEM, "out of memory");
    for (size_t i = 0; i < d->year.count; i++)
        if (d->year.at[i].lit)
            d->lit[d->count++] = i;
    return d->count > 0 ? ERR_OK : err_say(why, ERR_USAGE, "%s: there is no daylight in the chosen hours", d->file);
}

static enum err open_weather(struct keys *k, struct reason *why)
{
    struct daylight *d = k->d;
    char missing[200];
    enum err e = epw_read(d->file, &d->weather, why);

    if (!e && fmod(1440.0, k->choice.step_minutes > 0.0 ? k->choice.step_minutes : 60.0) != 0.0)
        e = err_say(why, ERR_USAGE, "epw: step=%g does not divide a day of 1440 minutes", k->choice.step_minutes);
    if (!e)
        e = moments_choose(&d->weather, &k->choice, d->file, &d->year, why);
    if (!e)
        e = list_lit(d, why);
    if (e)
        return e;
    if (d->year.missing > 0) {
        moments_name_missing(&d->year, missing, sizeof(missing));
        log_warning("%s: no irradiance for %zu of %zu moments, which are skipped: %s", d->file, d->year.missing,
                    d->year.count, missing);
    }
    if (d->weather.mended > 0)
        log_warning(
            "%s: %zu measurements are blank or negative: those a little below 0 became 0, others count as missing",
            d->file, d->weather.mended);
    if (d->year.leap > 0 && !k->choice.leap_day)
        log_info("%s: 29 February is left out", d->file);
    return ERR_OK;
}

/* One moment; the sun matters to the pattern even where it has no light of its own. */
static enum err open_standard(struct keys *k, struct reason *why)
{
    struct daylight *d = k->d;

    d->year.at = mem_alloc(1, sizeof(*d->year.at));
    if (!d->year.at)
        return err_say(why, ERR_NOMEM, "out of memory");
    d->year.count = d->year.capacity = 1;
    d->year.at[0] = (struct moment){
        .month = 3,
        .day = 21,
        .clock = 12.0,
        .span = 1.0,
        .lit = true,
        .diffuse_lux = k->lux,
        .direct_normal_lux = k->direct,
        .diffuse = k->lux / LUMINOUS_EFFICACY,
        .direct_normal = k->direct / LUMINOUS_EFFICACY,
        .altitude = k->altitude,
        .sun = { -cos(k->altitude) * sin(k->azimuth), sin(k->altitude), cos(k->altitude) * cos(k->azimuth) },
    };
    return list_lit(d, why);
}

/* Day of the year, from 0, as month and day. */
static void set_day(struct moment *m, int day)
{
    static const int lengths[12] = { 31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31 };

    m->month = 1;
    for (m->day = day % 365 + 1; m->day > lengths[m->month - 1]; m->month++)
        m->day -= lengths[m->month - 1];
}

/* Sharp suns in place of those in the patches. */
static enum err add_suns(struct daylight *d, const char *path, struct reason *why)
{
    struct matrix_sun *suns = mem_alloc(d->matrix.steps, sizeof(*suns));
    bool taken = false;
    enum err e = suns ? matrix_suns_read(path, &d->matrix, suns, why) : ERR_NOMEM;

    if (!e)
        e = matrix_suns_take_out(&d->matrix, suns, &taken);
    for (size_t i = 0; i < d->matrix.steps && !e; i++) {
        struct moment *m = &d->year.at[i];
        memcpy(m->sun, suns[i].sun, sizeof(m->sun));
        m->altitude = asin(fmax(-1.0, fmin(1.0, suns[i].sun[1])));
        m->direct_normal = suns[i].normal;
        m->direct_normal_lux = LUMINOUS_EFFICACY * suns[i].normal;
        m->lit = m->lit || suns[i].normal > 0.0;
        if (suns[i].minute >= 0.0) {
            set_day(m, (int)(suns[i].minute / 1440.0));
            m->clock = fmod(suns[i].minute, 1440.0) / 60.0;
        }
    }
    mem_free(suns);
    if (e == ERR_NOMEM)
        return err_say(why, e, "%s: out of memory", path);
    if (!e)
        log_info("%s: sharp suns; %s", path,
                 taken ? "they are taken out of the matrix's patches" : "the matrix holds the sky alone");
    return e;
}

/* A moment for each time step; 8,760 of them are the hours of a year. */
static enum err open_matrix(struct daylight *d, const char *suns, struct reason *why)
{
    enum err e = sky_matrix_read(d->file, &d->matrix, why);

    if (e)
        return e;
    reinhart_size(d->matrix.mf, &d->width, &d->height);
    d->year.at = mem_alloc(d->matrix.steps, sizeof(*d->year.at));
    if (!d->year.at)
        return err_say(why, ERR_NOMEM, "%s: out of memory", d->file);
    d->year.count = d->year.capacity = d->matrix.steps;
    for (size_t i = 0; i < d->matrix.steps; i++) {
        d->year.at[i] = (struct moment){
            .number = i, .clock = (double)(i % 24) + 0.5, .span = 1.0, .lit = sky_matrix_is_lit(&d->matrix, i)
        };
        set_day(&d->year.at[i], (int)(i / 24 % 365));
    }
    if (suns[0])
        e = add_suns(d, suns, why);
    return e ? e : list_lit(d, why);
}

static enum err read_type(struct daylight *d, const char *text, size_t length, struct reason *why)
{
    char type[16];
    char *end;

    snprintf(type, sizeof(type), "%.*s", (int)(length < 15 ? length : 15), text);
    const long n = strtol(type, &end, 10);
    if (end == type || *end || n < 1 || n > CIE_SKIES)
        return err_say(why, ERR_USAGE,
                       "cie:%s: there is no such sky; expected 1 to 15 of ISO 15469, or 16, the traditional overcast "
                       "sky",
                       type);
    d->cie = (int)n;
    return ERR_OK;
}

enum err daylight_open(const char *spec, struct daylight **out, struct reason *why)
{
    const char *text = spec + 4, *list = keys_of(text);
    const size_t length = (size_t)(list - text);
    struct daylight *d = mem_alloc(1, sizeof(*d));
    struct keys keys = { .d = d,
                         .choice = { .first_day = 1, .last_day = 365, .last_hour = 24.0 },
                         .lux = 10000.0,
                         .altitude = 45.0 * DEGREE,
                         .azimuth = PI };
    enum err e = ERR_OK;

    *out = NULL;
    if (!d)
        return err_say(why, ERR_NOMEM, "out of memory");
    *d =
        (struct daylight){ .ground_albedo = 0.2, .sun = true, .sky = true, .scale = 1.0, .width = 1024, .height = 512 };
    const bool cie = strncmp(spec, "cie:", 4) == 0;
    const bool matrix = strncmp(spec, "mtx:", 4) == 0;
    keys.scheme = cie ? "cie:" : matrix ? "mtx:" : "epw:";
    if (cie)
        e = read_type(d, text, length, why);
    else if (length == 0 || length >= sizeof(d->file))
        e = err_say(why, ERR_USAGE, "%s: the %s is missing; expected %s", spec, matrix ? "matrix" : "weather file",
                    matrix ? "mtx:FILE" : "epw:FILE.epw");
    else
        memcpy(d->file, text, length);
    if (!e)
        e = take_keys(&keys, list, why);
    if (!e)
        e = cie ? open_standard(&keys, why) : matrix ? open_matrix(d, keys.suns, why) : open_weather(&keys, why);
    if (e)
        daylight_close(d);
    else
        *out = d;
    return e;
}

void daylight_close(struct daylight *d)
{
    if (!d)
        return;
    epw_finish(&d->weather);
    sky_matrix_finish(&d->matrix);
    moments_finish(&d->year);
    mem_free(d->lit);
    mem_free(d);
}

const struct moment *daylight_moment(const struct daylight *d, size_t index)
{
    assert(index < d->count);
    return &d->year.at[d->lit[index]];
}

void daylight_sun(const struct daylight *d, const struct moment *m, double w[3])
{
    const double c = cos(d->north), s = sin(d->north);

    w[0] = c * m->sun[0] - s * m->sun[2];
    w[1] = m->sun[1];
    w[2] = s * m->sun[0] + c * m->sun[2];
}
