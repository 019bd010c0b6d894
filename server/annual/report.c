#include "annual/annual_parts.h"

#include "annual/maps.h"
#include "base/file_store.h"
#include "base/log.h"
#include "base/mem.h"

#include <jansson.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- Tables ---- */

static enum err store_text(struct annual *a, const char *name, const char *text, size_t size, struct reason *why)
{
    char path[LEDGER_PATH];

    ledger_path(a->desc.folder, name, path);
    return file_store(path, text, size, why);
}

static void print_sensors(const struct annual *a, FILE *f)
{
    fputs("sensor,x,y,z,nx,ny,nz,daylight_autonomy,udi_below_100,udi_100_300,udi_300_3000,udi_above_3000,"
          "sunlit_hours,daylight_factor,klux_hours,max_lx\n",
          f);
    for (size_t i = 0; i < a->points.count; i++) {
        const struct sensor_year *s = &a->sensors[i];
        const struct sensor *at = &a->points.at[i];
        fprintf(f, "%zu,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.4f", i, (double)at->position.x, (double)at->position.y,
                (double)at->position.z, (double)at->normal.x, (double)at->normal.y, (double)at->normal.z,
                s->autonomous / a->occupied);
        for (int k = 0; k < 4; k++)
            fprintf(f, ",%.4f", s->udi[k] / a->occupied);
        fprintf(f, ",%.6g,%.5f,%.6g,%.6g\n", s->sunlit, (double)a->factor[i], 1e-3 * s->lux_hours, s->lux_max);
    }
}

static enum err write_sensors(struct annual *a, struct reason *why)
{
    char *text = NULL;
    size_t size = 0;
    FILE *f = open_memstream(&text, &size);

    if (!f)
        return err_say(why, ERR_NOMEM, "out of memory");
    print_sensors(a, f);
    const bool bad = fclose(f) != 0;
    const enum err e = bad ? err_say(why, ERR_NOMEM, "out of memory") : store_text(a, "sensors.csv", text, size, why);
    free(text);
    return e;
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
    char *text = j ? json_dumps(j, JSON_INDENT(2) | JSON_REAL_PRECISION(6)) : NULL;
    const enum err e =
        text ? store_text(a, "summary.json", text, strlen(text), why) : err_say(why, ERR_NOMEM, "out of memory");

    free(text);
    json_decref(j);
    return e;
}

/* ---- Maps ---- */

static const struct paint_scale share_scale = { 0.0, 100.0, false, "%" };

/* The scale of a column of the rows, up to its 98th percentile. */
static int ascending(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

static double percentile_of(const struct annual *a, enum ledger_column column)
{
    double *v = mem_alloc(a->ledger.count + 1, sizeof(*v)), out = 1.0;

    for (size_t i = 0; v && i < a->ledger.count; i++)
        v[i] = a->ledger.rows[i].value[column];
    if (v && a->ledger.count > 0) {
        qsort(v, a->ledger.count, sizeof(*v), ascending);
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

/* Text for HTML. */
static void print_text(FILE *f, const char *bytes)
{
    char utf8[LEDGER_PATH];

    text_in_utf8(bytes, utf8, sizeof(utf8));
    for (const char *text = utf8; *text; text++)
        switch (*text) {
        case '<': fputs("&lt;", f); break;
        case '>': fputs("&gt;", f); break;
        case '&': fputs("&amp;", f); break;
        case '"': fputs("&quot;", f); break;
        default: fputc(*text, f);
        }
}

static void print_row(FILE *f, const char *name, const char *format, ...) PRINTF_LIKE(3, 4);
static void print_row(FILE *f, const char *name, const char *format, ...)
{
    char text[200];
    va_list list;

    va_start(list, format);
    vsnprintf(text, sizeof(text), format, list);
    va_end(list);
    fprintf(f, "<tr><th>%s</th><td>", name);
    print_text(f, text);
    fputs("</td></tr>\n", f);
}

static void print_image(FILE *f, const char *file, const char *words)
{
    fprintf(f, "<figure><img src=\"%s\" alt=\"%s\"><figcaption>%s</figcaption></figure>\n", file, words, words);
}

static void print_measures(const struct annual *a, const struct measures_summary *m, FILE *f)
{
    const struct measures_desc *d = &a->desc.measures;

    fputs("<table>\n", f);
    print_row(f, "Scene", "%s", a->set->name);
    print_row(f, "Weather", "%s: %s", a->weather->file, a->weather->weather.place);
    print_row(f, "Hours", "%zu with daylight, %zu missing; occupied: %.0f, from %g to %g o'clock", a->ledger.count,
              a->weather->year.missing, a->occupied, d->first_hour, d->last_hour);
    if (a->points.count > 0) {
        print_row(f, "Spatial daylight autonomy", "sDA %g lx, %g %%: %.1f %% of %zu sensors", d->autonomy_lux,
                  100.0 * d->autonomy_share, 100.0 * m->sda, a->points.count);
        print_row(f, "Annual sunlight exposure", "ASE %g lx, %g h: %.1f %% of the sensors", d->sun_lux, d->sun_hours,
                  100.0 * m->ase);
        print_row(f, "Useful daylight illuminance",
                  "below 100 lx %.1f %%, 100 to 300 lx %.1f %%, 300 to 3000 lx %.1f %%, above %.1f %% of the time",
                  100.0 * m->udi[0], 100.0 * m->udi[1], 100.0 * m->udi[2], 100.0 * m->udi[3]);
        print_row(f, "Daylight factor", "mean %.2f %%", 100.0 * mean_factor(a));
    }
    if (a->glare)
        print_row(f, "Glare", "DGP above 0.35 %.1f %%, above 0.40 %.1f %%, above 0.45 %.1f %% of occupied lit hours",
                  100.0 * glare_share(a, 0.35), 100.0 * glare_share(a, 0.40), 100.0 * glare_share(a, 0.45));
    fputs("</table>\n", f);
}

static void print_page(const struct annual *a, const struct measures_summary *m, FILE *f)
{
    char name[64], file[96], words[96];

    fputs("<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><title>A year of light</title>\n<style>"
          "body{font:15px/1.5 system-ui,sans-serif;max-width:1320px;margin:2em auto;padding:0 1em;color:#222}"
          "th{text-align:left;padding-right:2em;font-weight:600;vertical-align:top}figure{display:inline-block;"
          "margin:0 1.5em 1.5em 0;vertical-align:top}img{max-width:100%}figcaption{color:#555}</style>\n"
          "<h1>A year of light</h1>\n",
          f);
    print_measures(a, m, f);
    fputs("<h2>Over the year</h2>\n", f);
    if (a->points.count > 0)
        print_image(f, "year-sensors.png", "Mean illuminance of the sensors: days to the right, hours downwards");
    if (a->glare)
        print_image(f, "year-glare.png", "Daylight glare probability of the view");
    print_image(f, "year-view.png", "Mean luminance of the view");
    print_image(f, "year-open.png", "Outdoor horizontal illuminance, from the weather file");
    if (a->points.count > 0)
        fputs("<h2>Sensors</h2>\n", f);
    for (int k = 0; k < SENSOR_MEASURES && a->points.count > 0; k++)
        print_image(f, sensor_maps[k].file, sensor_maps[k].words);
    if (a->picture_count > 0)
        fputs("<h2>Chosen hours</h2>\n", f);
    for (int k = 0; k < a->picture_count; k++) {
        const struct annual_picture *p = &a->pictures[k];
        const int minutes = (int)lround(60.0 * p->clock);
        annual_picture_name(p, name, sizeof(name));
        snprintf(words, sizeof(words), "%02d-%02d, %d:%02d", p->month, p->day, minutes / 60, minutes % 60);
        snprintf(file, sizeof(file), "%s.png", name);
        print_image(f, file, words);
        snprintf(file, sizeof(file), "%s-falsecolour.png", name);
        print_image(f, file, "Luminance");
    }
    fputs("<p>Tables: <a href=\"hours.csv\">hours.csv</a>, <a href=\"sensors.csv\">sensors.csv</a>, "
          "<a href=\"illuminance.csv\">illuminance.csv</a>, <a href=\"summary.json\">summary.json</a></p>\n</html>\n",
          f);
}

static enum err write_page(struct annual *a, const struct measures_summary *m, struct reason *why)
{
    char *text = NULL;
    size_t size = 0;
    FILE *f = open_memstream(&text, &size);

    if (!f)
        return err_say(why, ERR_NOMEM, "out of memory");
    print_page(a, m, f);
    const bool bad = fclose(f) != 0;
    const enum err e = bad ? err_say(why, ERR_NOMEM, "out of memory") : store_text(a, "index.html", text, size, why);
    free(text);
    return e;
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
