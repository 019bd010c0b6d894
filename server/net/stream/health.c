/* Tests whether the server is alive and ready: /healthz, /readyz, and the delay of the network thread. */
#include "net/stream/internal.h"

#include "base/clock.h"

#include <time.h>

void server_beat(struct server *s)
{
    struct metrics *m = &s->metrics;
    clockid_t clock = 0;

    if (atomic_load(&m->beat_ms) == 0 && pthread_getcpuclockid(pthread_self(), &clock) == 0)
        atomic_store(&m->beat_clock, clock);
    atomic_store(&m->beat_ms, clock_ms());
}

void metrics_tick(struct server *s, int64_t now_us, int64_t every_us)
{
    struct metrics *m = &s->metrics;
    struct timespec t;

    if (m->tick_due_us > 0 && now_us - m->tick_due_us > atomic_load(&m->loop_late_us))
        atomic_store(&m->loop_late_us, now_us - m->tick_due_us);
    m->tick_due_us = now_us + every_us;
    atomic_store(&m->loop_us, now_us);
    if (atomic_load(&m->beat_ms) == 0 || atomic_load(&s->stopping) ||
        clock_gettime((clockid_t)atomic_load(&m->beat_clock), &t) != 0)
        return;
    const int64_t worked_ns = (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
    if (worked_ns != m->worked_ns)
        atomic_store(&m->worked_ms, clock_ms());
    m->worked_ns = worked_ns;
}

void metrics_worked(struct server *s, int64_t begun_us)
{
    const int64_t took_us = stream_now_us() - begun_us;

    server_observe(s, SERVER_LOOP, 1e-6 * (double)took_us);
    if (took_us > atomic_load(&s->metrics.loop_most_us))
        atomic_store(&s->metrics.loop_most_us, took_us);
}

void server_health(struct server *s, struct server_health *out)
{
    struct metrics *m = &s->metrics;
    const int64_t now_ms = clock_ms(), beat_ms = atomic_load(&m->beat_ms), worked_ms = atomic_load(&m->worked_ms);
    const char *reason = NULL;

    out->loop_ms = (stream_now_us() - atomic_load(&m->loop_us)) / 1000;
    out->beat_ms = beat_ms ? now_ms - beat_ms : -1;
    if (out->loop_ms >= SERVER_BEAT_MS)
        reason = "the network thread is late";
    else if (out->beat_ms >= SERVER_BUSY_MS || (out->beat_ms >= SERVER_BEAT_MS && now_ms - worked_ms >= SERVER_BEAT_MS))
        reason = "the rendering thread does not respond";
    out->alive = !reason;
    pthread_mutex_lock(&s->lock);
    if (reason)
        ;
    else if (atomic_load(&s->stopping))
        reason = "the server is shutting down";
    else if (!s->figures.loaded)
        reason = "the scene is being prepared";
    else if (s->published == 0 && s->figures.source == SERVER_FAILED)
        reason = "no sky frame could be used yet";
    else if (s->published == 0 && !s->push) /* else a producer's frame can be taken */
        reason = "the first image is being made";
    pthread_mutex_unlock(&s->lock);
    out->ready = !reason;
    out->reason = reason ? reason : "ok";
}
