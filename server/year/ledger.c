#include "year/annual.h"

#include "base/file_store.h"
#include "base/mem.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static const char *const columns[LEDGER_COLUMNS] = {
    [LEDGER_NUMBER] = "number",
    [LEDGER_MONTH] = "month",
    [LEDGER_DAY] = "day",
    [LEDGER_CLOCK] = "clock_h",
    [LEDGER_ALTITUDE] = "sun_altitude_deg",
    [LEDGER_AZIMUTH] = "sun_azimuth_deg",
    [LEDGER_DIRECT_NORMAL] = "direct_normal_w_m2",
    [LEDGER_DIFFUSE] = "diffuse_horizontal_w_m2",
    [LEDGER_OPEN_LUX] = "open_horizontal_lx",
    [LEDGER_RENDERED_LUX] = "rendered_open_horizontal_lx",
    [LEDGER_MEAN_LUX] = "sensors_mean_lx",
    [LEDGER_LEAST_LUX] = "sensors_min_lx",
    [LEDGER_MOST_LUX] = "sensors_max_lx",
    [LEDGER_MEAN_CDM2] = "picture_mean_cd_m2",
    [LEDGER_DGP] = "dgp",
    [LEDGER_EYE_LUX] = "eye_vertical_lx",
};

#define KEY_FILE ".run"
#define LINE_MAX_BYTES ((size_t)1 << 20) /* bounds a row of POINTS_MAX values */

void ledger_path(const char *folder, const char *name, char *out)
{
    snprintf(out, LEDGER_PATH, "%s/%s", folder, name);
}

static enum err io_error(const char *path, struct reason *why)
{
    return err_say(why, ERR_IO, "%s: %s", path, strerror(errno));
}

/* ---- What an earlier run left ---- */

struct old {
    FILE *hours, *lux;
    char *line;
    float *values;
    long hours_end, lux_end; /* of the last row that both have */
};

/* Reads a whole line; false at the end, or where it breaks off. */
static bool read_line(FILE *f, char *line)
{
    return fgets(line, (int)LINE_MAX_BYTES, f) && strchr(line, '\n');
}

static bool parse_row(char *line, struct ledger_row *row)
{
    char *at = line;

    for (int k = 0; k < LEDGER_COLUMNS; k++) {
        char *end;
        row->value[k] = strtod(at, &end);
        if (end == at)
            row->value[k] = NAN; /* an empty field */
        if (*end != (k + 1 < LEDGER_COLUMNS ? ',' : '\n'))
            return false;
        at = end + 1;
    }
    const double *v = row->value; /* maps are drawn from these; false for NAN, too */
    return v[LEDGER_MONTH] >= 1.0 && v[LEDGER_MONTH] <= 12.0 && v[LEDGER_DAY] >= 1.0 && v[LEDGER_DAY] <= 31.0 &&
           v[LEDGER_CLOCK] >= 0.0 && v[LEDGER_CLOCK] <= 24.0;
}

static bool parse_lux(char *line, size_t sensors, double number, float *out)
{
    char *at;

    if (strtod(line, &at) != number)
        return false;
    for (size_t i = 0; i < sensors; i++) {
        char *end;
        if (*at != ',')
            return false;
        out[i] = strtof(at + 1, &end);
        if (end == at + 1)
            return false;
        at = end;
    }
    return *at == '\n';
}

static enum err keep_row(struct ledger *l, const struct ledger_row *row, struct reason *why)
{
    if (!mem_reserve(&l->rows, l->count, &l->capacity, sizeof(*l->rows)))
        return err_say(why, ERR_NOMEM, "out of memory");
    l->rows[l->count++] = *row;
    return ERR_OK;
}

static enum err replay_rows(struct ledger *l, struct old *o, ledger_replay *replay, void *self, struct reason *why)
{
    struct ledger_row row;
    enum err e = ERR_OK;

    if (!read_line(o->hours, o->line) || !read_line(o->lux, o->line))
        return ERR_OK; /* not even headers */
    o->hours_end = ftell(o->hours);
    o->lux_end = ftell(o->lux);
    while (!e && read_line(o->hours, o->line) && parse_row(o->line, &row) && read_line(o->lux, o->line) &&
           parse_lux(o->line, l->sensors, row.value[LEDGER_NUMBER], o->values)) {
        e = keep_row(l, &row, why);
        if (!e)
            replay(self, &row, o->values);
        o->hours_end = ftell(o->hours);
        o->lux_end = ftell(o->lux);
    }
    return e;
}

/* Cuts off what follows the last row that both tables have. */
static enum err cut(const char *path, FILE *f, long end, struct reason *why)
{
    return ftruncate(fileno(f), end) == 0 && fseek(f, end, SEEK_SET) == 0 ? ERR_OK : io_error(path, why);
}

static enum err take_old(struct ledger *l, const char *const path[2], ledger_replay *replay, void *self,
                         struct reason *why)
{
    struct old o = { .hours = fopen(path[0], "r+"), .lux = fopen(path[1], "r+") };
    enum err e = ERR_OK;

    o.line = mem_alloc_raw(LINE_MAX_BYTES, 1);
    o.values = mem_alloc(l->sensors + 1, sizeof(*o.values));
    if (!o.line || !o.values)
        e = err_say(why, ERR_NOMEM, "out of memory");
    if (!e && o.hours && o.lux)
        e = replay_rows(l, &o, replay, self, why);
    if (!e && o.hours_end > 0) {
        e = cut(path[0], o.hours, o.hours_end, why);
        if (!e)
            e = cut(path[1], o.lux, o.lux_end, why);
        l->hours = o.hours;
        l->lux = o.lux;
        o.hours = o.lux = NULL;
    }
    if (o.hours)
        fclose(o.hours);
    if (o.lux)
        fclose(o.lux);
    mem_free(o.line);
    mem_free(o.values);
    return e;
}

/* ---- Opening ---- */

static enum err begin(struct ledger *l, const char *const path[2], struct reason *why)
{
    l->hours = file_rewrite(path[0]);
    if (!l->hours)
        return io_error(path[0], why);
    l->lux = file_rewrite(path[1]);
    if (!l->lux)
        return io_error(path[1], why);
    for (int k = 0; k < LEDGER_COLUMNS; k++)
        fprintf(l->hours, "%s%s", k ? "," : "", columns[k]);
    fputs("\n", l->hours);
    fputs("number", l->lux);
    for (size_t i = 0; i < l->sensors; i++)
        fprintf(l->lux, ",lx_%zu", i);
    fputs("\n", l->lux);
    return ERR_OK;
}

/* Whether the folder's tables are of the same run; *none: there are none. */
static bool is_same(const char *path, const char *key, bool *none)
{
    char old[64] = "";
    FILE *f = fopen(path, "r");

    *none = !f;
    if (!f)
        return false;
    const bool same = fgets(old, sizeof(old), f) && strcmp(old, key) == 0;
    fclose(f);
    return same;
}

enum err ledger_open(struct ledger *l, const char *folder, const struct digest *key, size_t sensors, bool resume,
                     ledger_replay *replay, void *self, struct reason *why)
{
    char hours[LEDGER_PATH], lux[LEDGER_PATH], run[LEDGER_PATH], text[64];
    const char *const path[2] = { hours, lux };
    bool none = true;
    enum err e = ERR_OK;

    *l = (struct ledger){ .sensors = sensors };
    if (strlen(folder) >= sizeof(l->folder))
        return err_say(why, ERR_USAGE, "--annual '%.100s...': the name is too long", folder);
    strcpy(l->folder, folder);
    ledger_path(l->folder, "hours.csv", hours);
    ledger_path(l->folder, "illuminance.csv", lux);
    ledger_path(l->folder, KEY_FILE, run);
    snprintf(text, sizeof(text), "%016" PRIx64 "%016" PRIx64 "\n", key->half[0], key->half[1]);
    const bool same = resume && is_same(run, text, &none);
    if (resume && !none && !same)
        return err_say(
            why, ERR_USAGE,
            "--resume: %s has tables for another scene, weather, sensors or settings; omit --resume to replace it",
            folder);
    if (same)
        e = take_old(l, path, replay, self, why);
    if (!e && !l->hours)
        e = begin(l, path, why);
    if (!e && !same)
        e = file_store(run, text, strlen(text), why);
    return e;
}

enum err ledger_add(struct ledger *l, const struct ledger_row *row, const float *lux, struct reason *why)
{
    for (int k = 0; k < LEDGER_COLUMNS; k++) {
        if (k)
            fputc(',', l->hours);
        if (!isnan(row->value[k]))
            fprintf(l->hours, k == LEDGER_NUMBER ? "%.0f" : "%.12g", row->value[k]);
    }
    fputc('\n', l->hours);
    fprintf(l->lux, "%.0f", row->value[LEDGER_NUMBER]);
    for (size_t i = 0; i < l->sensors; i++)
        fprintf(l->lux, ",%.9g", (double)lux[i]);
    fputc('\n', l->lux);
    if (fflush(l->hours) || fflush(l->lux) || ferror(l->hours) || ferror(l->lux))
        return io_error(l->folder, why);
    return keep_row(l, row, why);
}

void ledger_close(struct ledger *l)
{
    if (l->hours)
        fclose(l->hours);
    if (l->lux)
        fclose(l->lux);
    mem_free(l->rows);
    *l = (struct ledger){ .count = 0 };
}
