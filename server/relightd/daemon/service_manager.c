#include "relightd/daemon/service_manager.h"

#include "base/clock.h"
#include "base/process.h"
#include "relightd/daemon/shared.h"

#include <string.h>
#include <time.h>

#define PERIOD_MS 200      /* between two looks */
#define EXTEND_S 10.0      /* between two requests for more time to start, */
#define EXTEND_US 60000000 /* each of which asks for this much */
#define STATUS_S 2.0       /* at least, between two status sentences */
#define STATUS_MAX 400

/* What was sent last, and when (clock_seconds; 0: never). */
struct sent {
    bool ready;
    double extended_s, status_s, alive_s;
    double watchdog_s; /* the manager expects a sign of life within this time; 0: it does not */
    char status[STATUS_MAX];
};

static void send_status(struct shared *shared, struct sent *s, double now)
{
    struct server_demand demand;
    char text[STATUS_MAX];

    if (s->status_s > 0.0 && now - s->status_s < STATUS_S)
        return;
    server_demand(shared->server, &demand);
    status_sentence(&shared->status, demand.viewers, text, sizeof(text));
    if (strcmp(text, s->status) == 0)
        return;
    if (notify_send("STATUS=%s", text)) {
        memcpy(s->status, text, sizeof(text));
        s->status_s = now;
    }
}

/* Sent only while the network thread and the shade thread make progress: the manager restarts a service that hangs. */
static void send_watchdog(struct sent *s, bool alive, double now)
{
    if (s->watchdog_s <= 0.0 || !alive || (s->alive_s > 0.0 && now - s->alive_s < s->watchdog_s / 4.0))
        return;
    notify_send("WATCHDOG=1");
    s->alive_s = now;
}

static void report(struct shared *shared, struct sent *s)
{
    const double now = clock_seconds();
    struct server_health health;

    server_health(shared->server, &health);
    if (!s->ready && health.ready) {
        notify_send("READY=1");
        s->ready = true;
    }
    if (!s->ready && health.alive && (s->extended_s <= 0.0 || now - s->extended_s >= EXTEND_S)) {
        notify_send("EXTEND_TIMEOUT_USEC=%d", EXTEND_US);
        s->extended_s = now;
    }
    send_watchdog(s, health.alive, now);
    send_status(shared, s, now);
}

static void *run(void *arg)
{
    struct service_thread *t = arg;
    struct sent s = { .watchdog_s = 1e-6 * (double)notify_watchdog_us() };

    while (!atomic_load(&t->stop) && !shared_is_stopping(t->shared)) {
        report(t->shared, &s);
        nanosleep(&(struct timespec){ .tv_nsec = PERIOD_MS * 1000000L }, NULL);
    }
    notify_send("STOPPING=1\nSTATUS=Stopping.");
    return NULL;
}

enum err service_manager_start(struct service_thread *t, struct shared *shared, struct reason *why)
{
    if (!notify_enabled())
        return ERR_OK;
    t->shared = shared;
    t->running = pthread_create(&t->thread, NULL, run, t) == 0;
    return t->running ? ERR_OK : err_say(why, ERR_NOMEM, "a thread could not be started");
}

void service_manager_stop(struct service_thread *t)
{
    if (!t->running)
        return;
    atomic_store(&t->stop, true);
    pthread_join(t->thread, NULL);
    t->running = false;
}
