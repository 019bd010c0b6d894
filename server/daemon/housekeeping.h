/* The housekeeping thread: the picture that is being made, the status line on a terminal and elsewhere the progress of
 * a cache in the log, log lines that were held back, and the file that keeps the settings. */
#ifndef DAEMON_HOUSEKEEPING_H
#define DAEMON_HOUSEKEEPING_H

#include "base/err.h"

#include <pthread.h>
#include <stdbool.h>
#include <stdint.h>

struct shared;
struct state_file;

/* Zeroed at first. */
struct housekeeping_thread {
    struct shared *shared;
    struct state_file *state;
    pthread_t thread;
    bool running;
    unsigned turns;              /* of its loop */
    int64_t late_ms;             /* begun_ms of the picture that is reported as late; 0: none is */
    bool terminal;               /* standard error is one */
    int64_t begun_ms, logged_ms; /* when a cache's computation was first seen, and last logged; 0: there is none */
    double begun_share;          /* of it, then */
};

/* shared and state must outlive the thread, which ends when shared_is_stopping. ERR_NOMEM: no thread. Main thread. */
MUST_CHECK enum err housekeeping_start(struct housekeeping_thread *t, struct shared *shared, struct state_file *state,
                                       struct reason *why);
void housekeeping_join(struct housekeeping_thread *t);

#endif
