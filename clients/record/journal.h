/* The index of recorded images: one JSON object per line, written to disk before the image is acknowledged. Thread:
 * one. */
#pragma once

#include "base/err.h"

#include <jansson.h>
#include <stdbool.h>

struct journal {
    int fd; /* -1: no journal; all calls do nothing */
    const char *path;
    json_t *last; /* the last complete line, or NULL */
};

/* Opens or creates the file and continues after its last complete line, truncating a partial one left by a killed
 * writer. path NULL: no journal. ERR_IO names path and cause; also if the last line is longer than any index line. */
MUST_CHECK enum err journal_open(struct journal *j, const char *path, struct reason *why);
void journal_close(struct journal *j); /* zeroed memory except fd -1 is allowed */

/* Appends a line and takes ownership of it. Skips a line that equals the last one in all fields of `key`. ERR_IO,
 * ERR_NOMEM. */
MUST_CHECK enum err journal_add(struct journal *j, json_t *line, const char *const *key, struct reason *why);
