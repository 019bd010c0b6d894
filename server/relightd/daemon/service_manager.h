/* The service manager's thread (systemd's Type=notify, base/process.h): reports startup progress, readiness, status,
 * watchdog and stop. It runs only under a service manager. */
#pragma once

#include "base/err.h"
#include "base/progress.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

struct shared;

/* Zero it first. */
struct service_thread {
    struct shared *shared;
    pthread_t thread;
    bool running;
    atomic_bool stop;
};

/* shared->server must run and outlive the thread. ERR_NOMEM: no thread. ERR_OK without a service manager. Main
 * thread. */
MUST_CHECK enum err service_manager_start(struct service_thread *t, struct shared *shared, struct reason *why);
void service_manager_stop(struct service_thread *t);

/* ---- Housekeeping ---- */

/* The housekeeping thread. It watches the time of the current image, prints the status line on a terminal or else
 * logs a cache's progress, logs held-back lines, and saves the settings file. */

struct shared;
struct state_file;

/* Zero it first. */
struct housekeeping_thread {
    struct shared *shared;
    struct state_file *state;
    pthread_t thread;
    bool running;
    unsigned turns;    /* iterations of its loop */
    int64_t late_ms;   /* begun_ms of the image that was reported as late; 0: none */
    bool terminal;     /* standard error is a terminal */
    int64_t logged_ms; /* when a cache's computation was last logged or first seen; 0: none is running */
    struct pace pace;  /* of that */
};

/* shared and state must outlive the thread, which ends when shared_is_stopping. ERR_NOMEM: no thread. Main thread. */
MUST_CHECK enum err housekeeping_start(struct housekeeping_thread *t, struct shared *shared, struct state_file *state,
                                       struct reason *why);
void housekeeping_join(struct housekeeping_thread *t);
