/* Reconfigures a running server: the new description becomes a server that never runs, and the service thread copies
 * the changeable parts from it. */
#include "net/stream/server.h"

#include "base/clock.h"
#include "base/log.h"
#include "net/stream/internal.h"

#include <time.h>

#define CERTIFICATE_DAYS 14 /* warn when it is valid for fewer */

enum err server_check(const struct server_desc *desc, struct reason *why)
{
    char web_dir[4096];
    enum err e;

    struct server *s = server_prepare(desc, &e, why);
    if (!e)
        e = server_may_listen(s, desc->port, why);
    if (!e)
        e = site_folder(desc->web_dir, web_dir, sizeof(web_dir), why);
    if (!e)
        e = site_load(&s->site, web_dir, why);
    server_destroy(s);
    return e;
}

enum err server_change(struct server *s, const struct server_desc *desc, struct reason *why)
{
    struct server_desc here = *desc;
    enum err e;

    here.address = s->address;
    here.push = s->push;
    here.max_connections = s->limits.most_admitted;
    struct server *next = server_prepare(&here, &e, why);
    if (!e)
        e = server_may_listen(next, s->port, why);
    if (e) {
        server_destroy(next);
        return e;
    }
    pthread_mutex_lock(&s->lock);
    struct server *unused = s->next;
    s->next = next;
    pthread_mutex_unlock(&s->lock);
    server_destroy(unused);
    lws_cancel_service(s->context);
    return ERR_OK;
}

void server_log_certificate(const struct server *s)
{
    const time_t expires = s->tls ? (time_t)tls_expires_s(s->tls) : 0;
    const int64_t days = ((int64_t)expires - clock_wall_us() / 1000000) / 86400;
    struct tm parts;
    char text[40];

    if (!s->tls || !gmtime_r(&expires, &parts) || !strftime(text, sizeof(text), "%Y-%m-%d %H:%M:%S UTC", &parts))
        return;
    if (days < CERTIFICATE_DAYS)
        log_warning("--tls-cert %s: is valid until %s, %lld days from now", s->tls_cert, text, (long long)days);
    else
        log_info("--tls-cert %s: is valid until %s", s->tls_cert, text);
}

static void swap_texts(char **a, char **b)
{
    char *old = *a;

    *a = *b;
    *b = old;
}

void server_take_change(struct server *s)
{
    pthread_mutex_lock(&s->lock);
    struct server *next = s->next;
    s->next = NULL;
    pthread_mutex_unlock(&s->lock);
    if (!next)
        return;
    for (int r = 0; r < SERVER_ROLES; r++)
        swap_texts(&s->tokens[r], &next->tokens[r]);
    swap_texts(&s->token_metrics, &next->token_metrics);
    swap_texts(&s->public_names, &next->public_names);
    swap_texts(&s->embed_policy, &next->embed_policy);
    s->behind_proxy = next->behind_proxy;
    memcpy(s->proxies, next->proxies, sizeof(s->proxies));
    s->limits.per_address = next->limits.per_address;
    s->limits.per_address_given = next->limits.per_address_given;
    s->max_frame_bytes = next->max_frame_bytes;
    s->controllers = next->controllers;
    s->recorders = next->recorders;
    s->allow_remote = next->allow_remote;
    if (s->tls && next->tls) {
        struct tls *old = s->tls;
        s->tls = next->tls;
        next->tls = old;
        swap_texts(&s->tls_cert, &next->tls_cert);
        swap_texts(&s->tls_key, &next->tls_key);
        server_log_certificate(s);
    }
    server_destroy(next);
}
