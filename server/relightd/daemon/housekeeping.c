#include "relightd/daemon/service_manager.h"

#include "base/clock.h"
#include "base/log.h"
#include "relightd/daemon/settings.h"
#include "relightd/daemon/shared.h"

#include <stdio.h>
#include <time.h>
#include <unistd.h>

#define PERIOD_MS 50       /* between two looks at the image that is being made, */
#define ALL_EVERY 5        /* of which every so many is one at all else */
#define PROGRESS_MS 10000  /* between lines of the log about a cache that is computed, without a terminal */
#define CANCEL_LEAST_MS 50 /* a new setting cancels no image that is made within this time */

/* Cancels the image if a new setting waits for its end, and reports one that exceeds the limit. */
static void watch_image(struct housekeeping_thread *t)
{
    struct image_watch *w = &t->shared->watch;
    const double limit_s = t->shared->config.image_s;
    const int64_t begun_ms = atomic_load(&w->begun_ms), passed_ms = clock_ms() - begun_ms;

    if (t->late_ms != begun_ms && t->late_ms != 0) {
        status_image_late(&t->shared->status, 0.0, false);
        t->late_ms = 0;
    }
    if (begun_ms == 0)
        return;
    if (atomic_load(&w->may_cancel) && passed_ms >= CANCEL_LEAST_MS && server_control_waits(t->shared->server))
        atomic_store(&w->cancel, true);
    if (1e-3 * (double)passed_ms <= limit_s)
        return;
    if (t->late_ms != begun_ms)
        log_info("an image takes longer than %g s (--max-picture-seconds): the machine is busy, or samples and size "
                 "are large for it",
                 limit_s);
    if (t->late_ms != begun_ms || t->turns % ALL_EVERY == 0)
        status_image_late(&t->shared->status, 1e-3 * (double)passed_ms, t->late_ms != begun_ms);
    t->late_ms = begun_ms;
}

static void show_status(struct shared *shared)
{
    struct server_demand demand;
    char text[128];

    server_demand(shared->server, &demand);
    status_line(&shared->status, demand.viewers, text, sizeof(text));
    if (text[0]) /* else a progress line may be there */
        progress_show(stderr, text);
}

/* How far the cache is, and the time left. */
static void log_progress(struct housekeeping_thread *t)
{
    const double share = status_cache_share(&t->shared->status);
    const int64_t now_ms = clock_ms();
    char left[48] = "";

    if (!(share > 0.0 && share < 1.0)) {
        t->logged_ms = 0;
        t->pace = (struct pace){ .share = 0.0 };
        return;
    }
    const double left_s = pace_take(&t->pace, share, 1e-3 * (double)now_ms);
    if (t->logged_ms == 0)
        t->logged_ms = now_ms;
    if (now_ms - t->logged_ms < PROGRESS_MS)
        return;
    t->logged_ms = now_ms;
    if (left_s > 0.0)
        snprintf(left, sizeof(left), ", about %.0f s left", left_s);
    log_info("light-transport cache: %.0f %% computed%s", 100.0 * share, left);
}

static void report_publishing(struct shared *shared)
{
    struct server_publish targets[SERVER_PUBLISH_MAX];
    const uint32_t count = publisher_report(shared->publisher, targets);

    if (count > 0)
        status_set_publish(&shared->status, targets, count);
}

static void *run(void *arg)
{
    struct housekeeping_thread *t = arg;
    const struct log_desc *log = &t->shared->config.log;

    while (!shared_is_stopping(t->shared)) {
        nanosleep(&(struct timespec){ .tv_nsec = PERIOD_MS * 1000000 }, NULL);
        watch_image(t);
        if (++t->turns % ALL_EVERY != 0)
            continue;
        if (log->form == LOG_PLAIN && log->level >= LOG_INFO)
            show_status(t->shared);
        if (!t->terminal)
            log_progress(t);
        report_publishing(t->shared);
        log_flush(false);
        state_save(t->state);
    }
    atomic_store(&t->shared->watch.cancel, true);
    return NULL;
}

enum err housekeeping_start(struct housekeeping_thread *t, struct shared *shared, struct state_file *state,
                            struct reason *why)
{
    t->shared = shared;
    t->terminal = isatty(STDERR_FILENO);
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
