/* The names of an enumerated setting's values, one list for each enum: flags, configuration files, control messages,
 * --help and the viewer page all read it. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>

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
