/* /healthz, /readyz and /metrics. The first two are open to everyone who can reach the port and reveal nothing else.
 * /metrics has counts and times, but no names, addresses or images. On loopback it is open too; elsewhere it requires
 * "Authorization: Bearer T" with its own token, or the viewers' token where it has none. */
#include "net/stream/internal.h"

#include "base/clock.h"

#include <stdio.h>
#include <string.h>
#include <time.h>

/* ---- Whether the server is alive and ready, and the delay of the network thread ---- */

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

/* ---- Answers ---- */

bool monitor_knows(const char *path)
{
    return strcmp(path, "/healthz") == 0 || strcmp(path, "/readyz") == 0 || strcmp(path, "/metrics") == 0;
}

static int answer_health(struct server *s, struct lws *wsi, const char *path, bool head)
{
    const bool asks_ready = strcmp(path, "/readyz") == 0;
    struct server_health h;
    char text[512];

    server_health(s, &h);
    const bool good = asks_ready ? h.ready : h.alive;
    pthread_mutex_lock(&s->lock);
    const unsigned long long published = s->published;
    pthread_mutex_unlock(&s->lock);
    snprintf(text, sizeof(text),
             "{\"status\":\"%s\",\"server\":\"relightd %s\",\"protocol\":\"%s\",\"minor\":%d,\"connections\":%llu,"
             "\"pictures\":%llu,\"loop_ms\":%lld,\"shade_ms\":%lld,\"ready\":%s}\n",
             good ? "ok" : h.reason, RELIGHT_VERSION, PROTOCOL_NAME, PROTOCOL_MINOR,
             (unsigned long long)atomic_load(&s->counts.open), published, (long long)h.loop_ms, (long long)h.beat_ms,
             h.ready ? "true" : "false");
    return http_respond_text(wsi, good ? 200 : 503, "application/json", text, head);
}

/* A request that a proxy forwards is not local, although the proxy is. */
static enum token_check admit(struct server *s, struct lws *wsi)
{
    const bool near = s->loopback && lws_hdr_total_length(wsi, WSI_TOKEN_X_FORWARDED_FOR) == 0;
    const char *wanted = s->token_metrics ? s->token_metrics : near ? NULL : s->tokens[SERVER_VIEWER];

    return !wanted || connection_forwarded(s, wsi) ? token_check_header(s, wsi, wanted) : TOKEN_WRONG;
}

static int answer_metrics(struct server *s, struct lws *wsi, struct http_session *h, bool head)
{
    size_t size = 0;

    const enum token_check may = admit(s, wsi);
    if (may == TOKEN_LATER)
        return http_refuse(s, wsi, 429, "Too many wrong tokens came from this address.\n");
    if (may == TOKEN_WRONG)
        return http_refuse(s, wsi, 401, "/metrics needs the header Authorization: Bearer TOKEN.\n");
    char *text = metrics_text(s, &size);
    if (!text)
        return http_respond_text(wsi, 503, "text/plain; charset=utf-8", "Out of memory.\n", head);
    return http_respond_long(wsi, h, "text/plain; version=0.0.4; charset=utf-8", text, size, head);
}

int monitor_answer(struct server *s, struct lws *wsi, struct http_session *h, const char *path, bool head)
{
    if (strcmp(path, "/metrics") == 0)
        return answer_metrics(s, wsi, h, head);
    return answer_health(s, wsi, path, head);
}
