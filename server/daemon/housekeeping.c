#include "daemon/housekeeping.h"

#include "base/log.h"
#include "base/progress.h"
#include "daemon/shared.h"
#include "daemon/state.h"

#include <stdio.h>
#include <time.h>

#define PERIOD_MS 250

static void show_status(struct shared *shared)
{
    struct server_demand demand;
    char text[128];

    server_demand(shared->server, &demand);
    status_line(&shared->status, demand.viewers, text, sizeof(text));
    if (text[0]) /* else a progress line may be there */
        progress_show(stderr, text);
}

static void *run(void *arg)
{
    struct housekeeping_thread *t = arg;
    const struct log_desc *log = &t->shared->config.log;

    while (!shared_is_stopping(t->shared)) {
        nanosleep(&(struct timespec){ .tv_nsec = PERIOD_MS * 1000000 }, NULL);
        if (log->form == LOG_PLAIN && log->level >= LOG_INFO)
            show_status(t->shared);
        log_flush(false);
        state_save(t->state);
    }
    return NULL;
}

enum err housekeeping_start(struct housekeeping_thread *t, struct shared *shared, struct state_file *state,
                            struct reason *why)
{
    t->shared = shared;
    t->state = state;
    t->running = pthread_create(&t->thread, NULL, run, t) == 0;
    return t->running ? ERR_OK : err_say(why, ERR_NOMEM, "a thread could not be started");
}

void housekeeping_join(struct housekeeping_thread *t)
{
    if (t->running)
        pthread_join(t->thread, NULL);
    t->running = false;
}
