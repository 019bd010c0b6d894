#include "base/command.h"

#include "base/log.h"

#include <assert.h>
#include <ctype.h>
#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SIZE_MAX_SIDE 16384 /* the G-buffer's limit */

/* ---- The flags of a program ---- */

/* All rows of one section, in whichever list they are. */
static void add_section(struct command *c, const char *section)
{
    for (size_t l = 0; l < COMMAND_LISTS && c->lists[l].rows; l++)
        for (const struct setting *s = c->lists[l].rows; !setting_ends(s); s++)
            if (s->name && choice_has(s->programs, c->program) && strcmp(s->section, section) == 0) {
                assert(c->flag_count < COMMAND_FLAGS);
                c->flags[c->flag_count++] = (struct command_flag){
                    .row = s, .values = &c->lists[l].values, .initial = s->initial, .given = s->initial
                };
            }
}

void command_begin(struct command *c)
{
    c->flag_count = c->tune_bytes = 0;
    for (size_t l = 0; l < COMMAND_LISTS && c->lists[l].rows; l++)
        for (const struct setting *s = c->lists[l].rows; !setting_ends(s); s++) {
            bool known = !s->name || !choice_has(s->programs, c->program);
            for (size_t k = 0; k < c->flag_count && !known; k++)
                known = strcmp(c->flags[k].row->section, s->section) == 0;
            if (!known)
                add_section(c, s->section);
        }
}

#define KEY "tune "
#define NAME_MOST 40 /* more than the longest name */

/* The index of the flag of that name or, without one or with "tune " before it, of the key of --tune; flag_count: there
 * is none. */
static size_t find_index(const struct command *c, const char *name, size_t length)
{
    const bool key = length > sizeof(KEY) - 1 && strncmp(name, KEY, sizeof(KEY) - 1) == 0;
    size_t found = c->flag_count;

    name += key ? sizeof(KEY) - 1 : 0;
    length -= key ? sizeof(KEY) - 1 : 0;
    for (size_t k = 0; k < c->flag_count; k++) {
        const struct setting *row = c->flags[k].row;
        if (strlen(row->name) != length || strncmp(row->name, name, length) != 0)
            continue;
        if (key == (row->level == SETTING_TUNE))
            return k;
        found = key ? found : k;
    }
    return found;
}

static struct command_flag *find(struct command *c, const char *name, size_t length)
{
    const size_t k = find_index(c, name, length);

    return k < c->flag_count ? &c->flags[k] : NULL;
}

bool command_offers(const struct command *c, const struct setting *row)
{
    return row->also || !(row->needs & c->lacks);
}

const char *command_also(const struct command *c, const struct setting *row)
{
    return row->also && !(row->needs & c->lacks) ? row->also : "";
}

struct command_flag *command_flag(struct command *c, const char *name)
{
    return find(c, name, strlen(name));
}

static const struct command_flag *known(const struct command *c, const char *name)
{
    const size_t k = find_index(c, name, strlen(name));

    assert(k < c->flag_count);
    return &c->flags[k];
}

void command_default(struct command *c, const char *name, const char *initial)
{
    struct command_flag *f = command_flag(c, name);
    f->given = f->initial = initial;
}

const char *command_get(const struct command *c, const char *name)
{
    return known(c, name)->given;
}

bool command_given(const struct command *c, const char *name)
{
    const struct command_flag *f = known(c, name);
    return f->given != f->initial;
}

bool command_flag_equals(const struct command_flag *a, const struct command_flag *b)
{
    bool same = a->given == b->given || (a->given && b->given && strcmp(a->given, b->given) == 0);

    same = same && a->texts.count == b->texts.count;
    for (uint32_t k = 0; same && k < a->texts.count; k++)
        same = strcmp(a->texts.text[k], b->texts.text[k]) == 0;
    return same;
}

/* ---- Parsing ---- */

/* Insertions, deletions, replacements and swaps of neighbours that turn one name into the other; NAME_MOST: too long.
 */
static size_t distance(const char *a, size_t length, const char *b)
{
    const size_t other = strlen(b);
    size_t rows[3][NAME_MOST + 1];

    if (length > NAME_MOST || other > NAME_MOST)
        return NAME_MOST;
    for (size_t j = 0; j <= other; j++)
        rows[0][j] = j;
    for (size_t i = 1; i <= length; i++) {
        size_t *now = rows[i % 3];
        const size_t *last = rows[(i + 2) % 3], *before = rows[(i + 1) % 3];
        now[0] = i;
        for (size_t j = 1; j <= other; j++) {
            const size_t replaced = last[j - 1] + (a[i - 1] != b[j - 1]);
            now[j] = last[j] < now[j - 1] ? last[j] + 1 : now[j - 1] + 1;
            now[j] = replaced < now[j] ? replaced : now[j];
            if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] && before[j - 2] + 1 < now[j])
                now[j] = before[j - 2] + 1;
        }
    }
    return rows[length % 3][other];
}

/* The flag whose name is nearest, if at most a third of it differs. */
static const struct setting *nearest(const struct command *c, const char *name, size_t length)
{
    size_t least = length / 3 + 1;
    const struct setting *found = NULL;

    for (size_t k = 0; k < c->flag_count; k++) {
        const size_t d = distance(name, length, c->flags[k].row->name);
        if (d < least && command_offers(c, c->flags[k].row)) {
            least = d;
            found = c->flags[k].row;
        }
    }
    return found;
}

static enum err unknown_flag(const struct command *c, const char *given, size_t length, struct reason *why)
{
    const struct setting *near = nearest(c, given + 2, length);

    if (near)
        return err_say(why, ERR_USAGE, "unknown flag '%.*s': did you mean %s%s? (see %s --help all)", (int)length + 2,
                       given, setting_prefix(near), near->name, c->name);
    return err_say(why, ERR_USAGE, "unknown flag '%s' (see %s --help all%s%s)", given, c->name,
                   c->elsewhere ? "; " : "", c->elsewhere ? c->elsewhere : "");
}

/* value: NULL without one. */
static enum err take_value(struct command *c, struct command_flag *f, const char *value, struct reason *why)
{
    const struct setting *s = f->row;
    const bool adds = s->type == SETTING_TEXTS || s->type == SETTING_KEYS;

    if (adds && !f->seen) /* the command line replaces a configuration file's */
        f->texts.count = 0;
    if (s->unit && f->seen && !adds && !c->quiet)
        log_warning("%s%s is given more than once: the last one counts", setting_prefix(s), s->name);
    f->seen = true;
    if (!s->unit && value)
        return err_say(why, ERR_USAGE, "%s%s takes no value", setting_prefix(s), s->name);
    if (s->unit && !value)
        return err_say(why, ERR_USAGE, "%s%s needs a value: %s", setting_prefix(s), s->name, s->unit);
    return command_give(c, f, s->unit ? value : "1", why);
}

static enum err unknown_key(const struct command *c, const char *key, size_t length, struct reason *why)
{
    char keys[240] = "";

    for (size_t k = 0, used = 0; k < c->flag_count; k++, used = strlen(keys))
        if (c->flags[k].row->level == SETTING_TUNE)
            snprintf(keys + used, sizeof(keys) - used, "%s%s", used ? ", " : "", c->flags[k].row->name);
    return err_say(why, ERR_USAGE, "--tune has no key '%.*s'; it has %s", (int)length, key, keys);
}

/* KEY=VALUE,... or, of switches, KEY. */
static enum err take_keys(struct command *c, const char *text, struct reason *why)
{
    enum err e = ERR_OK;

    for (const char *at = text; at && !e; at = strchr(at, ',') ? strchr(at, ',') + 1 : NULL) {
        const size_t length = strcspn(at, ","), name = strcspn(at, "=,"), room = sizeof(c->tune) - c->tune_bytes;
        char key[NAME_MOST];
        snprintf(key, sizeof(key), KEY "%.*s", (int)name, at);
        struct command_flag *f = find(c, key, strlen(key));
        char *value = name < length ? c->tune + c->tune_bytes : NULL;
        if (!f)
            return unknown_key(c, at, name, why);
        if (value && length - name > room)
            return err_say(why, ERR_USAGE, "--tune: more than %d bytes of values", COMMAND_TUNE_BYTES);
        if (value)
            c->tune_bytes += (size_t)snprintf(value, room, "%.*s", (int)(length - name - 1), at + name + 1) + 1;
        e = take_value(c, f, value, why);
    }
    return e;
}

enum err command_give(struct command *c, struct command_flag *f, const char *text, struct reason *why)
{
    if (f->row->type == SETTING_KEYS)
        return take_keys(c, text, why);
    if (f->row->type == SETTING_TEXTS) {
        if (f->texts.count == SETTING_TEXTS_MAX)
            return err_say(why, ERR_USAGE, "--%s: given more than %d times", f->row->name, SETTING_TEXTS_MAX);
        f->texts.text[f->texts.count++] = text;
    }
    f->given = text;
    return ERR_OK;
}

/* Parses one flag and its value, given as --name=value or as the next argument. */
static enum err take_flag(struct command *c, int argc, char **argv, int *i, struct reason *why)
{
    const char *name = argv[*i] + 2;
    const char *equals = strchr(name, '=');
    const size_t length = equals ? (size_t)(equals - name) : strlen(name);
    struct command_flag *f = find(c, name, length);

    if (!f)
        return unknown_flag(c, argv[*i], length, why);
    const char *value = equals ? equals + 1 : f->row->unit && *i + 1 < argc ? argv[++*i] : NULL;
    if (f->row->level == SETTING_TUNE && !c->quiet)
        log_warning("--%s is spelt --tune %s%s%s now", f->row->name, f->row->name, value ? "=" : "",
                    value ? value : "");
    if (f->row->type == SETTING_KEYS && value && strcmp(value, "help") == 0) {
        f->given = value; /* for print_words */
        return ERR_OK;
    }
    return take_value(c, f, value, why);
}

/* Answers `--FLAG help`. */
static bool print_words(const struct command *c)
{
    for (size_t k = 0; k < c->flag_count; k++) {
        const struct setting *s = c->flags[k].row;
        const bool keys = s->type == SETTING_KEYS;
        if ((s->type != SETTING_CHOICE && !keys) || !c->flags[k].given || strcmp(c->flags[k].given, "help") != 0)
            continue;
        printf("%s%s %s, %s:\n", setting_prefix(s), s->name, s->unit, s->help);
        for (const struct setting_choice *x = s->choices; x && x->name; x++)
            if (choice_has(x->programs, c->program))
                printf("  %-16s %s\n", x->name, x->about ? x->about : "");
        if (keys)
            command_print_keys(c);
        return true;
    }
    return false;
}

/* A flag that prints something and ends the program; next: the argument behind it, or NULL. */
static bool print_asked(const struct command *c, const char *flag, const char *next)
{
    static const char completion[] = "--print-completion-";

    if (strcmp(flag, "--help") == 0 || strcmp(flag, "-h") == 0)
        command_print_help(c, next && strcmp(next, "all") == 0);
    else if (strcmp(flag, "--version") == 0)
        printf("%s %s\n", c->name, RELIGHT_VERSION);
    else if (strcmp(flag, "--print-manual") == 0)
        command_print_manual(c);
    else
        return strncmp(flag, completion, strlen(completion)) == 0 &&
               command_print_completion(c, flag + strlen(completion));
    return true;
}

enum err command_parse(struct command *c, int argc, char **argv, bool *done, struct reason *why)
{
    static char out[] = "--out";
    bool ended = false; /* by --: the rest are operands */
    enum err e = ERR_OK;

    *done = false;
    c->operand_count = 0;
    for (size_t k = 0; k < c->flag_count; k++)
        c->flags[k].seen = false;
    for (int i = 1; i < argc && !e; i++) {
        *done = !ended && print_asked(c, argv[i], i + 1 < argc ? argv[i + 1] : NULL);
        if (*done)
            return ERR_OK;
        if (!ended && strcmp(argv[i], "-o") == 0 && find(c, "out", 3)) /* as compilers and converters have it */
            argv[i] = out;
        if (!ended && strcmp(argv[i], "--") == 0)
            ended = true;
        else if (!ended && strncmp(argv[i], "--", 2) == 0)
            e = take_flag(c, argc, argv, &i, why);
        else if (c->operand_count < c->operand_max)
            c->operands[c->operand_count++] = argv[i];
        else
            e = err_say(why, ERR_USAGE, "unexpected argument '%s' (see %s --help)", argv[i], c->name);
    }
    *done = !e && print_words(c);
    return e;
}

/* ---- Values ---- */

static enum err read_whole(const struct setting *s, const char *text, void *values, struct reason *why)
{
    const uint64_t least = (uint64_t)s->least, most = s->most >= 0x1p64 ? UINT64_MAX : (uint64_t)s->most;
    char *end = NULL;

    errno = 0;
    const unsigned long long v = strtoull(text, &end, 10);
    if (errno || !isdigit((unsigned char)text[0]) || *end || v < least || v > most)
        return err_say(why, ERR_USAGE, "%s%s '%s' is not a whole number from %" PRIu64 " to %" PRIu64,
                       setting_prefix(s), s->name, text, least, most);
    if (s->type == SETTING_POWER && (v & (v - 1)))
        return err_say(why, ERR_USAGE, "%s%s '%s' is not a power of two", setting_prefix(s), s->name, text);
    setting_store_whole(s, values, s->scale > 0.0 ? v * (uint64_t)s->scale : v);
    return ERR_OK;
}

static enum err read_real(const struct setting *s, unsigned program, const char *text, void *values, struct reason *why)
{
    char *end = NULL, words[80] = "";
    const double v = strtod(text, &end);
    int word;

    if (s->choices && choice_parse(s->choices, program, s->name, text, &word, NULL) == ERR_OK) {
        setting_store_real(s, values, word);
        return ERR_OK;
    }
    if (s->choices)
        choice_list(s->choices, program, words, sizeof(words));
    if (end == text || *end || !isfinite(v) || v < s->least || v > s->most)
        return err_say(why, ERR_USAGE, "%s%s '%s' is not a number from %g to %g%s%s", setting_prefix(s), s->name, text,
                       s->least, s->most, words[0] ? ", " : "", words);
    setting_store_real(s, values, s->scale > 0.0 ? v * s->scale : v);
    return ERR_OK;
}

static enum err read_choice(const struct setting *s, unsigned program, const char *text, void *values,
                            struct reason *why)
{
    char flag[40];
    int v = 0;

    snprintf(flag, sizeof(flag), "%s%s", setting_prefix(s), s->name);
    const enum err e = choice_parse(s->choices, program, flag, text, &v, why);
    if (!e)
        setting_store_whole(s, values, (uint64_t)(unsigned)v);
    return e;
}

/* Parses 1 to 19 digits, which fit 64 bits. Accepts neither sign nor blank. */
static bool take_digits(const char **at, uint64_t *out)
{
    uint64_t v = 0;
    int count = 0;

    for (; **at >= '0' && **at <= '9' && count < 20; (*at)++, count++)
        v = 10 * v + (uint64_t)(**at - '0');
    *out = v;
    return count >= 1 && count <= 19;
}

static enum err read_frames(const struct setting *s, const char *text, struct setting_frames *out, struct reason *why)
{
    const char *at = text;
    uint64_t a = 0, b = 0;
    bool good = take_digits(&at, &a);

    b = a;
    if (good && *at == '-') {
        at++;
        good = take_digits(&at, &b);
    }
    if (!good || *at || a > b)
        return err_say(why, ERR_USAGE, "%s%s '%s' is not A-B with A <= B", setting_prefix(s), s->name, text);
    *out = (struct setting_frames){ true, a, b };
    return ERR_OK;
}

static enum err read_size(const struct setting *s, const char *text, uint32_t out[2], struct reason *why)
{
    unsigned w = 0, h = 0;
    int used = 0;

    if (sscanf(text, "%5ux%5u%n", &w, &h, &used) != 2 || text[used] || w < 1 || h < 1 || w > SIZE_MAX_SIDE ||
        h > SIZE_MAX_SIDE)
        return err_say(why, ERR_USAGE, "%s%s '%s' is not WIDTHxHEIGHT with sides from 1 to %d", setting_prefix(s),
                       s->name, text, SIZE_MAX_SIDE);
    out[0] = w;
    out[1] = h;
    return ERR_OK;
}

static enum err read_flag(const struct command *c, const struct command_flag *f, struct reason *why)
{
    const struct setting *s = f->row;
    void *values = *f->values, *at = (char *)values + s->offset;
    const bool is_switch = s->type == SETTING_SWITCH || s->type == SETTING_SWITCH_OFF;

    if (s->size == 0 || (!f->given && !is_switch))
        return ERR_OK;
    if (s->type == SETTING_NAME && strlen(f->given) >= s->size)
        return err_say(why, ERR_USAGE, "%s%s: longer than %u bytes", setting_prefix(s), s->name, s->size - 1);
    switch (s->type) {
    case SETTING_SWITCH:
    case SETTING_SWITCH_OFF: setting_store_whole(s, values, (f->given != NULL) == (s->type == SETTING_SWITCH)); break;
    case SETTING_WHOLE:
    case SETTING_POWER: return read_whole(s, f->given, values, why);
    case SETTING_REAL: return read_real(s, c->program, f->given, values, why);
    case SETTING_CHOICE: return read_choice(s, c->program, f->given, values, why);
    case SETTING_SIZE: return read_size(s, f->given, at, why);
    case SETTING_FRAMES: return read_frames(s, f->given, at, why);
    case SETTING_NAME: strcpy(at, f->given); break;
    case SETTING_TEXTS: memcpy(at, &f->texts, sizeof(f->texts)); break;
    case SETTING_TEXT: memcpy(at, &f->given, sizeof(f->given)); break;
    case SETTING_KEYS: break;
    }
    return ERR_OK;
}

enum err command_read(const struct command *c, struct reason *why)
{
    enum err e = ERR_OK;

    for (size_t k = 0; k < c->flag_count && !e; k++)
        e = read_flag(c, &c->flags[k], why);
    return e;
}
