/* server/relightd_service.c */
/* What the service manager is told (systemd's Type=notify, see base/notify.h): that the start goes on, that there is
 * something to be seen, how it gets on, that it lives, that it ends. A thread of its own, and only where a service
 * manager listens. */
#include "relightd.h"

#include "clock.h"
#include "notify.h"

#include <stdio.h>
#include <string.h>
#include <time.h>

#define LOOK_MS 200
#define EXTEND_S 10.0      /* between two words that the start goes on, */
#define EXTEND_US 60000000 /* each of which gives it so much time */
#define STATUS_S 2.0       /* at least between two sentences */
#define STATUS_MAX 400

struct service {
    bool ready;
    double extended_s, status_s, alive_s;
    double watchdog_s; /* within which it is to be told that this lives; 0: it does not ask */
    char status[STATUS_MAX];
};

/* One sentence: what it waits for, or what it shows, and to how many. */
static void describe(struct daemon *d, char *out)
{
    struct server_demand demand;

    server_demand(d->server, &demand);
    pthread_mutex_lock(&d->status_lock);
    const struct server_status *s = &d->status;
    if (s->source == SERVER_WAITING)
        snprintf(out, STATUS_MAX, "Waiting: %s.", s->detail && s->detail[0] ? s->detail : "nothing is loaded yet");
    else if (s->source == SERVER_FAILED)
        snprintf(out, STATUS_MAX, "Showing an older frame to %u viewers: %s.", demand.viewers, s->detail);
    else
        snprintf(out, STATUS_MAX, "Showing frame %llu of %s to %u viewers, %.3g pictures a second.",
                 (unsigned long long)s->frame, s->sky, demand.viewers, s->fps);
    pthread_mutex_unlock(&d->status_lock);
    for (char *p = out; *p; p++) /* a line end would begin another word */
        *p = *p == '\n' ? ' ' : *p;
}

static void say_status(struct daemon *d, struct service *s, double now)
{
    char text[STATUS_MAX];

    if (s->status_s > 0.0 && now - s->status_s < STATUS_S)
        return;
    describe(d, text);
    if (strcmp(text, s->status) == 0)
        return;
    if (notify_say("STATUS=%s", text)) {
        memcpy(s->status, text, sizeof(text));
        s->status_s = now;
    }
}

/* Only while the network's thread and the one that makes pictures are seen to go on: a service that hangs is to be
 * started anew. */
static void say_alive(struct service *s, bool alive, double now)
{
    if (s->watchdog_s <= 0.0 || !alive || (s->alive_s > 0.0 && now - s->alive_s < s->watchdog_s / 4.0))
        return;
    notify_say("WATCHDOG=1");
    s->alive_s = now;
}

static void look(struct daemon *d, struct service *s)
{
    const double now = clock_seconds();
    struct server_health health;

    server_health(d->server, &health);
    if (!s->ready && health.ready) {
        notify_say("READY=1");
        s->ready = true;
    }
    if (!s->ready && health.alive && (s->extended_s <= 0.0 || now - s->extended_s >= EXTEND_S)) {
        notify_say("EXTEND_TIMEOUT_USEC=%d", EXTEND_US);
        s->extended_s = now;
    }
    say_alive(s, health.alive, now);
    say_status(d, s, now);
}

static void *service_main(void *arg)
{
    struct daemon *d = arg;
    struct service s = { .watchdog_s = 1e-6 * (double)notify_watchdog_us() };

    while (!atomic_load(&d->service_over) && !daemon_is_stopping(d)) {
        look(d, &s);
        nanosleep(&(struct timespec){ .tv_nsec = LOOK_MS * 1000000L }, NULL);
    }
    notify_say("STOPPING=1\nSTATUS=Stopping.");
    return NULL;
}

enum err daemon_service_begin(struct daemon *d, struct reason *why)
{
    if (!notify_wanted())
        return ERR_OK;
    d->servicing = pthread_create(&d->service_thread, NULL, service_main, d) == 0;
    return d->servicing ? ERR_OK : err_say(why, ERR_NOMEM, "a thread could not be started");
}

void daemon_service_end(struct daemon *d)
{
    if (!d->servicing)
        return;
    atomic_store(&d->service_over, true);
    pthread_join(d->service_thread, NULL);
    d->servicing = false;
}
