/* /healthz, /readyz and /metrics. The first two are open to everyone who can reach the port and reveal nothing else.
 * /metrics has counts and times, but no names, addresses or images. On loopback it is open too; elsewhere it requires
 * "Authorization: Bearer T" with its own token, or the viewers' token where it has none. */
#include "net/stream/internal.h"

#include <stdio.h>
#include <string.h>

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
