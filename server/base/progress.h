/* server/base/progress.h */
/* A progress line for long work: `rendering  12/67  18 %  0:42 left`, redrawn in place at most ten times a second.
 * Written only when the stream is a terminal; in a pipe or file nothing is written.
 * One line at a time per process; step may be called from any thread, begin and end from the one that owns the line. */
#ifndef BASE_PROGRESS_H
#define BASE_PROGRESS_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

struct progress {
    const char *what; /* borrowed */
    FILE *stream;     /* NULL: silent */
    uint64_t total;   /* 0: unknown, a count is shown instead of a share */
    _Atomic uint64_t done;
    _Atomic int64_t drawn_ms; /* when the line was last drawn */
    int64_t begun_ms;
};

/* `what` must outlive the progress. A stream that is no terminal makes every call silent; steps are counted all the
 * same, so that `done` of `total` may be told by other means. */
void progress_begin(struct progress *p, const char *what, uint64_t total, FILE *stream);
void progress_step(struct progress *p, uint64_t steps); /* NULL is allowed */
void progress_end(struct progress *p);                  /* wipes the line; NULL is allowed */

/* A line of the caller's own in that place, drawn at once; "" wipes it. */
void progress_show(FILE *stream, const char *text);

/* What to write before another line on `stream` so that a standing progress line does not mix with it. */
const char *progress_wipe(FILE *stream);

#endif
