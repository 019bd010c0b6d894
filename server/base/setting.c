/* server/base/setting.c */
#include "base/setting.h"

#include <assert.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

/* ---- One row ---- */

bool setting_ends(const struct setting *row)
{
    return !row->name && !row->key;
}

static const void *field(const struct setting *row, const void *values)
{
    return (const char *)values + row->offset;
}

bool setting_equal(const struct setting *row, const void *a, const void *b)
{
    return memcmp(field(row, a), field(row, b), row->size) == 0;
}

void setting_copy(const struct setting *row, void *to, const void *from)
{
    memcpy((char *)to + row->offset, field(row, from), row->size);
}

void setting_store_whole(const struct setting *row, void *values, uint64_t v)
{
    void *at = (char *)values + row->offset;

    switch (row->size) {
    case 0: break;
    case 1: memcpy(at, &(uint8_t){ (uint8_t)v }, 1); break;
    case 2: memcpy(at, &(uint16_t){ (uint16_t)v }, 2); break;
    case 4: memcpy(at, &(uint32_t){ (uint32_t)v }, 4); break;
    default: assert(row->size == 8); memcpy(at, &v, 8);
    }
}

void setting_store_real(const struct setting *row, void *values, double v)
{
    assert(row->size == sizeof(v));
    memcpy((char *)values + row->offset, &v, sizeof(v));
}

int64_t setting_whole(const struct setting *row, const void *values)
{
    const void *at = field(row, values);
    uint8_t one;
    uint16_t two;
    uint32_t four;
    int64_t eight;

    switch (row->size) {
    case 1: memcpy(&one, at, 1); return one;
    case 2: memcpy(&two, at, 2); return two;
    case 4: memcpy(&four, at, 4); return four;
    default:
        assert(row->size == 8);
        memcpy(&eight, at, 8);
        return eight;
    }
}

double setting_real(const struct setting *row, const void *values)
{
    double v;

    assert(row->size == sizeof(v));
    memcpy(&v, field(row, values), sizeof(v));
    return v;
}

bool setting_is_null(const struct setting *row, const void *values)
{
    if (!row->has_null)
        return false;
    const double v = row->type == SETTING_REAL ? setting_real(row, values) : (double)setting_whole(row, values);
    return v == row->null || (isnan(v) && isnan(row->null));
}

/* ---- Flags ---- */

/* Adds to the command's texts; the text is cut where there is no room. */
static const char *keep(struct command *c, size_t *used, const char *format, ...) PRINTF_LIKE(3, 4);
static const char *keep(struct command *c, size_t *used, const char *format, ...)
{
    char *at = c->text + *used;
    va_list args;

    va_start(args, format);
    const int length = vsnprintf(at, sizeof(c->text) - *used, format, args);
    va_end(args);
    assert(length >= 0 && (size_t)length < sizeof(c->text) - *used);
    *used += (size_t)length + 1;
    return at;
}

static void add_row(struct command *c, size_t *count, size_t *used, const struct setting *s)
{
    struct option_row *r = &c->rows[*count];
    char names[200];

    assert(*count < COMMAND_ROWS - 1);
    *r = (struct option_row){ s->name, s->unit, s->help, s->initial };
    if (s->type == SETTING_CHOICE) {
        choice_list(s->choices, c->program, names, sizeof(names));
        r->help = keep(c, used, "%s: %s", s->help, names);
    }
    c->initial[*count] = s->initial;
    c->setting[(*count)++] = s;
}

/* All rows of one section, whichever list they stand in. */
static void add_section(struct command *c, size_t *count, size_t *used, const char *section)
{
    c->setting[*count] = NULL;
    c->rows[(*count)++] = (struct option_row){ "", NULL, section, NULL };
    for (size_t l = 0; l < COMMAND_LISTS && c->lists[l].rows; l++)
        for (const struct setting *s = c->lists[l].rows; !setting_ends(s); s++)
            if (s->name && choice_has(s->programs, c->program) && strcmp(s->section, section) == 0)
                add_row(c, count, used, s);
}

void command_begin(struct command *c)
{
    size_t count = 0, used = 0;

    for (size_t l = 0; l < COMMAND_LISTS && c->lists[l].rows; l++)
        for (const struct setting *s = c->lists[l].rows; !setting_ends(s); s++) {
            bool known = !s->name || !choice_has(s->programs, c->program);
            for (size_t k = 0; k < count && !known; k++)
                known = !c->rows[k].name[0] && strcmp(c->rows[k].help, s->section) == 0;
            if (!known)
                add_section(c, &count, &used, s->section);
        }
    c->rows[count] = (struct option_row){ NULL, NULL, NULL, NULL };
    c->options.rows = c->rows;
}

static size_t index_of(const struct command *c, const char *name)
{
    size_t k = 0;

    while (c->rows[k].name && strcmp(c->rows[k].name, name) != 0)
        k++;
    assert(c->rows[k].name);
    return k;
}

void command_default(struct command *c, const char *name, const char *initial)
{
    const size_t k = index_of(c, name);
    c->rows[k].given = c->initial[k] = initial;
}

bool command_given(const struct command *c, const char *name)
{
    const size_t k = index_of(c, name);
    return c->rows[k].given != c->initial[k];
}

static bool print_choices(const struct command *c)
{
    for (size_t k = 0; c->rows[k].name; k++) {
        const struct setting *s = c->setting[k];
        if (!s || s->type != SETTING_CHOICE || !c->rows[k].given || strcmp(c->rows[k].given, "help") != 0)
            continue;
        printf("--%s %s, %s:\n", s->name, s->unit, s->help);
        for (const struct setting_choice *x = s->choices; x->name; x++)
            if (choice_has(x->programs, c->program))
                printf("  %-16s %s\n", x->name, x->about ? x->about : "");
        return true;
    }
    return false;
}

enum err command_parse(struct command *c, int argc, char **argv, bool *done, struct reason *why)
{
    const enum err e = options_parse(&c->options, argc, argv, done, why);

    if (!e && !*done)
        *done = print_choices(c);
    return e;
}

static enum err read_whole(const struct setting *s, const struct options *o, void *values, struct reason *why)
{
    const uint64_t most = s->most >= 0x1p64 ? UINT64_MAX : (uint64_t)s->most;
    uint64_t v = 0;
    const enum err e = options_u64(o, s->name, (uint64_t)s->least, most, &v, why);

    if (e)
        return e;
    if (s->type == SETTING_POWER && (v & (v - 1)))
        return err_say(why, ERR_USAGE, "--%s '%s' is no power of two", s->name, options_get(o, s->name));
    setting_store_whole(s, values, s->scale > 0.0 ? v * (uint64_t)s->scale : v);
    return ERR_OK;
}

static enum err read_real(const struct setting *s, const struct options *o, void *values, struct reason *why)
{
    double v = 0.0;
    const bool off = s->off && strcmp(options_get(o, s->name), s->off) == 0;
    const enum err e = off ? ERR_OK : options_double(o, s->name, s->least, s->most, &v, why);

    if (!e)
        setting_store_real(s, values, s->scale > 0.0 ? v * s->scale : v);
    return e;
}

static enum err read_word(const struct setting *s, const char *given, unsigned program, void *values,
                          struct reason *why)
{
    char flag[40];
    int v = 0;

    snprintf(flag, sizeof(flag), "--%s", s->name);
    if (s->type == SETTING_CHOICE) {
        const enum err e = choice_parse(s->choices, program, flag, given, &v, why);
        if (!e)
            setting_store_whole(s, values, (uint64_t)(unsigned)v);
        return e;
    }
    if (strlen(given) >= s->size)
        return err_say(why, ERR_USAGE, "%s: longer than %u bytes", flag, s->size - 1);
    strcpy((char *)values + s->offset, given);
    return ERR_OK;
}

static enum err read_row(const struct command *c, const struct setting *s, void *values, struct reason *why)
{
    const struct options *o = &c->options;
    const char *given = options_get(o, s->name);
    void *at = (char *)values + s->offset;

    if (s->size == 0)
        return ERR_OK;
    if (s->type == SETTING_SWITCH || s->type == SETTING_SWITCH_OFF) {
        setting_store_whole(s, values, (given != NULL) == (s->type == SETTING_SWITCH));
        return ERR_OK;
    }
    if (!given)
        return ERR_OK;
    switch (s->type) {
    case SETTING_WHOLE:
    case SETTING_POWER: return read_whole(s, o, values, why);
    case SETTING_REAL: return read_real(s, o, values, why);
    case SETTING_CHOICE:
    case SETTING_NAME: return read_word(s, given, c->program, values, why);
    case SETTING_SIZE: return options_size(o, s->name, at, (uint32_t *)at + 1, why);
    case SETTING_FRAMES: {
        struct setting_frames *f = at;
        return options_range(o, s->name, &f->given, &f->first, &f->last, why);
    }
    default: memcpy(at, &given, sizeof(given)); return ERR_OK;
    }
}

enum err command_read(const struct command *c, struct reason *why)
{
    for (size_t l = 0; l < COMMAND_LISTS && c->lists[l].rows; l++)
        for (const struct setting *s = c->lists[l].rows; !setting_ends(s); s++)
            if (s->name && choice_has(s->programs, c->program)) {
                const enum err e = read_row(c, s, c->lists[l].values, why);
                if (e)
                    return e;
            }
    return ERR_OK;
}
