/* server/base/progress.h */
/* A progress line for long computations: `rendering  12/67  18 %  0:42 left`, redrawn in place at most ten times a
 * second on a terminal; elsewhere a line of the log every ten seconds. One line per process at a time.
 * Thread: any for progress_step; the other functions belong to the thread that owns the line. */
#ifndef BASE_PROGRESS_H
#define BASE_PROGRESS_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

struct progress {
    const char *what; /* borrowed */
    FILE *stream;     /* NULL: silent */
    bool terminal;    /* it is one */
    uint64_t total;   /* 0: unknown; the line then shows a count instead of a percentage */
    _Atomic uint64_t done;
    _Atomic int64_t drawn_ms; /* time of the last redraw */
    int64_t begun_ms;
};

/* Starts a line. `what` must outlive the progress. Steps are counted without a stream, too. */
void progress_begin(struct progress *p, const char *what, uint64_t total, FILE *stream);
void progress_step(struct progress *p, uint64_t steps); /* counts finished steps; p may be NULL */
void progress_end(struct progress *p);                  /* wipes the line; p may be NULL */

/* Draws the caller's own line at once; "" wipes it. */
void progress_show(FILE *stream, const char *text);

/* The control sequence to print before another line on `stream`, so that it does not mix with a progress line; may be
 * "". */
const char *progress_wipe(FILE *stream);

#endif
