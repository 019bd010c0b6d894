/* OBJ and MTL files as exporters write them, brought into the form that Assimp reads without loss. It takes a byte
 * order mark, indentation, a comment behind a statement or a coordinate such as .5 for something else, ignores
 * smoothing groups, keeps coordinates as floats, and takes other statements for points and lines. */
#include "import/parts/obj_text.h"

#include "base/log.h"
#include "base/mem.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#define FAR 4096.0       /* of a coordinate of the first vertex, from which on all are counted from that vertex */
#define CORNERS_MAX 1000 /* as in model.c, which refuses faces with more */

/* ---- Writing ---- */

struct text {
    struct bytes out;
    size_t room;
    bool failed; /* out of memory */
};

static void put(struct text *t, const char *bytes, size_t size)
{
    if (!t->failed && t->out.size + size > t->room) {
        const size_t room = 2 * t->room > t->out.size + size ? 2 * t->room : t->out.size + size + 4096;
        uint8_t *grown = mem_grow(t->out.at, t->out.size, room, 1);
        t->failed = !grown;
        if (grown) {
            t->out.at = grown;
            t->room = room;
        }
    }
    if (t->failed)
        return;
    memcpy(t->out.at + t->out.size, bytes, size);
    t->out.size += size;
}

static void put_format(struct text *t, const char *format, ...) PRINTF_LIKE(2, 3);

static void put_format(struct text *t, const char *format, ...)
{
    char text[128];
    va_list args;

    va_start(args, format);
    const int n = vsnprintf(text, sizeof(text), format, args);
    va_end(args);
    put(t, text, (size_t)n < sizeof(text) ? (size_t)n : sizeof(text) - 1);
}

/* ---- Reading: lines and words ---- */

struct word {
    const char *at;
    size_t size;
};

struct lines {
    const char *at, *end;
};

static bool is_blank(char c)
{
    return c == ' ' || c == '\t' || c == '\0' || c == '\v' || c == '\f';
}

/* UTF-16 as bytes; what is not ASCII becomes '?'. */
static void narrow(struct bytes *b)
{
    const bool little = b->size >= 2 && memcmp(b->at, "\xff\xfe", 2) == 0;
    size_t n = 0;

    if (!little && !(b->size >= 2 && memcmp(b->at, "\xfe\xff", 2) == 0))
        return;
    for (size_t i = 2; i + 1 < b->size; i += 2) {
        const uint8_t low = b->at[i + !little], high = b->at[i + little];
        b->at[n++] = high || low > 127 ? '?' : low;
    }
    b->size = n;
}

static struct lines lines_of(const struct bytes *b)
{
    struct lines l = { (const char *)b->at, (const char *)b->at + b->size };

    if (b->size >= 3 && memcmp(b->at, "\xef\xbb\xbf", 3) == 0)
        l.at += 3;
    return l;
}

/* The next line without blanks at its ends; false: there is none. One that a backslash continues has it still. */
static bool next_line(struct lines *l, struct word *out)
{
    if (l->at == l->end)
        return false;
    const char *p = l->at, *stop = p;
    for (; stop < l->end && *stop != '\n' && *stop != '\r'; stop++)
        if (*stop == '\\' && stop + 1 < l->end && (stop[1] == '\n' || stop[1] == '\r'))
            stop += stop[1] == '\r' && stop + 2 < l->end && stop[2] == '\n' ? 2 : 1;
    l->at = stop < l->end ? stop + 1 : stop;
    while (p < stop && is_blank(*p))
        p++;
    while (stop > p && is_blank(stop[-1]))
        stop--;
    *out = (struct word){ p, (size_t)(stop - p) };
    return true;
}

/* The next word of a line, from which it is taken; size 0: none is left. A comment ends the line. */
static struct word next_word(struct word *line)
{
    const char *p = line->at, *end = p + line->size;

    while (p < end &&
           (is_blank(*p) || *p == '\n' || *p == '\r' || (*p == '\\' && p + 1 < end && (p[1] == '\n' || p[1] == '\r'))))
        p++;
    const char *from = p;
    if (p < end && *p == '#')
        end = p;
    while (p < end && !is_blank(*p) && *p != '\n' && *p != '\r' &&
           !(*p == '\\' && p + 1 < end && (p[1] == '\n' || p[1] == '\r')))
        p++;
    *line = (struct word){ p, (size_t)(end - p) };
    return (struct word){ from, (size_t)(p - from) };
}

static bool is(const struct word *w, const char *text)
{
    return w->size == strlen(text) && strncasecmp(w->at, text, w->size) == 0;
}

/* A number, and whether the word is one. */
static bool number_of(const struct word *w, double *out)
{
    char text[64], *rest;

    if (w->size == 0 || w->size >= sizeof(text))
        return false;
    memcpy(text, w->at, w->size);
    text[w->size] = '\0';
    const double v = strtod(text, &rest);
    if (*rest != '\0' || !isfinite(v))
        return false;
    *out = v;
    return true;
}

/* A number to the letter, but for a sign + and a missing 0 before the point. */
static void put_number(struct text *t, const struct word *w)
{
    const char *p = w->at, *end = p + w->size;

    put(t, " ", 1);
    if (p < end && *p == '-')
        put(t, "-", 1);
    p += p < end && (*p == '-' || *p == '+');
    if (p < end && *p == '.')
        put(t, "0", 1);
    put(t, p, (size_t)(end - p));
}

/* ---- Smoothing groups: normals of vertices, each of one group ---- */

struct smooth {
    uint64_t key; /* vertex, from 0, and group */
    double normal[3];
};

struct obj {
    struct text text;
    double origin[3];
    double *positions; /* owned; of all vertices */
    size_t vertices, vertex_room;
    struct smooth *smooth; /* owned */
    size_t smooth_count, smooth_room;
    uint32_t *table;      /* owned; hashed by key: 1 + index into smooth; 0: free */
    size_t table_size;    /* a power of two */
    size_t normals;       /* of the file, so far */
    uint32_t group;       /* 0: off */
    size_t total;         /* vertices of the file */
    struct word wrong;    /* a corner that names no vertex; size 0: none so far */
    size_t curves, edges; /* free-form statements; lines and points */
    bool failed;
};

static size_t slot_of(const struct obj *o, uint64_t key)
{
    size_t at = (size_t)(key * UINT64_C(0x9e3779b97f4a7c15) >> 20) & (o->table_size - 1);

    while (o->table[at] && o->smooth[o->table[at] - 1].key != key)
        at = (at + 1) & (o->table_size - 1);
    return at;
}

static bool grow_table(struct obj *o)
{
    uint32_t *old = o->table;

    o->table_size = o->table_size ? 2 * o->table_size : 4096;
    o->table = mem_alloc(o->table_size, sizeof(*o->table));
    mem_free(old);
    for (size_t i = 0; o->table && i < o->smooth_count; i++)
        o->table[slot_of(o, o->smooth[i].key)] = (uint32_t)i + 1;
    return o->table != NULL;
}

/* NULL: out of memory. */
static struct smooth *smooth_at(struct obj *o, size_t vertex)
{
    const uint64_t key = (uint64_t)vertex << 32 | o->group;

    if (2 * (o->smooth_count + 1) > o->table_size && !grow_table(o))
        return NULL;
    const size_t slot = slot_of(o, key);
    if (!o->table[slot]) {
        if (!mem_reserve(&o->smooth, o->smooth_count, &o->smooth_room, sizeof(*o->smooth)))
            return NULL;
        o->smooth[o->smooth_count++] = (struct smooth){ .key = key };
        o->table[slot] = (uint32_t)o->smooth_count;
    }
    return &o->smooth[o->table[slot] - 1];
}

static void take_group(struct obj *o, struct word *line)
{
    const struct word w = next_word(line);
    double number = 1.0; /* "on" */

    (void)number_of(&w, &number);
    o->group = w.size == 0 || is(&w, "off") || !(number >= 1.0 && number < 4e9) ? 0 : (uint32_t)number;
}

/* The parts of a corner such as 1/2/3, 1//3 or 1/2; 0: not given. */
static void split_corner(const struct word *w, long out[3])
{
    const char *p = w->at, *end = p + w->size;

    for (int k = 0; k < 3; k++) {
        const char *slash = memchr(p, '/', (size_t)(end - p));
        const char *stop = slash && k < 2 ? slash : end;
        double v = 0.0;
        const struct word part = { p, (size_t)(stop - p) };
        out[k] = number_of(&part, &v) && fabs(v) < 2e9 && v == floor(v) ? (long)v : 0;
        p = stop < end ? stop + 1 : end;
    }
}

/* From 0; false: no such vertex so far. */
static bool vertex_of(const struct obj *o, long index, size_t *out)
{
    const size_t count = o->vertices / 3;

    *out = index > 0 ? (size_t)index - 1 : count - (size_t)-index;
    return index > 0 ? (size_t)index <= count : index < 0 && (size_t)-index <= count;
}

/* The face's vertices, if it has no normals of its own. 0: it has, or is no face. */
static size_t bare_corners(const struct obj *o, struct word line, size_t out[CORNERS_MAX])
{
    size_t count = 0;

    for (struct word w = next_word(&line); w.size > 0; w = next_word(&line)) {
        long index[3];
        split_corner(&w, index);
        if (index[2] != 0 || count == CORNERS_MAX || !vertex_of(o, index[0], &out[count++]))
            return 0;
    }
    return count >= 3 ? count : 0;
}

/* Adds the face's normal, as long as its area, to those of its vertices. */
static void smooth_face(struct obj *o, const struct word *line)
{
    size_t corners[CORNERS_MAX];
    double n[3] = { 0.0 };

    const size_t count = o->group ? bare_corners(o, *line, corners) : 0;
    const double *a = count ? o->positions + 3 * corners[0] : NULL;
    for (size_t i = 1; i + 1 < count; i++) {
        const double *b = o->positions + 3 * corners[i], *c = o->positions + 3 * corners[i + 1];
        for (int k = 0; k < 3; k++) {
            const int x = (k + 1) % 3, y = (k + 2) % 3;
            n[k] += (b[x] - a[x]) * (c[y] - a[y]) - (b[y] - a[y]) * (c[x] - a[x]);
        }
    }
    for (size_t i = 0; i < count; i++) {
        struct smooth *s = smooth_at(o, corners[i]);
        for (int k = 0; s && k < 3; k++)
            s->normal[k] += n[k];
        o->failed |= !s;
    }
}

static void take_vertex(struct obj *o, struct word *line)
{
    for (int k = 0; k < 3; k++) {
        const struct word w = next_word(line);
        double v = 0.0;
        (void)number_of(&w, &v);
        if (!mem_reserve(&o->positions, o->vertices, &o->vertex_room, sizeof(*o->positions))) {
            o->failed = true;
            return;
        }
        o->positions[o->vertices++] = v;
    }
}

/* The first pass: the origin, the vertices and the normals of the groups. */
static void look(struct obj *o, const struct bytes *in, bool smooth)
{
    struct lines lines = lines_of(in);
    struct word line;

    while (!o->failed && next_line(&lines, &line)) {
        const struct word key = next_word(&line);
        if (smooth && is(&key, "s"))
            take_group(o, &line);
        else if (is(&key, "f") || is(&key, "fo"))
            smooth_face(o, &line);
        else if (is(&key, "v"))
            take_vertex(o, &line);
    }
    for (size_t k = 0; k < 3 && k < o->vertices; k++)
        o->origin[k] = fabs(o->positions[k]) >= FAR ? round(o->positions[k]) : 0.0;
}

/* ---- The second pass ---- */

static void put_vertex(struct obj *o, struct word *line, bool is_position)
{
    struct word w = next_word(line);
    double v;

    for (int k = 0; w.size > 0; k++, w = next_word(line))
        if (is_position && k < 3 && o->origin[k] != 0.0 && number_of(&w, &v))
            put_format(&o->text, " %.9g", v - o->origin[k]);
        else
            put_number(&o->text, &w);
}

/* A corner whose normal has index n in the file as it is written; 0: none. */
static void put_corner(struct obj *o, const long index[3], size_t n)
{
    put_format(&o->text, " %ld", index[0]);
    if (index[1] != 0)
        put_format(&o->text, "/%ld", index[1]);
    else if (n > 0)
        put(&o->text, "/", 1);
    if (n > 0)
        put_format(&o->text, "/%zu", n);
}

/* The normals of groups precede those of the file. */
static void put_face(struct obj *o, struct word *line)
{
    size_t corners[CORNERS_MAX];
    const bool bare = o->group && o->smooth_count > 0 && bare_corners(o, *line, corners) > 0;
    struct word w = next_word(line);
    long index[3];

    for (size_t k = 0; w.size > 0; k++, w = next_word(line)) {
        split_corner(&w, index);
        const size_t most = index[0] > 0 ? o->total : o->vertices / 3;
        if (o->wrong.size == 0 && (index[0] == 0 || (size_t)labs(index[0]) > most))
            o->wrong = w;
        if (bare)
            put_corner(o, index, (size_t)(smooth_at(o, corners[k]) - o->smooth) + 1);
        else if (index[2] > 0)
            put_corner(o, index, (size_t)index[2] + o->smooth_count);
        else if (index[2] < 0 && (size_t)-index[2] <= o->normals)
            put_corner(o, index, o->normals + 1 - (size_t)-index[2] + o->smooth_count);
        else
            put_corner(o, index, 0);
    }
}

static void put_smooth(struct obj *o)
{
    for (size_t i = 0; i < o->smooth_count; i++) {
        const double *n = o->smooth[i].normal, length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        const double scale = length > 0.0 ? 1.0 / length : 0.0;
        put_format(&o->text, "vn %.9g %.9g %.9g\n", n[0] * scale, n[1] * scale, n[2] * scale);
    }
}

/* Names of libraries, which may hold blanks: each ends in .mtl or the line; quotes are no part of them. */
static void put_libraries(struct text *t, const struct word *line)
{
    const char *p = line->at, *end = p + line->size;

    while (p < end && *p != '#') {
        const char *stop = p;
        while (stop < end && *stop != '"' &&
               !(is_blank(*stop) && (stop == p || (stop - p > 4 && strncasecmp(stop - 4, ".mtl", 4) == 0))))
            stop++;
        if (stop > p) {
            put(t, "mtllib ", 7);
            put(t, p, (size_t)(stop - p));
            put(t, "\n", 1);
        }
        p = stop + (stop < end);
    }
}

static void put_line(struct obj *o, struct word line)
{
    const struct word key = next_word(&line);

    if (is(&key, "f") || is(&key, "fo")) { /* fo: as very old files have it */
        put(&o->text, "f", 1);
        put_face(o, &line);
    } else if (is(&key, "v") || is(&key, "vt") || is(&key, "vn")) {
        put(&o->text, is(&key, "vt") ? "vt" : "vn", key.size); /* of "vn", a position has the first letter */
        put_vertex(o, &line, key.size == 1);
        o->vertices += key.size == 1 ? 3 : 0;
        o->normals += is(&key, "vn");
    } else if (is(&key, "g") || is(&key, "o") || is(&key, "usemtl")) {
        put(&o->text, is(&key, "g") ? "g " : is(&key, "o") ? "o " : "usemtl ", key.size + 1);
        put(&o->text, line.at, line.size);
    } else if (is(&key, "s")) {
        take_group(o, &line);
    } else if (is(&key, "mtllib")) {
        put_libraries(&o->text, &line);
    } else {
        o->curves += is(&key, "curv") || is(&key, "curv2") || is(&key, "surf");
        o->edges += is(&key, "l") || is(&key, "p");
    }
    put(&o->text, "\n", 1);
}

static enum err refuse_corner(const struct obj *o, const struct bytes *file, const char *name, struct reason *why)
{
    const int size = (int)(o->wrong.size < 40 ? o->wrong.size : 40);
    size_t number = 1;

    for (const char *p = (const char *)file->at; p < o->wrong.at; p++)
        number += *p == '\n' || (*p == '\r' && p[1] != '\n');
    return err_say(why, ERR_FORMAT,
                   "%s: line %zu: '%.*s' is no corner of a face: expected the number of a vertex, 1 to %zu, or "
                   "negative numbers of those before",
                   name, number, size, o->wrong.at, o->total);
}

enum err obj_text(struct bytes *file, const char *name, bool smooth, double origin[3], struct reason *why)
{
    struct obj o = { .failed = false };
    struct word line;

    narrow(file);
    struct lines lines = lines_of(file);
    look(&o, file, smooth);
    o.total = o.vertices / 3;
    o.group = 0;
    o.vertices = 0;
    put_smooth(&o);
    while (!o.failed && !o.text.failed && next_line(&lines, &line))
        put_line(&o, line);
    mem_free(o.positions);
    mem_free(o.smooth);
    mem_free(o.table);
    if (o.failed || o.text.failed || o.wrong.size > 0) {
        mem_free(o.text.out.at);
        return o.failed || o.text.failed ? err_say(why, ERR_NOMEM, "%s: out of memory", name)
                                         : refuse_corner(&o, file, name, why);
    }
    if (o.curves + o.edges > 0)
        log_warning(
            "%s: %zu free-form curves or surfaces and %zu lines or points are left out: export them as polygons", name,
            o.curves, o.edges);
    bytes_finish(file);
    *file = o.text.out;
    memcpy(origin, o.origin, sizeof(o.origin));
    return ERR_OK;
}

/* ---- MTL ---- */

static bool is_option(const struct word *w)
{
    static const char *const names[] = { "-blendu", "-blendv", "-boost", "-mm",      "-o",    "-s", "-t",
                                         "-texres", "-clamp",  "-bm",    "-imfchan", "-type", "-cc" };

    for (size_t i = 0; i < sizeof(names) / sizeof(names[0]); i++)
        if (is(w, names[i]))
            return true;
    return false;
}

/* Skips options and what belongs to them, at the beginning of the line. */
static void skip_options(struct word *line)
{
    for (;;) {
        struct word rest = *line, w = next_word(&rest);
        double v;
        if (!is_option(&w))
            return;
        const bool takes_word = is(&w, "-imfchan") || is(&w, "-type") || is(&w, "-cc") || is(&w, "-clamp") ||
                                is(&w, "-blendu") || is(&w, "-blendv");
        *line = rest;
        w = next_word(&rest);
        for (int k = 0; k < 3 && w.size > 0 && (number_of(&w, &v) || (k == 0 && takes_word)); k++) {
            *line = rest;
            w = next_word(&rest);
        }
    }
}

/* Options stand before the file's name, which may hold blanks; quotes and a comment are no part of it. */
static void put_map(struct text *t, struct word line)
{
    struct word name = line;

    while (name.size > 0 && is_blank(*name.at))
        name = (struct word){ name.at + 1, name.size - 1 };
    const char *end = line.at + line.size, *options = name.at;
    skip_options(&name);
    while (name.size > 0 && is_blank(*name.at))
        name = (struct word){ name.at + 1, name.size - 1 };
    const char *stop = end;
    for (const char *p = name.at; p < stop; p++) {
        struct word rest = { p + 1, (size_t)(end - p - 1) }, w = next_word(&rest);
        if (is_blank(*p) && ((p + 1 < end && p[1] == '#' && !memchr(p, '.', (size_t)(end - p))) || is_option(&w)))
            stop = p;
    }
    if (stop < end && stop[1] != '#')
        put(t, stop, (size_t)(end - stop));
    put(t, " ", 1);
    put(t, options, (size_t)(name.at - options));
    while (stop > name.at && is_blank(stop[-1]))
        stop--;
    const bool quoted = stop - name.at >= 2 && (*name.at == '"' || *name.at == '\'') && stop[-1] == *name.at;
    put(t, " ", 1);
    put(t, name.at + quoted, (size_t)(stop - name.at) - 2 * quoted);
}

static bool is_map(const struct word *key)
{
    return (key->size > 4 && strncasecmp(key->at, "map_", 4) == 0) || is(key, "bump") || is(key, "disp") ||
           is(key, "decal") || is(key, "refl") || is(key, "norm");
}

/* One number of a colour stands for all three. */
static void put_values(struct text *t, bool colour, struct word line)
{
    struct word first = next_word(&line), w = first;
    int count = 0;
    double v;

    for (; w.size > 0; w = next_word(&line), count++)
        put_number(t, &w);
    for (; colour && count >= 1 && count < 3 && number_of(&first, &v); count++)
        put_number(t, &first);
}

enum err mtl_text(struct bytes *file, char **names)
{
    narrow(file);
    struct lines lines = lines_of(file);
    struct text out = { .failed = false }, defined = { .failed = false };
    struct word line;

    while (next_line(&lines, &line)) {
        const struct word whole = line, key = next_word(&line);
        const bool colour = is(&key, "Ka") || is(&key, "Kd") || is(&key, "Ks") || is(&key, "Ke") || is(&key, "Tf");
        const bool number = colour || is(&key, "Ns") || is(&key, "Ni") || is(&key, "d") || is(&key, "Tr");
        if (key.size == 0)
            continue;
        put(&out, number || is_map(&key) ? key.at : whole.at, number || is_map(&key) ? key.size : whole.size);
        if (is_map(&key))
            put_map(&out, line);
        else if (number)
            put_values(&out, colour, line);
        put(&out, "\n", 1);
        if (is(&key, "newmtl")) {
            while (line.size > 0 && is_blank(*line.at))
                line = (struct word){ line.at + 1, line.size - 1 };
            put(&defined, line.at, line.size);
            put(&defined, "\n", 1);
        }
    }
    put(&defined, *names ? *names : "", *names ? strlen(*names) + 1 : 1);
    if (out.failed || defined.failed) {
        mem_free(out.out.at);
        mem_free(defined.out.at);
        return ERR_NOMEM;
    }
    mem_free(*names);
    *names = (char *)defined.out.at;
    bytes_finish(file);
    *file = out.out;
    return ERR_OK;
}
