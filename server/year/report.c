#include "year/annual_internal.h"

#include "base/log.h"
#include "base/mem.h"
#include "base/sort.h"
#include "base/text.h"

#include <jansson.h>
#include <math.h>
#include <stdarg.h>
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
    set_real(j, "occupied_hours", a->occupied);
    set_real(j, "largest_deviation_open_horizontal", open_deviation(a));
    json_object_set_new(j, "sensors", json_integer((json_int_t)a->points.count));
    if (a->points.count > 0) {
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

/* ---- Maps ---- */

static const struct paint_scale share_scale = { 0.0, 100.0, false, "%" };

/* The scale of a column of the rows, up to its 98th percentile. */
static double percentile_of(const struct annual *a, enum ledger_column column)
{
    double *v = mem_alloc(a->ledger.count + 1, sizeof(*v)), out = 1.0;

    for (size_t i = 0; v && i < a->ledger.count; i++)
        v[i] = a->ledger.rows[i].value[column];
    if (v && a->ledger.count > 0) {
        sort_doubles(v, a->ledger.count);
        out = fmax(1e-3, v[(size_t)(0.98 * (double)(a->ledger.count - 1))]);
    }
    mem_free(v);
    return paint_round_up(out);
}

static enum err map_rows(struct annual *a, enum ledger_column column, const struct paint_scale *scale,
                         const char *title, const char *name, struct reason *why)
{
    char path[LEDGER_PATH];

    ledger_path(a->desc.folder, name, path);
    return map_year(&a->ledger, column, a->weather->year.step, title, scale, path, why);
}

enum sensor_measure { SENSOR_AUTONOMY, SENSOR_USEFUL, SENSOR_SUNLIT, SENSOR_FACTOR, SENSOR_MEASURES };

static double measure_of(const struct annual *a, enum sensor_measure k, size_t i)
{
    const struct sensor_year *s = &a->sensors[i];

    switch (k) {
    case SENSOR_AUTONOMY: return 100.0 * s->autonomous / a->occupied;
    case SENSOR_USEFUL: return 100.0 * s->udi[2] / a->occupied;
    case SENSOR_SUNLIT: return s->sunlit;
    default: return 100.0 * (double)a->factor[i];
    }
}

static const struct {
    const char *file, *title, *words;
} sensor_maps[SENSOR_MEASURES] = {
    { "sensors-autonomy.png", "% OF OCCUPIED TIME WITH 300 LX",
      "Daylight autonomy: share of the occupied time with 300 lx" },
    { "sensors-useful.png", "% OF OCCUPIED TIME WITH 300-3000 LX",
      "Useful daylight: share of the occupied time with 300 to 3000 lx" },
    { "sensors-sunlit.png", "OCCUPIED HOURS WITH 1000 LX OF SUN",
      "Sunlight exposure: occupied hours with 1000 lx from the sun alone" },
    { "sensors-factor.png", "DAYLIGHT FACTOR, %", "Daylight factor under the CIE Standard Overcast Sky, per cent" },
};

static enum err map_measures(struct annual *a, struct reason *why)
{
    double *v = mem_alloc(a->points.count + 1, sizeof(*v));
    enum err e = v ? ERR_OK : err_say(why, ERR_NOMEM, "out of memory");

    for (int k = 0; k < SENSOR_MEASURES && !e && a->points.count > 0; k++) {
        char path[LEDGER_PATH];
        double most = 0.0;
        for (size_t i = 0; i < a->points.count; i++) {
            v[i] = measure_of(a, (enum sensor_measure)k, i);
            most = fmax(most, v[i]);
        }
        const struct paint_scale sun = { 0.0, 500.0, false, "H" };
        const struct paint_scale factor = { 0.0, paint_round_up(fmax(1.0, most)), false, "%" };
        ledger_path(a->desc.folder, sensor_maps[k].file, path);
        e = map_sensors(&a->points, v, sensor_maps[k].title,
                        k == SENSOR_SUNLIT   ? &sun
                        : k == SENSOR_FACTOR ? &factor
                                             : &share_scale,
                        path, why);
    }
    mem_free(v);
    return e;
}

static enum err map_hours(struct annual *a, struct reason *why)
{
    const struct paint_scale lux = { 0.0, percentile_of(a, LEDGER_MEAN_LUX), false, "LX" };
    const struct paint_scale open = { 0.0, 100000.0, false, "LX" };
    const struct paint_scale cdm2 = { 0.0, percentile_of(a, LEDGER_MEAN_CDM2), false, "CD/M2" };
    const struct paint_scale dgp = { 0.2, 0.5, false, "DGP" };
    enum err e = map_rows(a, LEDGER_OPEN_LUX, &open, "HORIZONTAL ILLUMINANCE IN THE OPEN", "year-open.png", why);

    if (!e && a->points.count > 0)
        e = map_rows(a, LEDGER_MEAN_LUX, &lux, "MEAN ILLUMINANCE OF THE SENSORS", "year-sensors.png", why);
    if (!e)
        e = map_rows(a, LEDGER_MEAN_CDM2, &cdm2, "MEAN LUMINANCE OF THE VIEW", "year-view.png", why);
    if (!e && a->glare)
        e = map_rows(a, LEDGER_DGP, &dgp, "DAYLIGHT GLARE PROBABILITY", "year-glare.png", why);
    return e;
}

/* ---- The page ---- */

static void print_text(struct text *t, const char *bytes)
{
    char utf8[LEDGER_PATH];

    text_in_utf8(bytes, utf8, sizeof(utf8));
    text_add_escaped(t, utf8);
}

static void print_row(struct text *t, const char *name, const char *format, ...) PRINTF_LIKE(3, 4);
static void print_row(struct text *t, const char *name, const char *format, ...)
{
    char text[200];
    va_list list;

    va_start(list, format);
    vsnprintf(text, sizeof(text), format, list);
    va_end(list);
    text_add(t, "<tr><th>%s</th><td>", name);
    print_text(t, text);
    text_add(t, "</td></tr>\n");
}

static void print_image(struct text *t, const char *file, const char *words)
{
    text_add(t, "<figure><img src=\"%s\" alt=\"%s\"><figcaption>%s</figcaption></figure>\n", file, words, words);
}

static void print_measures(const struct annual *a, const struct measures_summary *m, struct text *t)
{
    const struct measures_desc *d = &a->desc.measures;

    text_add(t, "<table>\n");
    print_row(t, "Scene", "%s", a->set->name);
    print_row(t, "Weather", "%s: %s", a->weather->file, a->weather->weather.place);
    print_row(t, "Hours", "%zu with daylight, %zu missing; occupied: %.0f, from %g to %g o'clock", a->ledger.count,
              a->weather->year.missing, a->occupied, d->first_hour, d->last_hour);
    if (a->points.count > 0) {
        print_row(t, "Spatial daylight autonomy", "sDA %g lx, %g %%: %.1f %% of %zu sensors", d->autonomy_lux,
                  100.0 * d->autonomy_share, 100.0 * m->sda, a->points.count);
        print_row(t, "Annual sunlight exposure", "ASE %g lx, %g h: %.1f %% of the sensors", d->sun_lux, d->sun_hours,
                  100.0 * m->ase);
        print_row(t, "Useful daylight illuminance",
                  "below 100 lx %.1f %%, 100 to 300 lx %.1f %%, 300 to 3000 lx %.1f %%, above %.1f %% of the time",
                  100.0 * m->udi[0], 100.0 * m->udi[1], 100.0 * m->udi[2], 100.0 * m->udi[3]);
        print_row(t, "Daylight factor", "mean %.2f %%", 100.0 * mean_factor(a));
    }
    if (a->glare)
        print_row(t, "Glare", "DGP above 0.35 %.1f %%, above 0.40 %.1f %%, above 0.45 %.1f %% of occupied lit hours",
                  100.0 * glare_share(a, 0.35), 100.0 * glare_share(a, 0.40), 100.0 * glare_share(a, 0.45));
    text_add(t, "</table>\n");
}

static void print_page(const struct annual *a, const struct measures_summary *m, struct text *t)
{
    char name[64], file[96], words[96];

    text_add(t, "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><title>A year of light</title>\n<style>"
                "body{font:15px/1.5 system-ui,sans-serif;max-width:1320px;margin:2em auto;padding:0 1em;color:#222}"
                "th{text-align:left;padding-right:2em;font-weight:600;vertical-align:top}figure{display:inline-block;"
                "margin:0 1.5em 1.5em 0;vertical-align:top}img{max-width:100%%}figcaption{color:#555}</style>\n"
                "<h1>A year of light</h1>\n");
    print_measures(a, m, t);
    text_add(t, "<h2>Over the year</h2>\n");
    if (a->points.count > 0)
        print_image(t, "year-sensors.png", "Mean illuminance of the sensors: days to the right, hours downwards");
    if (a->glare)
        print_image(t, "year-glare.png", "Daylight glare probability of the view");
    print_image(t, "year-view.png", "Mean luminance of the view");
    print_image(t, "year-open.png", "Outdoor horizontal illuminance, from the weather file");
    if (a->points.count > 0)
        text_add(t, "<h2>Sensors</h2>\n");
    for (int k = 0; k < SENSOR_MEASURES && a->points.count > 0; k++)
        print_image(t, sensor_maps[k].file, sensor_maps[k].words);
    if (a->image_count > 0)
        text_add(t, "<h2>Chosen hours</h2>\n");
    for (int k = 0; k < a->image_count; k++) {
        const struct annual_image *p = &a->images[k];
        const int minutes = (int)lround(60.0 * p->clock);
        annual_image_name(p, name, sizeof(name));
        snprintf(words, sizeof(words), "%02d-%02d, %d:%02d", p->month, p->day, minutes / 60, minutes % 60);
        snprintf(file, sizeof(file), "%s.png", name);
        print_image(t, file, words);
        snprintf(file, sizeof(file), "%s-falsecolour.png", name);
        print_image(t, file, "Luminance");
    }
    text_add(
        t, "<p>Tables: <a href=\"hours.csv\">hours.csv</a>, <a href=\"sensors.csv\">sensors.csv</a>, "
           "<a href=\"illuminance.csv\">illuminance.csv</a>, <a href=\"summary.json\">summary.json</a></p>\n</html>\n");
}

static enum err write_page(struct annual *a, const struct measures_summary *m, struct reason *why)
{
    struct text t = { .bytes = NULL };

    print_page(a, m, &t);
    return store(a, "index.html", &t, why);
}

enum err annual_report(struct annual *a, struct reason *why)
{
    struct measures_summary m;

    a->occupied = fmax(a->occupied, 1e-9);
    measures_summarise(&a->desc.measures, a->sensors, a->points.count, a->occupied, &m);
    enum err e = a->points.count > 0 ? write_sensors(a, why) : ERR_OK;
    if (!e)
        e = write_summary(a, &m, why);
    if (!e)
        e = map_hours(a, why);
    if (!e)
        e = map_measures(a, why);
    if (!e)
        e = write_page(a, &m, why);
    if (e)
        return e;
    if (a->points.count > 0)
        log_info("sDA %.1f %%, ASE %.1f %%, useful daylight %.1f %% of the time, mean daylight factor %.2f %%",
                 100.0 * m.sda, 100.0 * m.ase, 100.0 * m.udi[2], 100.0 * mean_factor(a));
    log_info("%s/index.html shows the year", a->desc.folder);
    return ERR_OK;
}
