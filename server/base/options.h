/* server/base/options.h */
/* Command lines. One table per program lists its flags with their defaults and help texts; parsing, --help, --version,
 * the man page and the shell completion all use it. Thread: main. The caller owns the tables. */
#ifndef BASE_OPTIONS_H
#define BASE_OPTIONS_H

#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct option_row {
    const char *name;  /* without dashes; NULL ends the table; "" with help only: a heading */
    const char *value; /* placeholder in --help, such as "WxH"; NULL: a switch */
    const char *help;  /* one sentence */
    const char *given; /* in: the default or NULL; out: the value from the command line ("1" for a switch) */
};

struct options {
    const char *program;                   /* such as "relight-render" */
    const char *synopsis;                  /* text after the program's name in the usage line */
    const char *about;                     /* a paragraph */
    const char *epilogue_title, *epilogue; /* a heading and lines at the end of --help; NULL: none */
    struct option_row *rows;
    struct option_row
        *shared;             /* a second table, of flags common to several programs, or NULL; printed after the rows */
    const char *operands[8]; /* out: arguments that are not flags, in order */
    size_t operand_count;
    size_t operand_max; /* 0: none allowed; at most 8 */
};

/* Parses argv. --help and --version print to stdout and set *done; the program then exits with 0. So do --print-manual
 * and --print-completion, which the build uses to generate man pages and completions and which --help omits. ERR_USAGE
 * names the offending argument. Values point into argv. */
MUST_CHECK enum err options_parse(struct options *o, int argc, char **argv, bool *done, struct reason *why);

/* options_print.c */
void options_print_manual(const struct options *o);     /* a man(1) page, to stdout; shows the defaults of the rows */
void options_print_completion(const struct options *o); /* a bash completion script, to stdout */

/* The row of a flag in either table, or NULL. */
struct option_row *options_row(struct options *o, const char *name);

/* The value given for `name`, else its default, else NULL. The name must be in the table. */
const char *options_get(const struct options *o, const char *name);
bool options_on(const struct options *o, const char *name); /* whether a switch is set */

/* Parses the value as a decimal integer within [min, max]. ERR_USAGE names flag, value and limits. */
MUST_CHECK enum err options_u64(const struct options *o, const char *name, uint64_t min, uint64_t max, uint64_t *out,
                                struct reason *why);
/* As options_u64, for a finite number. */
MUST_CHECK enum err options_double(const struct options *o, const char *name, double min, double max, double *out,
                                   struct reason *why);

/* Parses "3-66", or "17" for 17-17. If the flag has no value, sets *given to false and leaves the rest unchanged.
 * ERR_USAGE. */
MUST_CHECK enum err options_range(const struct options *o, const char *name, bool *given, uint64_t *first,
                                  uint64_t *last, struct reason *why);

/* Parses "640x360" into two numbers in 1..16384. ERR_USAGE. */
MUST_CHECK enum err options_size(const struct options *o, const char *name, uint32_t *width, uint32_t *height,
                                 struct reason *why);

#endif
