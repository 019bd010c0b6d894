/* server/base/options.h */
/* Command lines: one table per program names its flags, their defaults and one sentence each; parsing, --help and
 * --version follow from it, so that they cannot disagree. Main thread. */
#ifndef BASE_OPTIONS_H
#define BASE_OPTIONS_H

#include "err.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct option_row {
    const char *name;  /* without the dashes; NULL ends the table; "" with help only: a heading */
    const char *value; /* what stands for the value in --help, as "WxH"; NULL: a switch */
    const char *help;  /* one sentence */
    const char *given; /* in: the default or NULL; out: what the command line said ("1" for a switch) */
};

struct options {
    const char *program;                   /* as in "relight-render" */
    const char *synopsis;                  /* what follows the name in the usage line */
    const char *about;                     /* a paragraph */
    const char *epilogue_title, *epilogue; /* a heading and lines that end --help; NULL: nothing */
    struct option_row *rows;
    struct option_row *shared; /* another table, of flags that several programs have, or NULL; shown after the rows */
    const char *operands[8];   /* out: what was not a flag, in order */
    size_t operand_count;
    size_t operand_max; /* 0: none allowed; at most 8 */
};

/* Reads argv. --help and --version print to stdout and set *done, after which the program ends with 0; so do
 * --print-manual and --print-completion, by which the build makes its man pages and completions and which --help does
 * not mention. ERR_USAGE names the offending argument. Strings point into argv. */
MUST_CHECK enum err options_parse(struct options *o, int argc, char **argv, bool *done, struct reason *why);

/* options_print.c: to stdout, the page for man(1), and what bash's `complete` reads. Defaults are those of the rows. */
void options_print_manual(const struct options *o);
void options_print_completion(const struct options *o);

/* The row of that flag in either table, or NULL. */
struct option_row *options_row(struct options *o, const char *name);

/* What was given for `name`, or its default; NULL when neither. The name must be in the table. */
const char *options_get(const struct options *o, const char *name);
bool options_on(const struct options *o, const char *name);

/* The value as a decimal number within [least, most]; ERR_USAGE names flag, value and limits. */
MUST_CHECK enum err options_u64(const struct options *o, const char *name, uint64_t least, uint64_t most, uint64_t *out,
                                struct reason *why);
MUST_CHECK enum err options_double(const struct options *o, const char *name, double least, double most, double *out,
                                   struct reason *why);

/* "3-66", or "17" for 17-17. *given false, and the rest untouched, where nothing was given. */
MUST_CHECK enum err options_range(const struct options *o, const char *name, bool *given, uint64_t *first,
                                  uint64_t *last, struct reason *why);

/* "640x360" into two numbers in 1..16384. */
MUST_CHECK enum err options_size(const struct options *o, const char *name, uint32_t *width, uint32_t *height,
                                 struct reason *why);

#endif
