#include "sky/daylight/reinhart.h"

#include "base/mem.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define VALUES_MAX ((uint64_t)1 << 29) /* 2 GB as floats */

enum matrix_format {
    MATRIX_NONE,
    MATRIX_ASCII,
    MATRIX_FLOAT,
    MATRIX_DOUBLE,
};

struct matrix_head {
    unsigned long rows, columns, components;
    enum matrix_format format;
};

static enum err take_line(const char *path, const char *line, struct matrix_head *h, struct reason *why)
{
    static const char *const formats[] = { "", "ascii", "float", "double" };
    char format[32] = "";
    unsigned big = 0;

    sscanf(line, "NROWS=%lu", &h->rows);
    sscanf(line, "NCOLS=%lu", &h->columns);
    sscanf(line, "NCOMP=%lu", &h->components);
    if (sscanf(line, "BigEndian=%u", &big) == 1 && big)
        return err_say(why, ERR_UNSUPPORTED, "%s: is big-endian", path);
    if (sscanf(line, "FORMAT=%31s", format) != 1)
        return ERR_OK;
    for (int k = MATRIX_ASCII; k <= MATRIX_DOUBLE; k++)
        if (strcmp(format, formats[k]) == 0)
            h->format = (enum matrix_format)k;
    return h->format ? ERR_OK
                     : err_say(why, ERR_FORMAT, "%s: FORMAT=%s: expected ascii, float or double", path, format);
}

static enum err take_head(const char *path, FILE *f, size_t rows, struct matrix_head *h, struct reason *why)
{
    char line[1024];
    enum err e = ERR_OK;
    bool first = true;

    *h = (struct matrix_head){ .rows = rows, .components = 1 }; /* where a header has no NROWS and NCOMP */
    while (!e && fgets(line, sizeof(line), f) && line[0] != '\n' && line[0] != '\r') {
        if (first && strncmp(line, "#?RADIANCE", 10) != 0)
            return err_say(why, ERR_FORMAT,
                           "%s: line 1: expected #?RADIANCE, as Radiance's programs write it without -h", path);
        first = false;
        e = take_line(path, line, h, why);
    }
    if (!e && !h->format)
        e = err_say(why, ERR_FORMAT, "%s: its header has no FORMAT", path);
    if (!e && (h->rows < 1 || h->columns < 1 || h->components != 3))
        e = err_say(why, ERR_FORMAT,
                    "%s: its header has NROWS=%lu, NCOLS=%lu, NCOMP=%lu; expected at least 1, 1 and exactly 3", path,
                    h->rows, h->columns, h->components);
    if (!e && h->columns > VALUES_MAX / 3 / h->rows)
        e = err_say(why, ERR_RANGE, "%s: %lu x %lu values are above 2 GB", path, h->rows, h->columns);
    return e;
}

static bool take_value(FILE *f, enum matrix_format format, float *out)
{
    double d = 0.0;

    switch (format) {
    case MATRIX_ASCII: return fscanf(f, "%f", out) == 1;
    case MATRIX_FLOAT: return fread(out, sizeof(*out), 1, f) == 1;
    default:
        if (fread(&d, sizeof(d), 1, f) != 1)
            return false;
        *out = (float)d;
        return true;
    }
}

static enum err take_values(const char *path, FILE *f, const struct matrix_head *h, struct radiance_matrix *m,
                            struct reason *why)
{
    m->rows = h->rows;
    m->columns = h->columns;
    m->value = mem_alloc_raw(m->rows * m->columns, sizeof(*m->value));
    if (!m->value)
        return err_say(why, ERR_NOMEM, "%s: out of memory", path);
    for (size_t i = 0; i < m->rows; i++)
        for (size_t j = 0; j < m->columns; j++)
            for (int c = 0; c < 3; c++) {
                float *v = &m->value[j * m->rows + i][c];
                if (!take_value(f, h->format, v))
                    return err_say(why, ERR_FORMAT, "%s: ends, or has no number, at row %zu, column %zu, from 0", path,
                                   i, j);
                if (!(*v >= 0.0f && *v < 1e9f))
                    return err_say(why, ERR_FORMAT, "%s: row %zu, column %zu, from 0: %g is not a radiance", path, i, j,
                                   (double)*v);
            }
    float more;
    return take_value(f, h->format, &more)
               ? err_say(why, ERR_FORMAT, "%s: goes on after %zu x %zu values", path, m->rows, m->columns)
               : ERR_OK;
}

enum err radiance_matrix_read(const char *path, size_t rows, struct radiance_matrix *out, struct reason *why)
{
    struct matrix_head head;
    FILE *f = fopen(path, "rb");

    *out = (struct radiance_matrix){ .rows = 0 };
    if (!f)
        return err_say(why, ERR_IO, "%s: %s", path, strerror(errno));
    enum err e = take_head(path, f, rows, &head, why);
    if (!e)
        e = take_values(path, f, &head, out, why);
    fclose(f);
    if (e) {
        mem_free(out->value);
        *out = (struct radiance_matrix){ .rows = 0 };
    }
    return e;
}

enum err sky_matrix_read(const char *path, struct sky_matrix *out, struct reason *why)
{
    struct radiance_matrix m;
    enum err e = radiance_matrix_read(path, 0, &m, why);

    *out = (struct sky_matrix){ .mf = reinhart_subdivision(m.rows) };
    if (!e && !out->mf)
        e = err_say(why, ERR_FORMAT, "%s: has %zu rows; a sky has 146, 578 or 2306 patches (gendaymtx -m 1, 2 or 4)",
                    path, m.rows);
    if (e) {
        mem_free(m.value);
        return e;
    }
    out->patches = m.rows;
    out->steps = m.columns;
    out->radiance = m.value;
    return ERR_OK;
}

void sky_matrix_finish(struct sky_matrix *m)
{
    mem_free(m->radiance);
    *m = (struct sky_matrix){ .mf = 0 };
}

bool sky_matrix_is_lit(const struct sky_matrix *m, size_t step)
{
    for (size_t p = 0; p < m->patches; p++)
        for (int c = 0; c < 3; c++)
            if (m->radiance[step * m->patches + p][c] > 0.0f)
                return true;
    return false;
}
