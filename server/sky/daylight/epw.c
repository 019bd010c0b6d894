#include "sky/daylight/moments.h"

#include "base/mem.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#define FILE_MAX ((size_t)64 << 20) /* bounds memory; a year of hours is 2 MB */
#define FIELDS_MAX 64               /* bounds a table; a record has 35 */

/* A line as fields, within the text. */
struct line {
    const char *file;
    uint32_t number; /* from 1 */
    char *fields[FIELDS_MAX];
    int count;
};

enum need {
    NEEDED,   /* else the file is refused */
    MEASURED, /* blank, negative or at least `missing`: the hour lacks it; a little below 0 is 0, as sensors drift */
    UNREAD,   /* by most uses: whatever is no value is missing */
};

/* A field of a record. A value of `missing` or more counts as missing, as the format defines. */
struct field {
    int index; /* from 0 */
    const char *name;
    double least, most, missing;
    enum need need;
    bool whole;
};

#define DRIFT -20.0 /* W/m^2: what a sensor may show at night */

static const struct field month_field = { 1, "month", 1, 12, INFINITY, NEEDED, true };
static const struct field day_field = { 2, "day", 1, 31, INFINITY, NEEDED, true };
static const struct field hour_field = { 3, "hour", 1, 24, INFINITY, NEEDED, true };
static const struct field dew_field = { 7, "dew point temperature", -90, 70, 99.9, UNREAD, false };
static const struct field direct_field = { 14, "direct normal radiation", 0, 1500, 9999, MEASURED, false };
static const struct field diffuse_field = { 15, "diffuse horizontal radiation", 0, 1500, 9999, MEASURED, false };
static const struct field direct_lux_field = { 17, "direct normal illuminance", 0, 200000, 999900, UNREAD, false };
static const struct field diffuse_lux_field = {
    18, "diffuse horizontal illuminance", 0, 200000, 999900, UNREAD, false
};

/* ---- Lines and fields ---- */

/* Takes the next line from *text, and its fields; false at the end of the text. */
static bool next_line(char **text, struct line *l)
{
    char *at = *text;

    if (!*at)
        return false;
    char *end = at + strcspn(at, "\r\n");
    *text = end + (end[0] == '\r' && end[1] == '\n' ? 2 : *end ? 1 : 0);
    *end = '\0';
    l->number++;
    l->count = 0;
    while (l->count < FIELDS_MAX) {
        char *quote = *at == '"' ? strchr(at + 1, '"') : NULL; /* a comma between quotes separates nothing */
        char *comma = strchr(quote ? quote : at, ',');
        if (quote && (quote[1] == ',' || !quote[1])) {
            at++;
            *quote = '\0';
        }
        l->fields[l->count++] = at;
        if (!comma)
            break;
        *comma = '\0';
        at = comma + 1;
    }
    return true;
}

/* Nothing, or a word that spreadsheets write for it. */
static bool is_blank(const char *text)
{
    static const char *const words[] = { "", "-", "--", "N/A", "#N/A", "NA", "NaN", "null", "none", "missing" };
    const size_t at = strspn(text, " \t"), length = strcspn(text + at, " \t");

    for (size_t i = 0; i < sizeof(words) / sizeof(words[0]); i++)
        if (length == strlen(words[i]) && strncasecmp(text + at, words[i], length) == 0)
            return true;
    return false;
}

/* *mended counts what became 0 or missing and was not stated as missing; NULL: of no interest. */
static enum err take_number(const struct line *l, const struct field *f, double *out, size_t *mended,
                            struct reason *why)
{
    char *end;

    if (l->count <= f->index) {
        *out = NAN;
        return f->need == UNREAD ? ERR_OK
                                 : err_say(why, ERR_FORMAT, "%s: line %u: has %d fields; field %d, the %s, is missing",
                                           l->file, l->number, l->count, f->index + 1, f->name);
    }
    const char *text = l->fields[f->index];
    *out = strtod(text, &end);
    const bool blank = is_blank(text);
    const bool number = end != text && !end[strspn(end, " \t")] && isfinite(*out);
    const bool lacks = blank || (number && f->need == MEASURED && *out < f->least);
    if (f->need != NEEDED && (lacks || (f->need == UNREAD && !(number && *out >= f->least && *out <= f->most)))) {
        const bool drift = f->need == MEASURED && number && *out >= DRIFT;
        if (mended && f->need == MEASURED)
            ++*mended;
        *out = drift ? 0.0 : NAN;
        return ERR_OK;
    }
    if (!number)
        return err_say(why, ERR_FORMAT, "%s: line %u: field %d, the %s, is '%.20s', which is not a number", l->file,
                       l->number, f->index + 1, f->name, text);
    if (*out >= f->missing) {
        *out = NAN;
        return ERR_OK;
    }
    if (*out < f->least || *out > f->most)
        return err_say(why, ERR_RANGE, "%s: line %u: field %d, the %s, is %g; expected %g to %g", l->file, l->number,
                       f->index + 1, f->name, *out, f->least, f->most);
    if (f->whole && *out != floor(*out))
        return err_say(why, ERR_FORMAT, "%s: line %u: field %d, the %s, is %.20s; expected a whole number", l->file,
                       l->number, f->index + 1, f->name, text);
    return ERR_OK;
}

/* ---- The header ---- */

static enum err take_location(const struct line *l, struct epw *out, struct reason *why)
{
    static const struct field latitude = { 6, "latitude", -90, 90, INFINITY, NEEDED, false };
    static const struct field longitude = { 7, "longitude", -180, 180, INFINITY, NEEDED, false };
    static const struct field zone = { 8, "time zone", -12, 14, INFINITY, NEEDED, false };
    enum err e = take_number(l, &latitude, &out->latitude, NULL, why);

    if (!e)
        e = take_number(l, &longitude, &out->longitude, NULL, why);
    if (!e)
        e = take_number(l, &zone, &out->zone, NULL, why);
    if (!e)
        snprintf(out->place, sizeof(out->place), "%.60s, %.30s", l->fields[1], l->fields[3]);
    return e;
}

/* Lines up to DATA PERIODS, which has the number of records per hour. */
static enum err take_header(char **text, struct line *l, struct epw *out, struct reason *why)
{
    static const struct field per_hour = { 2, "number of records per hour", 1, 60, INFINITY, NEEDED, false };
    double n = 1.0;
    enum err e;

    if (!next_line(text, l) || strcasecmp(l->fields[0], "LOCATION") != 0)
        return err_say(why, ERR_FORMAT,
                       "%s: line 1: expected LOCATION and the place; this is not an EnergyPlus weather file", l->file);
    e = take_location(l, out, why);
    while (!e) {
        if (!next_line(text, l))
            return err_say(why, ERR_FORMAT, "%s: line %u: the file ends before DATA PERIODS", l->file, l->number);
        if (strcasecmp(l->fields[0], "DATA PERIODS") == 0)
            break;
        if (l->number > 100)
            return err_say(why, ERR_FORMAT, "%s: no line DATA PERIODS among the first hundred", l->file);
    }
    if (!e)
        e = take_number(l, &per_hour, &n, NULL, why);
    if (!e && (n != floor(n) || fmod(60.0, n) != 0.0))
        e = err_say(why, ERR_RANGE, "%s: line %u: %g records per hour do not divide an hour into whole minutes",
                    l->file, l->number, n);
    out->interval = 1.0 / n;
    return e;
}

/* ---- Records ---- */

static enum err take_record(const struct line *l, struct epw_record *r, size_t *mended, struct reason *why)
{
    static const int days[12] = { 31, 29, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31 };
    double month = 1.0, day = 1.0, hour = 1.0;
    enum err e = take_number(l, &month_field, &month, NULL, why);

    *r = (struct epw_record){ .line = l->number };
    if (!e)
        e = take_number(l, &day_field, &day, NULL, why);
    if (!e && day > days[(int)month - 1])
        e = err_say(why, ERR_RANGE, "%s: line %u: field 3: month %g has no day %g", l->file, l->number, month, day);
    if (!e)
        e = take_number(l, &hour_field, &hour, NULL, why);
    if (!e)
        e = take_number(l, &dew_field, &r->dew_point, NULL, why);
    if (!e)
        e = take_number(l, &direct_field, &r->direct_normal, mended, why);
    if (!e)
        e = take_number(l, &diffuse_field, &r->diffuse, mended, why);
    if (!e)
        e = take_number(l, &direct_lux_field, &r->direct_normal_lux, mended, why);
    if (!e)
        e = take_number(l, &diffuse_lux_field, &r->diffuse_lux, mended, why);
    r->month = (int)month;
    r->day = (int)day;
    r->end = hour;
    return e;
}

/* Records of the same hour follow each other: the k-th of n ends k / n into it. */
static void spread_hour(struct epw *w)
{
    const int n = (int)lround(1.0 / w->interval);
    int k = 0;

    for (size_t i = 0; n > 1 && i < w->count; i++) {
        struct epw_record *r = &w->records[i];
        const bool same = i > 0 && r->month == r[-1].month && r->day == r[-1].day && r->end == ceil(r[-1].end);
        k = same && k < n ? k + 1 : 1;
        r->end += (double)k / n - 1.0;
    }
}

static enum err take_records(char **text, struct line *l, struct epw *out, struct reason *why)
{
    while (next_line(text, l)) {
        if (l->count == 1 && l->fields[0][strspn(l->fields[0], " \t")] == '\0')
            continue;
        if (!mem_reserve(&out->records, out->count, &out->capacity, sizeof(*out->records)))
            return err_say(why, ERR_NOMEM, "%s: out of memory", l->file);
        const enum err e = take_record(l, &out->records[out->count], &out->mended, why);
        if (e)
            return e;
        out->count++;
    }
    if (out->count == 0)
        return err_say(why, ERR_FORMAT, "%s: line %u: the file ends after the header, without weather", l->file,
                       l->number);
    if (out->count > 60 * 366 * 24)
        return err_say(why, ERR_RANGE, "%s: %zu records are more than one year", l->file, out->count);
    spread_hour(out);
    return ERR_OK;
}

/* A zero byte would end the text before the file does. */
static enum err refuse_zero_byte(const char *name, const char *text, size_t size, struct reason *why)
{
    const char *zero = memchr(text, '\0', size);
    unsigned line = 1, field = 1;

    for (const char *c = text; zero && c < zero; c++) {
        field = *c == '\n' ? 1 : field + (*c == ',');
        line += *c == '\n';
    }
    return zero ? err_say(why, ERR_FORMAT, "%s: line %u: field %u has a zero byte; expected text", name, line, field)
                : ERR_OK;
}

enum err epw_parse(const char *name, char *text, size_t size, struct epw *out, struct reason *why)
{
    struct line line = { .file = name };

    *out = (struct epw){ .count = 0 };
    enum err e = refuse_zero_byte(name, text, size, why);
    if (e)
        return e;
    if (size >= 3 && memcmp(text, "\xef\xbb\xbf", 3) == 0) /* of UTF-8 */
        text += 3;
    e = take_header(&text, &line, out, why);
    if (!e)
        e = take_records(&text, &line, out, why);
    if (e)
        epw_finish(out);
    return e;
}

static enum err read_text(const char *path, char **text, size_t *size, struct reason *why)
{
    FILE *f = fopen(path, "rb");
    enum err e = ERR_OK;

    *text = f ? mem_alloc_raw(FILE_MAX + 2, 1) : NULL;
    if (!f)
        return err_say(why, ERR_IO, "%s: %s", path, strerror(errno));
    if (!*text) {
        e = err_say(why, ERR_NOMEM, "%s: out of memory", path);
    } else {
        *size = fread(*text, 1, FILE_MAX + 1, f);
        (*text)[*size] = '\0';
        if (ferror(f))
            e = err_say(why, ERR_IO, "%s: %s", path, strerror(errno));
        else if (*size > FILE_MAX)
            e = err_say(why, ERR_RANGE, "%s: larger than 64 MB: this is not a weather file", path);
    }
    fclose(f);
    return e;
}

enum err epw_read(const char *path, struct epw *out, struct reason *why)
{
    char *text = NULL;
    size_t size = 0;
    enum err e = read_text(path, &text, &size, why);

    *out = (struct epw){ .count = 0 };
    if (!e)
        e = epw_parse(path, text, size, out, why);
    mem_free(text);
    return e;
}

void epw_finish(struct epw *w)
{
    mem_free(w->records);
    *w = (struct epw){ .count = 0 };
}
