/* A progress line for long computations: `rendering  12/67  18 %  0:42 left`, redrawn in place at most ten times a
 * second on a terminal; elsewhere a line of the log every ten seconds. One line per process at a time.
 * Thread: any for progress_step; the other functions belong to the thread that owns the line. */
#pragma once

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
    struct progress_part *part; /* of the step that is being made; NULL: its progress is unknown */
};

/* Progress within a step of a line, which shows it as a part of that step. */
struct progress_part {
    struct progress *line;
    uint64_t total; /* > 0 */
    _Atomic uint64_t done;
};

/* Starts a line. `what` must outlive the progress. Steps are counted without a stream, too. */
void progress_begin(struct progress *p, const char *what, uint64_t total, FILE *stream);
void progress_step(struct progress *p, uint64_t steps); /* counts finished steps; p may be NULL */

/* While a step of the line is made: progress_part_step may come from any thread, the others from the line's. line or
 * part NULL: they do nothing. */
void progress_part_begin(struct progress_part *part, struct progress *line, uint64_t total);
void progress_part_step(struct progress_part *part, uint64_t steps);
void progress_part_end(struct progress_part *part);

/* The time that a computation has left by its pace so far. Zero it first. */
struct pace {
    double share, begun_s; /* when it was first asked for; share 0: not yet */
    double last, left_s;   /* of the last call; left_s 0: unknown */
};

/* share: done, 0..1. Seconds, which never rise: a pace that falls leaves them until the work catches up. 0: not known
 * yet. A share below the last one is another computation. */
double pace_take(struct pace *p, double share, double now_s);

void progress_end(struct progress *p); /* wipes the line; p may be NULL */

/* Draws the caller's own line at once; "" wipes it. */
void progress_show(FILE *stream, const char *text);

/* The control sequence to print before another line on `stream`, so that it does not mix with a progress line; may be
 * "". */
const char *progress_wipe(FILE *stream);
