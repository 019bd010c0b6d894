/* Command lines. Tables of settings list a program's flags; parsing, --help, --version, the man page and the shell
 * completion all follow from them. Thread: main. The caller owns the tables. */
#pragma once

#include "base/err.h"
#include "base/setting.h"

#include <stdbool.h>
#include <stddef.h>

#define COMMAND_LISTS 2         /* the shared table and the program's own */
#define COMMAND_FLAGS 112       /* bounds a table; relightd has 98 */
#define COMMAND_OPERANDS 8      /* programs take two at most */
#define COMMAND_TUNE_BYTES 1024 /* each key once takes about 100 */

struct command_flag {
    const struct setting *row;
    void *const *values;        /* the struct that the row's offset is of */
    const char *initial;        /* its default as text; NULL: none */
    const char *given;          /* the value given, else the default ("1" for a switch); NULL: neither */
    bool seen;                  /* in the arguments */
    struct setting_texts texts; /* of SETTING_TEXTS: all values, of which `given` is the last */
};

/* The command line of one program. The caller sets the first part. */
struct command {
    const char *name;                         /* such as "relight-render" */
    const char *synopsis;                     /* text after the name in the usage line */
    const char *about;                        /* a paragraph */
    const char *elsewhere;                    /* said of an unknown flag: which other program has it; NULL: nothing */
    const char *epilogue_title, *epilogue;    /* a heading and lines at the end of --help; NULL: none */
    unsigned program;                         /* FOR_* bit; 0: none of these */
    struct setting_list lists[COMMAND_LISTS]; /* rows NULL: none */
    unsigned lacks;                           /* NEEDS_* that this build has not */
    bool quiet;                               /* no warning of a flag that is given twice */
    size_t operand_max;                       /* 0: none allowed; at most COMMAND_OPERANDS */

    struct command_flag flags[COMMAND_FLAGS]; /* filled by command_begin, section by section, as in the tables */
    size_t flag_count;
    const char *operands[COMMAND_OPERANDS]; /* out: arguments that are not flags, in order */
    size_t operand_count;
    char tune[COMMAND_TUNE_BYTES]; /* values of keys of --tune, one after the other */
    size_t tune_bytes;
};

/* Puts all flags at their defaults. c must not be moved afterwards. */
void command_begin(struct command *c);

/* Gives the flag a value as text: adds it to those of SETTING_TEXTS, gives it to the keys that SETTING_KEYS names, else
 * replaces the one before. ERR_USAGE: too many, or no such key. text must outlive the command. */
MUST_CHECK enum err command_give(struct command *c, struct command_flag *f, const char *text, struct reason *why);

/* Whether both flags, of one row, have the same values. */
bool command_flag_equals(const struct command_flag *a, const struct command_flag *b);

/* Another default of a flag, static, for this program. Between command_begin and command_parse. */
void command_default(struct command *c, const char *name, const char *initial);

/* Parses argv. --help [all], --version and `--FLAG help` of a flag with choices or keys print to stdout and set *done;
 * the program then exits with 0. So do --print-manual and --print-completion-SHELL, which the build uses to generate
 * man pages and completions and which --help omits. ERR_USAGE names the offending argument. Values point into argv. */
MUST_CHECK enum err command_parse(struct command *c, int argc, char **argv, bool *done, struct reason *why);

/* Stores the values of all flags that have one into the lists' structs; others are left as they are. ERR_USAGE names
 * flag, value and what is allowed. */
MUST_CHECK enum err command_read(const struct command *c, struct reason *why);

struct command_flag *command_flag(struct command *c, const char *name); /* NULL: no such flag */

/* The value given for a flag, which the program has, else its default, else NULL. */
const char *command_get(const struct command *c, const char *name);

/* Whether the flag, which the program has, was given, be it its default. */
bool command_given(const struct command *c, const char *name);

/* Whether --help, the manual and completion show the flag: this build has what it needs. */
bool command_offers(const struct command *c, const struct setting *row);
const char *command_also(const struct command *c, const struct setting *row); /* the end of its help, or "" */

/* command_print.c: to stdout. */
void command_print_help(const struct command *c, bool all); /* all: not only SETTING_COMMON */
void command_print_keys(const struct command *c);           /* those of --tune */
void command_print_manual(const struct command *c);         /* a man(1) page */

/* command_complete.c: to stdout. shell: bash, zsh or fish; false: another one. */
bool command_print_completion(const struct command *c, const char *shell);

/* ---- Configuration files ---- */

/* A configuration file: one JSON object [RFC 8259] whose keys are a program's flags without their dashes. A flag with a
 * value takes a string or a number; a switch takes true or false.
 * Thread: one at a time. Strings that are returned belong to the configuration and live as long as it does. */

struct config;

#define CONFIG_BYTES_MAX ((size_t)1 << 20) /* all flags take a few KB: a larger file is a mistake */

/* Reads a file. The caller owns *out. On error *out is NULL and *why begins with the file and, if known, the line.
 * ERR_IO: cannot be read. ERR_FORMAT: not JSON, not an object, or a duplicate key. ERR_RANGE: too large. ERR_NOMEM. */
MUST_CHECK enum err config_read(const char *path, struct config **out, struct reason *why);
/* As config_read, from `size` bytes of text. `name` stands for the file in messages. */
MUST_CHECK enum err config_parse(const char *name, const char *text, size_t size, struct config **out,
                                 struct reason *why);
void config_destroy(struct config *c); /* NULL is allowed */

const char *config_name(const struct config *c); /* the file's path, or the name given to config_parse */

/* Whether the file's permissions let anyone but its owner read it. */
bool config_is_readable_by_others(const struct config *c);

size_t config_count(const struct config *c);                  /* number of keys */
const char *config_key(const struct config *c, size_t index); /* in file order; index < config_count */

/* Copies the value of key `index` to the flag of that name. ERR_USAGE, with file, line and key: the table has no such
 * flag, or the flag does not take a value of this type. */
MUST_CHECK enum err config_apply(const struct config *c, size_t index, struct command *to, struct reason *why);

/* Prefixes *why with file, line and key: "F:3: port: '0' is ...". Returns e. */
enum err config_add_location(const struct config *c, size_t index, enum err e, struct reason *why);
