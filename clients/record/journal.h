/* clients/record/journal.h */
/* The list of what was recorded: one JSON object a line, on disk before the picture is acknowledged. One thread. */
#ifndef RECORD_JOURNAL_H
#define RECORD_JOURNAL_H

#include "err.h"

#include <jansson.h>
#include <stdbool.h>

struct journal {
    int fd; /* -1: there is none, and all calls do nothing */
    const char *path;
    json_t *last; /* the last line that was whole, or NULL */
};

/* Opens or creates the file and goes on behind its last whole line: half of one, which a killed writer has left, is cut
 * off. path NULL: no journal. ERR_IO names path and cause; also when the last line is longer than any of ours. */
MUST_CHECK enum err journal_open(struct journal *j, const char *path, struct reason *why);
void journal_close(struct journal *j); /* zeroed memory but for fd -1 is allowed */

/* Takes the line over. A line that says the same as the last one in all the fields of `key` is left out. */
MUST_CHECK enum err journal_add(struct journal *j, json_t *line, const char *const *key, struct reason *why);

#endif
