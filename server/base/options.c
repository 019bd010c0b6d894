#include "base/options.h"

#include <assert.h>
#include <ctype.h>
#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SIZE_MAX_SIDE 16384

static struct option_row *find_in(struct option_row *rows, const char *name, size_t length)
{
    for (struct option_row *r = rows; r && r->name; r++)
        if (r->name[0] && strlen(r->name) == length && strncmp(r->name, name, length) == 0)
            return r;
    return NULL;
}

static struct option_row *find(const struct options *o, const char *name, size_t length)
{
    struct option_row *r = find_in(o->rows, name, length);
    return r ? r : find_in(o->shared, name, length);
}

struct option_row *options_row(struct options *o, const char *name)
{
    return find(o, name, strlen(name));
}

static void print_rows(const struct option_row *rows)
{
    for (const struct option_row *r = rows; r && r->name; r++) {
        char left[40];
        if (!r->name[0]) {
            printf("\n%s\n", r->help);
            continue;
        }
        snprintf(left, sizeof(left), "--%s%s%s", r->name, r->value ? " " : "", r->value ? r->value : "");
        printf("  %-26s %s", left, r->help);
        if (r->value && r->given &&
            strncmp(r->name, "token", 5) != 0) /* a token on the command line is a secret, not a default */
            printf(" [%s]", r->given);
        printf("\n");
    }
}

static void print_help(const struct options *o)
{
    printf("usage: %s %s\n\n%s\n", o->program, o->synopsis, o->about);
    print_rows(o->rows);
    print_rows(o->shared);
    printf("  %-26s %s\n  %-26s %s\n", "--help", "print this help and exit", "--version", "print the version and exit");
    if (o->epilogue)
        printf("\n%s\n%s", o->epilogue_title, o->epilogue);
}

/* Parses one flag and its value, given as --name=value or as the next argument. */
static enum err take_flag(struct options *o, int argc, char **argv, int *i, struct reason *why)
{
    const char *name = argv[*i] + 2;
    const char *equals = strchr(name, '=');
    const size_t length = equals ? (size_t)(equals - name) : strlen(name);
    struct option_row *r = find(o, name, length);

    if (!r)
        return err_say(why, ERR_USAGE, "unknown flag '%s' (see %s --help)", argv[*i], o->program);
    if (!r->value) {
        if (equals)
            return err_say(why, ERR_USAGE, "--%s takes no value", r->name);
        r->given = "1";
        return ERR_OK;
    }
    if (equals) {
        r->given = equals + 1;
    } else if (*i + 1 < argc) {
        r->given = argv[++*i];
    } else {
        return err_say(why, ERR_USAGE, "--%s needs a value: %s", r->name, r->value);
    }
    return ERR_OK;
}

enum err options_parse(struct options *o, int argc, char **argv, bool *done, struct reason *why)
{
    *done = false;
    o->operand_count = 0;
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--help") == 0 || strcmp(argv[i], "-h") == 0) {
            print_help(o);
            *done = true;
            return ERR_OK;
        }
        if (strcmp(argv[i], "--version") == 0) {
            printf("%s %s\n", o->program, RELIGHT_VERSION);
            *done = true;
            return ERR_OK;
        }
        if (strcmp(argv[i], "--print-manual") == 0 || strcmp(argv[i], "--print-completion") == 0) {
            (argv[i][8] == 'm' ? options_print_manual : options_print_completion)(o);
            *done = true;
            return ERR_OK;
        }
        if (strncmp(argv[i], "--", 2) == 0 && argv[i][2]) {
            const enum err e = take_flag(o, argc, argv, &i, why);
            if (e)
                return e;
        } else if (o->operand_count < o->operand_max) {
            o->operands[o->operand_count++] = argv[i];
        } else {
            return err_say(why, ERR_USAGE, "unexpected argument '%s' (see %s --help)", argv[i], o->program);
        }
    }
    return ERR_OK;
}

const char *options_get(const struct options *o, const char *name)
{
    const struct option_row *r = find(o, name, strlen(name));
    assert(r);
    return r->given;
}

bool options_on(const struct options *o, const char *name)
{
    return options_get(o, name) != NULL;
}

enum err options_u64(const struct options *o, const char *name, uint64_t least, uint64_t most, uint64_t *out,
                     struct reason *why)
{
    const char *text = options_get(o, name);
    char *end = NULL;

    if (!text)
        return err_say(why, ERR_USAGE, "--%s is missing", name);
    errno = 0;
    const unsigned long long v = strtoull(text, &end, 10);
    if (errno || !isdigit((unsigned char)text[0]) || *end || v < least || v > most)
        return err_say(why, ERR_USAGE, "--%s '%s' is not a whole number from %" PRIu64 " to %" PRIu64, name, text,
                       least, most);
    *out = v;
    return ERR_OK;
}

enum err options_double(const struct options *o, const char *name, double least, double most, double *out,
                        struct reason *why)
{
    const char *text = options_get(o, name);
    char *end = NULL;

    if (!text)
        return err_say(why, ERR_USAGE, "--%s is missing", name);
    const double v = strtod(text, &end);
    if (end == text || *end || !isfinite(v) || v < least || v > most)
        return err_say(why, ERR_USAGE, "--%s '%s' is not a number from %g to %g", name, text, least, most);
    *out = v;
    return ERR_OK;
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

enum err options_range(const struct options *o, const char *name, bool *given, uint64_t *first, uint64_t *last,
                       struct reason *why)
{
    const char *text = options_get(o, name), *at = text;
    uint64_t a = 0, b = 0;

    *given = false;
    if (!text)
        return ERR_OK;
    bool good = take_digits(&at, &a);
    b = a;
    if (good && *at == '-') {
        at++;
        good = take_digits(&at, &b);
    }
    if (!good || *at || a > b)
        return err_say(why, ERR_USAGE, "--%s '%s' is not A-B with A <= B", name, text);
    *given = true;
    *first = a;
    *last = b;
    return ERR_OK;
}

enum err options_size(const struct options *o, const char *name, uint32_t *width, uint32_t *height, struct reason *why)
{
    const char *text = options_get(o, name);
    unsigned w = 0, h = 0;
    int used = 0;

    if (!text)
        return err_say(why, ERR_USAGE, "--%s is missing", name);
    if (sscanf(text, "%5ux%5u%n", &w, &h, &used) != 2 || text[used] || w < 1 || h < 1 || w > SIZE_MAX_SIDE ||
        h > SIZE_MAX_SIDE)
        return err_say(why, ERR_USAGE, "--%s '%s' is not WIDTHxHEIGHT with sides from 1 to %d", name, text,
                       SIZE_MAX_SIDE);
    *width = w;
    *height = h;
    return ERR_OK;
}
