/* The service manager's thread (systemd's Type=notify, base/notify.h): reports startup progress, readiness, status,
 * watchdog and stop. It runs only under a service manager. */
#pragma once

#include "base/err.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>

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
