#include "sky/daylight/reinhart.h"

#include "base/mem.h"
#include "base/vec.h"

#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SPREAD 4      /* patches that gendaymtx spreads a sun over */
#define EPSILON 1.002 /* of its weights */
#define ROUNDED 0.98  /* three digits of an ascii matrix are within 0.5 % */
#define HOURS 8760    /* of a year */
#define DEGREE (PI / 180.0)

/* ---- Reading ---- */

struct suns_file {
    const char *path;
    FILE *f;
    unsigned long line;
    char word[256];
    struct reason *why;
};

/* The next word, in s->word; # begins a comment. False at the end of the file. */
static bool next_word(struct suns_file *s)
{
    size_t n = 0;
    int c = getc(s->f);

    while (c != EOF && (isspace(c) || c == '#')) {
        while (c == '#' && (c = getc(s->f)) != EOF && c != '\n')
            c = '#';
        s->line += c == '\n';
        c = getc(s->f);
    }
    for (; c != EOF && !isspace(c); c = getc(s->f))
        if (n + 1 < sizeof(s->word))
            s->word[n++] = (char)c;
    s->word[n] = '\0';
    (void)ungetc(c, s->f);
    return n > 0;
}

static enum err say(const struct suns_file *s, const char *what)
{
    return err_say(s->why, ERR_FORMAT, "%s: line %lu: '%.40s' where %s is expected, as gendaymtx -D writes it", s->path,
                   s->line, s->word, what);
}

/* The arguments of a primitive: no words, no whole numbers, and `count` real ones. */
static enum err take_numbers(struct suns_file *s, int count, double *out)
{
    for (int k = -3; k < count; k++) {
        const double want = k == -1 ? count : 0.0;
        char *end = s->word;
        const double v = next_word(s) ? strtod(s->word, &end) : 0.0;
        if (end == s->word || *end || !isfinite(v) || (k < 0 && v != want))
            return say(s, k < 0 ? "0 0 and the number of numbers" : "a number");
        if (k >= 0)
            out[k] = v;
    }
    return ERR_OK;
}

/* `modifier type name`. */
static enum err take_head(struct suns_file *s, const char *type, char name[256])
{
    if (!next_word(s) || strcmp(s->word, type) != 0)
        return say(s, type);
    if (!next_word(s))
        return say(s, "a name");
    memcpy(name, s->word, 256);
    return ERR_OK;
}

static enum err take_sun(struct suns_file *s, struct matrix_sun *out)
{
    char light[256], source[256];
    double rgb[3], at[4];
    unsigned long minute;
    int used = 0;
    enum err e = take_head(s, "light", light); /* `void` was its first word */

    if (!e)
        e = take_numbers(s, 3, rgb);
    if (!e && (!next_word(s) || strcmp(s->word, light) != 0))
        e = say(s, light);
    if (!e)
        e = take_head(s, "source", source);
    if (!e)
        e = take_numbers(s, 4, at);
    if (e)
        return e;
    const double length = sqrt(at[0] * at[0] + at[1] * at[1] + at[2] * at[2]), radius = 0.5 * at[3] * DEGREE;
    if (!(length > 0.0 && at[3] > 0.0 && at[3] < 90.0 && rgb[0] >= 0.0 && rgb[1] >= 0.0 && rgb[2] >= 0.0))
        return err_say(s->why, ERR_FORMAT, "%s: line %lu: sun '%.40s' has no direction, size or light", s->path,
                       s->line, light);
    *out = (struct matrix_sun){ .normal = (rgb[0] + rgb[1] + rgb[2]) / 3.0 * PI * radius * radius,
                                .sun = { -at[0] / length, at[2] / length, at[1] / length },
                                .minute = -1.0 };
    if (sscanf(light, "solar%lu%n", &minute, &used) == 1 && !light[used] && (double)minute < 366.0 * 1440.0)
        out->minute = (double)minute;
    return ERR_OK;
}

static enum err take_all(struct suns_file *s, struct matrix_sun **out, size_t *count)
{
    size_t capacity = 0;
    enum err e = ERR_OK;

    for (*count = 0; !e && next_word(s); ++*count) {
        if (!mem_reserve(out, *count, &capacity, sizeof(**out)))
            return err_say(s->why, ERR_NOMEM, "%s: out of memory", s->path);
        e = strcmp(s->word, "void") == 0 ? take_sun(s, &(*out)[*count]) : say(s, "void");
    }
    return e;
}

/* The time step of each sun. */
static enum err assign(const char *path, const struct sky_matrix *m, const struct matrix_sun *from, size_t count,
                       struct matrix_sun *suns, struct reason *why)
{
    const double interval = 60.0 * HOURS / (double)m->steps;
    size_t lit = 0;

    for (size_t i = 0; i < m->steps; i++)
        lit += sky_matrix_is_lit(m, i);
    if (count != m->steps && count != lit && m->steps % HOURS != 0)
        return err_say(why, ERR_FORMAT,
                       "%s: has %zu suns, and the matrix %zu time steps, %zu of them lit: write both by gendaymtx -u",
                       path, count, m->steps, lit);
    for (size_t i = 0, k = 0; i < m->steps && (count == m->steps || count == lit); i++)
        if (count == m->steps || sky_matrix_is_lit(m, i))
            suns[i] = from[k++];
    for (size_t k = 0; k < count && count != m->steps && count != lit; k++) {
        const double at = floor(from[k].minute / interval);
        if (!(at >= 0.0 && at < (double)m->steps))
            return err_say(why, ERR_FORMAT, "%s: sun %zu has no minute of the year in its name, as in solar114150",
                           path, k + 1);
        suns[(size_t)at] = from[k];
    }
    return ERR_OK;
}

enum err matrix_suns_read(const char *path, const struct sky_matrix *m, struct matrix_sun *suns, struct reason *why)
{
    struct suns_file s = { .path = path, .f = fopen(path, "r"), .line = 1, .why = why };
    struct matrix_sun *all = NULL;
    size_t count = 0;

    if (!s.f)
        return err_say(why, ERR_IO, "%s: %s", path, strerror(errno));
    for (size_t i = 0; i < m->steps; i++)
        suns[i] = (struct matrix_sun){ .minute = -1.0 };
    enum err e = take_all(&s, &all, &count);
    fclose(s.f);
    if (!e)
        e = assign(path, m, all, count, suns, why);
    mem_free(all);
    return e;
}

/* ---- In the patches ---- */

struct place { /* of a patch */
    double middle[3], solid_angle;
};

struct share {
    size_t patch;
    double near, radiance; /* cosine to the sun; what the sun adds */
};

static struct place *places_of(const struct sky_matrix *m)
{
    struct place *out = mem_alloc(m->patches, sizeof(*out));

    for (size_t p = 0; out && p < m->patches; p++) {
        const struct reinhart_patch at = reinhart_patch(m->mf, (uint32_t)p);
        out[p] = (struct place){ { -sin(at.azimuth) * cos(at.altitude), sin(at.altitude),
                                   cos(at.azimuth) * cos(at.altitude) },
                                 at.solid_angle };
    }
    return out;
}

/* As gendaymtx spreads a sun: over the nearest patches, by 1 / (1.002 - cosine). */
static void spread(const struct place *place, size_t patches, const struct matrix_sun *sun, struct share out[SPREAD])
{
    double sum = 0.0;

    for (int k = 0; k < SPREAD; k++)
        out[k] = (struct share){ .near = -1.0 };
    for (size_t p = 1; p < patches; p++) {
        const double *w = place[p].middle, near = w[0] * sun->sun[0] + w[1] * sun->sun[1] + w[2] * sun->sun[2];
        int k = SPREAD;
        for (; k > 0 && near > out[k - 1].near; k--)
            if (k < SPREAD)
                out[k] = out[k - 1];
        if (k < SPREAD)
            out[k] = (struct share){ p, near, 0.0 };
    }
    for (int k = 0; k < SPREAD; k++)
        sum += 1.0 / (EPSILON - out[k].near);
    for (int k = 0; k < SPREAD; k++)
        out[k].radiance = sun->normal / (EPSILON - out[k].near) / sum / place[out[k].patch].solid_angle;
}

/* Whether a time step holds its sun; take: takes it out. */
static bool step_holds(struct sky_matrix *m, size_t step, const struct share share[SPREAD], bool take)
{
    for (int k = 0; k < SPREAD; k++)
        for (int c = 0; c < 3; c++) {
            float *v = &m->radiance[step * m->patches + share[k].patch][c];
            if (!take && (double)*v < ROUNDED * share[k].radiance)
                return false;
            if (take)
                *v = (float)fmax(0.0, (double)*v - share[k].radiance);
        }
    return true;
}

enum err matrix_suns_take_out(struct sky_matrix *m, const struct matrix_sun *suns, bool *taken)
{
    struct place *place = places_of(m);
    struct share share[SPREAD];

    *taken = true;
    for (int pass = 0; place && pass < 2 && *taken; pass++)
        for (size_t i = 0; i < m->steps && *taken; i++) {
            if (!(suns[i].normal > 0.0))
                continue;
            spread(place, m->patches, &suns[i], share);
            *taken = step_holds(m, i, share, pass == 1);
        }
    mem_free(place);
    return place ? ERR_OK : ERR_NOMEM;
}
