#include "year/annual.h"

#include "base/log.h"
#include "base/text.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- Tables ---- */

/* Frees the text. */
static enum err store(struct annual *a, const char *name, struct text *t, struct reason *why)
{
    char path[LEDGER_PATH];

    ledger_path(a->desc.folder, name, path);
    const enum err e = text_store(t, path, why);
    text_finish(t);
    return e;
}

static void print_sensors(const struct annual *a, struct text *t)
{
    text_add(t, "sensor,x,y,z,nx,ny,nz,daylight_autonomy,udi_below_100,udi_100_300,udi_300_3000,udi_above_3000,"
                "sunlit_hours,daylight_factor,klux_hours,max_lx\n");
    for (size_t i = 0; i < a->points.count; i++) {
        const struct sensor_year *s = &a->sensors[i];
        const struct sensor *at = &a->points.at[i];
        text_add(t, "%zu,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.4f", i, (double)at->position.x, (double)at->position.y,
                 (double)at->position.z, (double)at->normal.x, (double)at->normal.y, (double)at->normal.z,
                 s->autonomous / a->occupied);
        for (int k = 0; k < 4; k++)
            text_add(t, ",%.4f", s->udi[k] / a->occupied);
        text_add(t, ",%.6g,%.5f,%.6g,%.6g\n", s->sunlit, (double)a->factor[i], 1e-3 * s->lux_hours, s->lux_max);
    }
}

static enum err write_sensors(struct annual *a, struct reason *why)
{
    struct text t = { .bytes = NULL };

    print_sensors(a, &t);
    return store(a, "sensors.csv", &t, why);
}

/* ---- The summary ---- */

static double mean_factor(const struct annual *a)
{
    double sum = 0.0;

    for (size_t i = 0; i < a->points.count; i++)
        sum += a->factor[i];
    return a->points.count > 0 ? sum / (double)a->points.count : NAN;
}

/* Share of the rows' hours with a DGP above a bound. */
static double glare_share(const struct annual *a, double bound)
{
    size_t above = 0, all = 0;

    for (size_t i = 0; i < a->ledger.count; i++) {
        const double *v = a->ledger.rows[i].value;
        if (isnan(v[LEDGER_DGP]) || !measures_occupied(&a->desc.measures, v[LEDGER_CLOCK]))
            continue;
        all++;
        above += v[LEDGER_DGP] > bound;
    }
    return all > 0 ? (double)above / (double)all : NAN;
}

/* The largest deviation of the rendered sky's horizontal illuminance from the weather's. */
static double open_deviation(const struct annual *a)
{
    double worst = 0.0;

    for (size_t i = 0; i < a->ledger.count; i++) {
        const double *v = a->ledger.rows[i].value;
        if (v[LEDGER_OPEN_LUX] > 0.0)
            worst = fmax(worst, fabs(v[LEDGER_RENDERED_LUX] / v[LEDGER_OPEN_LUX] - 1.0));
    }
    return worst;
}

static void set_real(json_t *j, const char *key, double v)
{
    json_object_set_new(j, key, isnan(v) ? json_null() : json_real(v));
}

/* Text that is not UTF-8 counts as Latin-1, as many weather files have it. */
static void text_in_utf8(const char *text, char *out, size_t size)
{
    json_t *valid = json_string(text);
    size_t used = 0;

    for (const unsigned char *c = (const unsigned char *)text; *c && used + 3 < size; c++) {
        if (!valid && *c >= 0x80)
            out[used++] = (char)(0xc0 | *c >> 6);
        out[used++] = (char)(!valid && *c >= 0x80 ? 0x80 | (*c & 0x3f) : *c);
    }
    out[used] = '\0';
    json_decref(valid);
}

static json_t *text_json(const char *text)
{
    char utf8[LEDGER_PATH];

    text_in_utf8(text, utf8, sizeof(utf8));
    return json_string(utf8);
}

/* What year.py says beside the measures. */
static json_t *measures_json(const struct measures_desc *d)
{
    return json_pack("{s:f, s:f, s:f, s:f, s:f, s:f}", "first_hour", d->first_hour, "last_hour", d->last_hour,
                     "autonomy_lux", d->autonomy_lux, "autonomy_share", d->autonomy_share, "sun_lux", d->sun_lux,
                     "sun_hours", d->sun_hours);
}

static json_t *images_json(const struct annual *a)
{
    json_t *list = json_array();
    char name[64], when[32];

    for (int k = 0; k < a->image_count; k++) {
        const struct annual_image *p = &a->images[k];
        const int minutes = (int)lround(60.0 * p->clock);
        annual_image_name(p, name, sizeof(name));
        snprintf(when, sizeof(when), "%02d-%02d, %d:%02d", p->month, p->day, minutes / 60, minutes % 60);
        json_array_append_new(list, json_pack("{s:s, s:s}", "name", name, "when", when));
    }
    return list;
}

static json_t *summary_json(const struct annual *a, const struct measures_summary *m)
{
    const struct daylight *w = a->weather;
    json_t *j = json_object(), *place = json_object();

    json_object_set_new(place, "name", text_json(w->weather.place));
    set_real(place, "latitude", w->weather.latitude);
    set_real(place, "longitude", w->weather.longitude);
    json_object_set_new(j, "place", place);
    json_object_set_new(j, "weather_file", text_json(w->file));
    json_object_set_new(j, "scene", text_json(a->set->name));
    json_object_set_new(j, "method", json_string(method_name(a->light.direct.method)));
    json_object_set_new(j, "lit_hours", json_integer((json_int_t)a->ledger.count));
    json_object_set_new(j, "missing_hours", json_integer((json_int_t)w->year.missing));
    set_real(j, "step_hours", w->year.step);
    set_real(j, "occupied_hours", a->occupied);
    json_object_set_new(j, "measures", measures_json(&a->desc.measures));
    json_object_set_new(j, "pictures", images_json(a));
    set_real(j, "largest_deviation_open_horizontal", open_deviation(a));
    json_object_set_new(j, "sensors", json_integer((json_int_t)a->points.count));
    if (a->points.count > 0) {
        set_real(j, "spacing", a->points.spacing);
        set_real(j, "sda", m->sda);
        set_real(j, "ase", m->ase);
        set_real(j, "mean_daylight_autonomy", m->autonomy);
        set_real(j, "udi_below_100", m->udi[0]);
        set_real(j, "udi_100_300", m->udi[1]);
        set_real(j, "udi_300_3000", m->udi[2]);
        set_real(j, "udi_above_3000", m->udi[3]);
        set_real(j, "mean_daylight_factor", mean_factor(a));
    }
    if (a->glare) {
        set_real(j, "occupied_share_dgp_above_0.35", glare_share(a, 0.35));
        set_real(j, "occupied_share_dgp_above_0.40", glare_share(a, 0.40));
        set_real(j, "occupied_share_dgp_above_0.45", glare_share(a, 0.45));
    }
    return j;
}

static enum err write_summary(struct annual *a, const struct measures_summary *m, struct reason *why)
{
    json_t *j = summary_json(a, m);
    char *dump = j ? json_dumps(j, JSON_INDENT(2) | JSON_REAL_PRECISION(6)) : NULL;
    struct text t = { .failed = !dump };

    text_add(&t, "%s", dump ? dump : "");
    free(dump);
    json_decref(j);
    return store(a, "summary.json", &t, why);
}

enum err annual_report(struct annual *a, struct reason *why)
{
    struct measures_summary m;

    a->occupied = fmax(a->occupied, 1e-9);
    measures_summarise(&a->desc.measures, a->sensors, a->points.count, a->occupied, &m);
    enum err e = a->points.count > 0 ? write_sensors(a, why) : ERR_OK;
    if (!e)
        e = write_summary(a, &m, why);
    if (!e && a->points.count > 0)
        log_info("sDA %.1f %%, ASE %.1f %%, useful daylight %.1f %% of the time, mean daylight factor %.2f %%",
                 100.0 * m.sda, 100.0 * m.ase, 100.0 * m.udi[2], 100.0 * mean_factor(a));
    return e;
}
