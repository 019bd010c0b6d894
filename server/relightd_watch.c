/* What goes on beside the pictures, on a thread of its own: the status line of a terminal, lines of the log that were
 * held back, and the file that keeps what controllers set. */
#include "relightd.h"

#include "log.h"

#include <stdio.h>
#include <string.h>
#include <time.h>

#define LOOK_MS 250

static void add(char *text, size_t size, const char *format, double value)
{
    const size_t used = strlen(text);

    snprintf(text + used, size - used, format, value);
}

/* One line, short enough for a terminal of 80 columns: "29.8 pictures/s, 3 viewers, error 2.1e-04, cache 34 %". */
static void show_status(struct daemon *d)
{
    static const char *const states[] = { "waiting", "", "paused", "ended", "the last frame was refused" };
    struct server_demand demand;
    char text[128] = "";

    server_demand(d->server, &demand);
    pthread_mutex_lock(&d->status_lock);
    const struct server_status s = d->status;
    const struct server_figures f = d->figures;
    pthread_mutex_unlock(&d->status_lock);
    if (!f.loaded || f.used == 0)
        return; /* a progress line may be standing there */
    add(text, sizeof(text), "%.1f pictures/s", f.fps);
    add(text, sizeof(text), demand.viewers == 1 ? ", %.0f viewer" : ", %.0f viewers", demand.viewers);
    if (f.error > 0.0)
        add(text, sizeof(text), ", error %.1e", f.error);
    if (f.cache_share > 0.0)
        add(text, sizeof(text), ", cache %.0f %%", 100.0 * f.cache_share);
    if (states[s.source][0])
        snprintf(text + strlen(text), sizeof(text) - strlen(text), ", %s", states[s.source]);
    progress_show(stderr, text);
}

void *daemon_watch_main(void *arg)
{
    struct daemon *d = arg;

    while (!daemon_is_stopping(d)) {
        nanosleep(&(struct timespec){ .tv_nsec = LOOK_MS * 1000000 }, NULL);
        if (d->log.form == LOG_PLAIN && d->log.level >= LOG_INFO)
            show_status(d);
        log_flush(false);
        daemon_state_keep(d);
    }
    return NULL;
}
