#include "daylight/sky_matrix.h"

#include "base/mem.h"
#include "daylight/reinhart.h"

#include <errno.h>
#include <math.h>
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

static enum err take_head(const char *path, FILE *f, struct matrix_head *h, struct sky_matrix *out, struct reason *why)
{
    char line[1024];
    enum err e = ERR_OK;
    bool first = true;

    *h = (struct matrix_head){ .components = 3 };
    while (!e && fgets(line, sizeof(line), f) && line[0] != '\n' && line[0] != '\r') {
        if (first && strncmp(line, "#?RADIANCE", 10) != 0)
            return err_say(why, ERR_FORMAT, "%s: line 1: expected #?RADIANCE, as gendaymtx without -h writes it", path);
        first = false;
        e = take_line(path, line, h, why);
    }
    for (uint32_t mf = 1; mf <= 4; mf *= 2)
        if (h->rows == reinhart_count(mf))
            out->mf = mf;
    if (!e && !h->format)
        e = err_say(why, ERR_FORMAT, "%s: its header has no FORMAT", path);
    if (!e && (!out->mf || h->components != 3))
        e = err_say(
            why, ERR_FORMAT,
            "%s: has %lu rows of %lu components; expected 146, 578 or 2306 patches (gendaymtx -m 1, 2 or 4) of 3", path,
            h->rows, h->components);
    if (!e && (h->columns < 1 || h->columns > VALUES_MAX / (3 * h->rows)))
        e = err_say(why, ERR_RANGE, "%s: %lu time steps: expected 1 to %lu", path, h->columns,
                    (unsigned long)(VALUES_MAX / (3 * h->rows)));
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

static enum err take_values(const char *path, FILE *f, const struct matrix_head *h, struct sky_matrix *m,
                            struct reason *why)
{
    m->patches = h->rows;
    m->steps = h->columns;
    m->radiance = mem_alloc_raw(m->steps * m->patches, sizeof(*m->radiance));
    if (!m->radiance)
        return err_say(why, ERR_NOMEM, "%s: out of memory", path);
    for (size_t p = 0; p < m->patches; p++)
        for (size_t s = 0; s < m->steps; s++)
            for (int c = 0; c < 3; c++) {
                float *v = &m->radiance[s * m->patches + p][c];
                if (!take_value(f, h->format, v))
                    return err_say(why, ERR_FORMAT, "%s: ends, or has no number, at patch %zu, time step %zu", path, p,
                                   s);
                if (!(*v >= 0.0f && *v < 1e9f))
                    return err_say(why, ERR_FORMAT, "%s: patch %zu, time step %zu: %g is no radiance", path, p, s,
                                   (double)*v);
            }
    return ERR_OK;
}

enum err sky_matrix_read(const char *path, struct sky_matrix *out, struct reason *why)
{
    struct matrix_head head;
    FILE *f = fopen(path, "rb");

    *out = (struct sky_matrix){ .mf = 0 };
    if (!f)
        return err_say(why, ERR_IO, "%s: %s", path, strerror(errno));
    enum err e = take_head(path, f, &head, out, why);
    if (!e)
        e = take_values(path, f, &head, out, why);
    fclose(f);
    if (e)
        sky_matrix_finish(out);
    return e;
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
