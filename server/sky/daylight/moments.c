#include "sky/daylight/moments.h"

#include "base/mem.h"
#include "base/vec.h"
#include "sky/daylight/sun.h"

#include <math.h>
#include <stdio.h>

#define DEGREE (PI / 180.0)
#define SLICES 60      /* of an interval in which the sun rises or sets */
#define DARK 0.5       /* W m^-2, horizontal: less than this counts as night */
#define DEW_POINT 11.0 /* degrees Celsius, where the file does not state it */

/* ---- The sun ---- */

struct sun_day epw_day(const struct epw *w, int day)
{
    return (struct sun_day){ w->latitude * DEGREE, day, .ahead = w->longitude / 15.0 - w->zone };
}

/* In the middle of the part of the interval in which the sun is up; in the middle of all where it always or never is.
 */
static void place_sun(const struct epw *w, struct moment *m)
{
    const struct sun_day day = epw_day(w, day_of_year(m->month, m->day));
    double sum = 0.0, w3[3];
    int up = 0;

    for (int k = 0; k < SLICES; k++) {
        const double clock = m->clock + m->span * ((k + 0.5) / SLICES - 0.5);
        sun_day_at(&day, clock, w3);
        if (w3[1] > 0.0) {
            sum += clock;
            up++;
        }
    }
    sun_day_at(&day, up > 0 ? sum / up : m->clock, m->sun);
    m->altitude = asin(m->sun[1]);
}

/* ---- Light ---- */

static void set_lux(const struct moments_desc *d, double dew_point, struct moment *m)
{
    const double zenith = 0.5 * PI - fmax(m->altitude, 0.0);
    const double dew = isnan(dew_point) ? DEW_POINT : dew_point;
    const bool file = d->efficacy == EFFICACY_FILE;

    if (m->diffuse > 0.0) {
        m->brightness = perez_brightness(zenith, m->diffuse, day_of_year(m->month, m->day));
        m->clearness = perez_clearness(zenith, m->direct_normal, m->diffuse);
    } else {
        m->clearness = 12.0; /* a sun without sky */
        m->brightness = 0.01;
    }
    if (d->efficacy == EFFICACY_FIXED) {
        m->direct_normal_lux = d->lm_per_w * m->direct_normal;
        m->diffuse_lux = d->lm_per_w * m->diffuse;
        return;
    }
    if (!file || isnan(m->direct_normal_lux))
        m->direct_normal_lux = m->direct_normal * perez_direct_efficacy(zenith, m->clearness, m->brightness, dew);
    if (!file || isnan(m->diffuse_lux))
        m->diffuse_lux = m->diffuse * perez_diffuse_efficacy(zenith, m->clearness, m->brightness, dew);
}

static void light(const struct epw *w, const struct moments_desc *d, double dew_point, struct moment *m)
{
    m->missing = isnan(m->direct_normal) || isnan(m->diffuse);
    place_sun(w, m);
    if (m->altitude <= 0.0 && !m->missing) { /* what lights twilight is the sky */
        m->direct_normal = 0.0;
        m->direct_normal_lux = 0.0;
    }
    m->lit = !m->missing && m->direct_normal * fmax(m->sun[1], 0.0) + m->diffuse >= DARK;
    if (m->lit)
        set_lux(d, dew_point, m);
    else
        m->direct_normal_lux = m->diffuse_lux = 0.0;
}

double moment_open_lux(const struct moment *m, bool sun, bool sky)
{
    return (sky ? m->diffuse_lux : 0.0) + (sun ? m->direct_normal_lux * fmax(m->sun[1], 0.0) : 0.0);
}

/* ---- Choosing ---- */

/* Hours since the year began of the middle of a record. */
static double middle(const struct epw *w, const struct epw_record *r)
{
    return 24.0 * (day_of_year(r->month, r->day) - 1) + r->end - 0.5 * w->interval;
}

static bool is_wanted(const struct moments_desc *d, int day, double clock)
{
    const bool inside = d->first_day <= d->last_day ? day >= d->first_day && day <= d->last_day
                                                    : day >= d->first_day || day <= d->last_day;
    return inside && clock >= d->first_hour - 1e-9 && clock <= d->last_hour + 1e-9;
}

static void date_of(int day, int *month, int *of_month)
{
    *month = 1;
    while (*month < 12 && day_of_year(*month + 1, 1) <= day)
        (*month)++;
    *of_month = day - day_of_year(*month, 1) + 1;
}

static double mix(double a, double b, double t)
{
    return t <= 0.0 ? a : t >= 1.0 ? b : (1.0 - t) * a + t * b;
}

/* The weather at a time between the middles of records i and i + 1; or of i alone, t = 0. */
static void fill(const struct epw *w, const struct moments_desc *d, size_t i, double t, struct moment *m)
{
    const struct epw_record *a = &w->records[i], *b = t > 0.0 ? a + 1 : a;

    m->direct_normal = mix(a->direct_normal, b->direct_normal, t);
    m->diffuse = mix(a->diffuse, b->diffuse, t);
    m->direct_normal_lux = mix(a->direct_normal_lux, b->direct_normal_lux, t);
    m->diffuse_lux = mix(a->diffuse_lux, b->diffuse_lux, t);
    light(w, d, a->dew_point, m);
}

static enum err check_order(const struct epw *w, const char *name, struct reason *why)
{
    for (size_t i = 1; i < w->count; i++)
        if (!(middle(w, &w->records[i]) > middle(w, &w->records[i - 1])))
            return err_say(why, ERR_FORMAT,
                           "%s: line %u: %d/%d, hour %g, comes after %d/%d, hour %g: expected the order "
                           "of one year",
                           name, w->records[i].line, w->records[i].month, w->records[i].day, w->records[i].end,
                           w->records[i - 1].month, w->records[i - 1].day, w->records[i - 1].end);
    return ERR_OK;
}

static bool is_leap(const struct epw_record *r)
{
    return r->month == 2 && r->day == 29;
}

/* A year has 365 days: 29 February is left out, or takes the place of 1 March. Returns how many records it has. */
static size_t drop_leap_days(struct epw *w, bool wanted)
{
    size_t kept = 0, leap = 0;

    for (size_t i = 0; i < w->count; i++)
        leap += is_leap(&w->records[i]);
    for (size_t i = 0; i < w->count; i++) {
        const struct epw_record *r = &w->records[i];
        if (wanted && leap > 0 ? r->month != 3 || r->day != 1 : !is_leap(r))
            w->records[kept++] = *r;
    }
    w->count = kept;
    return leap;
}

static enum err choose(const struct epw *w, const struct moments_desc *d, const char *name, struct moments *out,
                       struct reason *why)
{
    const double step = d->step_minutes > 0.0 ? d->step_minutes / 60.0 : w->interval;
    const uint64_t steps = (uint64_t)llround(24.0 * 365 / step);
    const double reach = 0.5 * fmax(w->interval, step) + 1e-6;
    size_t i = 0;

    out->step = step;
    for (uint64_t n = 0; n < steps; n++) {
        const double time = step * ((double)n + 0.5);
        const int day = (int)(time / 24.0) + 1;
        struct moment m = { .number = n, .clock = time - 24.0 * (day - 1), .span = step };
        if (!is_wanted(d, day, m.clock))
            continue;
        while (i + 1 < w->count && middle(w, &w->records[i + 1]) <= time + 1e-6)
            i++;
        const double from = middle(w, &w->records[i]), rest = time - from;
        const double gap = i + 1 < w->count ? middle(w, &w->records[i + 1]) - from : INFINITY;
        double t = rest > 1e-6 && gap < 2.0 * w->interval ? rest / gap : 0.0;
        if (fabs(rest) > reach && t <= 0.0)
            continue; /* the file does not cover it */
        if (!mem_reserve(&out->at, out->count, &out->capacity, sizeof(*out->at)))
            return err_say(why, ERR_NOMEM, "%s: out of memory", name);
        date_of(day, &m.month, &m.day);
        if (d->leap_day) {
            m.month = 2;
            m.day = 29;
        }
        fill(w, d, i, t, &m);
        out->missing += m.missing;
        out->at[out->count++] = m;
    }
    return out->count > 0 ? ERR_OK
                          : err_say(why, ERR_USAGE, "%s: no hour of the file lies within days= and hours=", name);
}

enum err moments_choose(const struct epw *w, const struct moments_desc *desc, const char *name, struct moments *out,
                        struct reason *why)
{
    struct epw year = *w;

    *out = (struct moments){ .leap = drop_leap_days(&year, desc->leap_day) };
    enum err e = year.count > 0
                     ? check_order(&year, name, why)
                     : err_say(why, ERR_FORMAT, "%s: its only day is 29 February: choose it with days=02-29", name);
    if (!e && desc->leap_day && out->leap == 0)
        e = err_say(why, ERR_USAGE, "%s: days=02-29: the file has no 29 February", name);
    if (!e)
        e = choose(&year, desc, name, out, why);
    if (e)
        moments_finish(out);
    return e;
}

void moments_finish(struct moments *m)
{
    mem_free(m->at);
    *m = (struct moments){ .count = 0 };
}

/* ---- Names ---- */

void moment_name(const struct moment *m, char *out, size_t size)
{
    static const char *const months[12] = { "January", "February", "March",     "April",   "May",      "June",
                                            "July",    "August",   "September", "October", "November", "December" };
    const int minutes = (int)lround(60.0 * m->clock);

    snprintf(out, size, "%d %s, %d:%02d", m->day, months[m->month - 1], minutes / 60, minutes % 60);
}

void moments_name_missing(const struct moments *m, char *out, size_t size)
{
    size_t named = 0, used = 0;
    char one[40];

    out[0] = '\0';
    for (size_t i = 0; i < m->count && named < 3; i++) {
        if (!m->at[i].missing)
            continue;
        moment_name(&m->at[i], one, sizeof(one));
        used += (size_t)snprintf(out + used, size - used, "%s%s", named ? "; " : "", one);
        named++;
    }
    if (m->missing > named && used < size)
        snprintf(out + used, size - used, " and %zu more", m->missing - named);
}
