/* Settings as rows of a table: one row defines the flag, the key of the configuration file, the --help and manual
 * text, the field of control messages with its range and clause of PROTOCOL.md, and where the value is stored. Rows
 * are constant and shared; values are plain structs of the caller's. Functions of their arguments, any thread. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* ---- Names of values ---- */

/* The names of an enumerated setting's values, one list for each enum: flags, configuration files, control messages,
 * --help and the viewer page all read it. */

/* The programs that have a setting or take a choice, as bits. 0 in a table: all of them. */
enum {
    FOR_RELIGHTD = 1,
    FOR_RENDER = 2,
    FOR_BENCH = 4,
    FOR_CHART = 8,
    FOR_CONTROL = 16, /* choices alone: the viewer page shows it */
    FOR_MOVIES = 32,  /* likewise: for programs that write video files, in builds that can */
};

/* One of the values of an enumerated setting. A list of these ends with name NULL. */
struct setting_choice {
    const char *name;
    int value;         /* of the enum, or bits */
    const char *about; /* one line: --NAME help prints it, and the page shows it */
    unsigned programs; /* FOR_*; 0: all */
};

/* The value's name, or "" where the list has none. Static; any thread. */
const char *choice_name(const struct setting_choice *choices, int value);
/* ERR_USAGE: `what` ("--tone", "tone") and the choices that the program takes; *out stays. why may be
 * NULL. Any thread. */
MUST_CHECK enum err choice_parse(const struct setting_choice *choices, unsigned program, const char *what,
                                 const char *name, int *out, struct reason *why);

/* "a, b or c": the names that the program takes, cut to size. */
void choice_list(const struct setting_choice *choices, unsigned program, char *out, size_t size);
/* Whether a program (a FOR_* bit) is among these; 0 means all. */
bool choice_has(unsigned programs, unsigned program);

struct json_t;

enum setting_type {
    SETTING_SWITCH,     /* bool: true when the flag is given */
    SETTING_SWITCH_OFF, /* bool: false when it is given, else true */
    SETTING_WHOLE,      /* a whole number of 1, 2, 4 or 8 bytes; may be negative in control messages only */
    SETTING_POWER,      /* likewise, a power of two */
    SETTING_REAL,       /* double */
    SETTING_CHOICE,     /* enum or integer of 4 bytes: the value of a choice */
    SETTING_NAME,       /* char[size]: copied */
    SETTING_TEXT,       /* const char *: points to the argument; for flags alone */
    SETTING_TEXTS,      /* struct setting_texts: the flag may be given several times; for flags alone */
    SETTING_SIZE,       /* uint32_t[2]: WxH in pixels */
    SETTING_FRAMES,     /* struct setting_frames: A-B */
    SETTING_KEYS,       /* KEY=VALUE,...: values of the rows of SETTING_TUNE; stores nothing itself */
};

#define SETTING_TEXTS_MAX 8 /* bounds what --publish sends to */
struct setting_texts {
    const char *text[SETTING_TEXTS_MAX]; /* they point to the arguments */
    uint32_t count;
};

struct setting_frames {
    bool given;
    uint64_t first, last;
};

enum setting_use {                    /* of a row with a key: bits */
                   SETTING_ASKED = 1, /* controllers may ask for it */
                   SETTING_TOLD = 2,  /* it is part of the state that everyone is sent */
                   SETTING_KEPT = 4,  /* and of the state file */
                   SETTING_ADDS = 8,  /* several in a row add up */
                   SETTING_STATE = SETTING_ASKED | SETTING_TOLD | SETTING_KEPT,
};

enum setting_needs {                        /* what a build may lack: bits */
                     NEEDS_VIDEO = 1,       /* video as a source */
                     NEEDS_MOVIES = 2,      /* video files and live streams as an output */
                     NEEDS_VIEWER_H264 = 4, /* H.264 for viewers */
                     NEEDS_MPI = 8,         /* jobs of several processes */
};

enum setting_reload {                  /* what changes when a configuration file is read again */
                      RELOAD_NEVER,    /* nothing until the next start */
                      RELOAD_SETTINGS, /* as if a controller had set it */
                      RELOAD_QUALITY,
                      RELOAD_SERVER, /* tokens, hosts and limits */
};

enum setting_level {
    SETTING_COMMON, /* in --help */
    SETTING_EXPERT, /* in --help all */
    SETTING_TUNE,   /* likewise, as a key of --tune; as a flag it counts, too, with a warning */
};

struct setting {
    const char *name;    /* flag and key of the configuration; NULL: neither */
    const char *unit;    /* stands for the value in --help, such as "WxH"; NULL: a switch */
    const char *help;    /* one sentence; the names of choices are added */
    const char *initial; /* the default as text; NULL: none */
    enum setting_level level;
    const char *section; /* heading in --help */
    unsigned programs;   /* FOR_*; 0: all */
    unsigned needs;      /* NEEDS_*: builds that lack one of them do not offer the flag, or, where there is `also`, */
    const char *also;    /* this end of the help; NULL: none */

    enum setting_type type;
    uint32_t offset, size;                /* of the field in the struct of values; size 0: the value is not stored */
    double least, most;                   /* WHOLE, POWER, REAL: its range; 0, 0 in a POWER or WHOLE without: any */
    double scale;                         /* WHOLE, REAL: what is stored is the value times this; 0: 1 */
    const struct setting_choice *choices; /* CHOICE; REAL: words that are taken too, stored as these numbers */
    enum setting_reload reload;

    /* What follows is for control messages (PROTOCOL.md 4.13). */
    const char *key;    /* of the JSON object; NULL: not in control messages */
    const char *clause; /* that a bad value breaks */
    const char *offers; /* key of the choices in a status's `offers`; NULL: not there */
    unsigned use;       /* SETTING_* bits */
    bool has_null;      /* JSON null is a value, */
    double null;        /* stored as this; of a REAL with `off`, that is */
    unsigned group;     /* of one group (not 0) the last one set counts, and a message may have only one */
};

/* Rows of one table with the struct that its offsets are of. A table ends with a row that has neither name nor key. */
struct setting_list {
    const struct setting *rows;
    void *values;
};

/* ---- One row ---- */

bool setting_ends(const struct setting *row); /* the row that ends a table */

/* The prefix of its name on a command line: "--", or "--tune ". */
const char *setting_prefix(const struct setting *row);

/* Copies the field from one struct to the other. */
void setting_copy(const struct setting *row, void *to, const void *from);
bool setting_is_null(const struct setting *row, const void *values); /* JSON null stands for the value */

/* The field as a number, for the types that are one; storing into a field of size 0 does nothing. */
int64_t setting_whole(const struct setting *row, const void *values);
double setting_real(const struct setting *row, const void *values);
void setting_store_whole(const struct setting *row, void *values, uint64_t v);
void setting_store_real(const struct setting *row, void *values, double v);

/* ---- Control messages ---- */

/* At most 32 rows have a key, and come first in their table: bit k of a mask stands for row k. */
#define SETTING_KEYS_MAX 32

/* Reads what controllers may ask for out of a JSON object into *values; *asked has a bit for each that it names.
 * ERR_USAGE: *clause is the one that is broken. Fields that no row names are ignored. */
MUST_CHECK enum err settings_from_json(const struct setting *rows, unsigned program, const struct json_t *object,
                                       uint32_t *asked, void *values, const char **clause, struct reason *why);

/* The fields of rows that have all bits of `use`, as a new JSON object; NULL when out of memory. */
struct json_t *settings_to_json(const struct setting *rows, unsigned use, const void *values);

/* A text from outside as a new JSON string: it may not be UTF-8; then a string says so instead. */
struct json_t *words_to_json(const char *text);

/* The values that controllers may set, as a new JSON object: each row's range, or its choices with their meaning.
 * NULL when out of memory. */
struct json_t *settings_ranges(const struct setting *rows, unsigned program);

/* One more request of the same controller: as if the first had been obeyed before the second. */
void settings_join(const struct setting *rows, uint32_t *asked, void *values, uint32_t then, const void *then_values);
