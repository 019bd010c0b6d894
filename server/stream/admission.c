#include "stream/internal.h"

#include "base/log.h"
#include "base/mem.h"

#include <netinet/in.h>
#include <string.h>
#include <sys/socket.h>

#define TOKEN_MAX 255 /* bytes, as in PROTOCOL.md 4.1.3 */
#define OTHERS 16     /* connections beside WebSockets: a browser opens six for a page */

/* libwebsockets keeps one pointer of ours with each connection, from the first byte to the last. */
static struct visitor *of_connection(struct lws *wsi)
{
    return lws_get_opaque_user_data(wsi);
}

static bool is_limited(const struct server *s, const struct visitor *v)
{
    return s->max_per_address_given || !v->loopback; /* local connections may all come through a proxy */
}

/* NULL: the connection is gone, or there is no free row. */
static struct visitor *at_other_end(struct server *s, struct lws *wsi)
{
    struct sockaddr_storage from = { 0 };
    socklen_t size = sizeof(from);

    if (getpeername(lws_get_socket_fd(wsi), (struct sockaddr *)&from, &size) != 0)
        return NULL;
    return visitors_find(&s->visitors, (const struct sockaddr *)&from, viewer_now_us());
}

int admission_arrive(struct server *s, struct lws *wsi)
{
    struct visitor *v = at_other_end(s, wsi);

    lws_set_opaque_user_data(wsi, NULL);
    if (!v || (is_limited(s, v) && v->connections >= s->max_per_address + OTHERS)) {
        atomic_fetch_add(&s->counts.refused, 1);
        atomic_fetch_add(&s->counts.crowded, 1);
        return -1;
    }
    v->connections++;
    lws_set_opaque_user_data(wsi, v);
    return 0;
}

void admission_leave(struct lws *wsi)
{
    struct visitor *v = of_connection(wsi);

    if (!v)
        return;
    v->connections--;
    lws_set_opaque_user_data(wsi, NULL);
}

bool admission_forwarded(struct server *s, struct lws *wsi)
{
    struct visitor *before = of_connection(wsi); /* the proxy, or the client of the previous request */
    char header[1024], address[VISITOR_NAME];

    if (!s->behind_proxy || !before || lws_hdr_total_length(wsi, WSI_TOKEN_X_FORWARDED_FOR) == 0)
        return true;
    const struct visitor *proxy = at_other_end(s, wsi);
    if (!proxy || !proxy->loopback)
        return true;
    if (lws_hdr_copy(wsi, header, sizeof(header), WSI_TOKEN_X_FORWARDED_FOR) <= 0)
        return false;
    struct visitor *v = visitors_forwarded(&s->visitors, header, viewer_now_us(), address, sizeof(address));
    if (!v)
        return false;
    before->connections--;
    v->connections++;
    lws_set_opaque_user_data(wsi, v);
    return true;
}

bool admission_socket(struct viewer *v)
{
    struct server *s = v->server;

    v->visitor = of_connection(v->wsi);
    if (!v->visitor)
        return true;
    if (s->behind_proxy)
        visitor_name(v->visitor, v->peer);
    const bool room = !is_limited(s, v->visitor) || v->visitor->sockets < s->max_per_address;
    v->visitor->sockets++;
    if (!room)
        atomic_fetch_add(&s->counts.crowded, 1);
    return room;
}

void admission_socket_leave(struct viewer *v)
{
    if (v->visitor)
        v->visitor->sockets--;
    v->visitor = NULL;
}

/* Compares in constant time, so that timing reveals nothing about the token. */
static bool is_same(const char *given, const char *wanted)
{
    const size_t length = strlen(given);
    unsigned differs = length != strlen(wanted);

    for (size_t i = 0; wanted[i]; i++)
        differs |= (unsigned char)wanted[i] ^ (unsigned char)given[i < length ? i : length];
    return !differs;
}

enum admission admission_token(struct server *s, struct lws *wsi, const char *given, const char *wanted)
{
    const int64_t now = viewer_now_us();
    struct visitor *v = of_connection(wsi);
    char name[VISITOR_NAME];

    if (!given[0]) /* an empty token is no guess */
        return ADMISSION_WRONG;
    if (v && !visitor_may_guess(v, now)) {
        if (!v->logged)
            log_warning("%s: sent %g wrong tokens; tokens from there are ignored until it slows down",
                        visitor_name(v, name), VISITORS_GUESSES);
        v->logged = true;
        return ADMISSION_LATER;
    }
    if (is_same(given, wanted))
        return ADMISSION_RIGHT;
    atomic_fetch_add(&s->counts.wrong_tokens, 1);
    if (v)
        visitor_guessed_wrong(v, now);
    return ADMISSION_WRONG;
}

bool admission_copy(char **out, const char *text)
{
    const size_t size = strlen(text) + 1;

    *out = mem_alloc(size, 1);
    if (*out)
        memcpy(*out, text, size);
    return *out != NULL;
}

enum err admission_copy_token(const char *name, const char *token, char **out, struct reason *why)
{
    const size_t length = token ? strlen(token) : 1;

    *out = NULL;
    if (length < 1 || length > TOKEN_MAX)
        return err_say(why, ERR_USAGE, "--token-%s: a token has 1 to %d bytes, not %zu", name, TOKEN_MAX, length);
    if (token && !admission_copy(out, token))
        return err_say(why, ERR_NOMEM, "out of memory");
    return ERR_OK;
}
