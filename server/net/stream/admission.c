#include "net/stream/internal.h"

#include "base/mem.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <string.h>
#include <strings.h>
#include <sys/socket.h>

#define TOKEN_MAX 255 /* bytes, as in PROTOCOL.md 4.1.3 */

struct visitor *admission_peer(struct server *s, struct lws *wsi)
{
    struct sockaddr_storage from = { 0 };
    socklen_t size = sizeof(from);

    if (getpeername(lws_get_socket_fd(wsi), (struct sockaddr *)&from, &size) != 0)
        return NULL;
    return visitors_find(&s->visitors, (const struct sockaddr *)&from, viewer_now_us());
}

/* Whether the other end is the configured proxy; by default 127.0.0.1 or ::1, and no other local address. */
static bool is_proxy(const struct server *s, struct lws *wsi)
{
    struct sockaddr_storage from = { 0 };
    const struct sockaddr_in *four = (const struct sockaddr_in *)&from;
    const struct sockaddr_in6 *six = (const struct sockaddr_in6 *)&from;
    socklen_t size = sizeof(from);
    char address[INET6_ADDRSTRLEN] = "", mapped[INET6_ADDRSTRLEN] = "";

    if (getpeername(lws_get_socket_fd(wsi), (struct sockaddr *)&from, &size) != 0)
        return false;
    if (from.ss_family == AF_INET)
        inet_ntop(AF_INET, &four->sin_addr, address, sizeof(address));
    else if (from.ss_family == AF_INET6)
        inet_ntop(AF_INET6, &six->sin6_addr, address, sizeof(address));
    if (from.ss_family == AF_INET6 && IN6_IS_ADDR_V4MAPPED(&six->sin6_addr))
        inet_ntop(AF_INET, six->sin6_addr.s6_addr + 12, mapped, sizeof(mapped));
    const char *name = mapped[0] ? mapped : address;
    return s->proxy[0] ? strcmp(name, s->proxy) == 0 : strcmp(name, "127.0.0.1") == 0 || strcmp(name, "::1") == 0;
}

bool admission_forwarded(struct server *s, struct lws *wsi)
{
    struct guest *g = guest_of(wsi); /* of the proxy, or of the client of the previous request */
    char header[1024], address[VISITOR_NAME];

    if (!s->behind_proxy || !g || lws_hdr_total_length(wsi, WSI_TOKEN_X_FORWARDED_FOR) == 0)
        return true;
    if (!is_proxy(s, wsi))
        return true;
    if (lws_hdr_copy(wsi, header, sizeof(header), WSI_TOKEN_X_FORWARDED_FOR) <= 0)
        return false;
    struct visitor *v = visitors_forwarded(&s->visitors, header, viewer_now_us(), address, sizeof(address));
    if (!v)
        return false;
    guest_move(g, v);
    return true;
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
    const struct guest *g = guest_of(wsi);
    struct visitor *v = g ? g->visitor : NULL;

    if (!given[0]) /* an empty token is no guess */
        return ADMISSION_WRONG;
    if (v && !visitor_may_guess(&s->visitors, v, now)) {
        limit_reached(s, LIMIT_GUESSES, v);
        return ADMISSION_LATER;
    }
    if (is_same(given, wanted)) {
        if (v)
            v->known = true;
        return ADMISSION_RIGHT;
    }
    atomic_fetch_add(&s->counts.wrong_tokens, 1);
    if (v)
        visitor_guessed_wrong(&s->visitors, v, now);
    return ADMISSION_WRONG;
}

enum admission admission_header(struct server *s, struct lws *wsi, const char *wanted)
{
    char given[512], pair[512];

    if (!wanted)
        return ADMISSION_RIGHT;
    if (lws_hdr_copy(wsi, given, sizeof(given), WSI_TOKEN_HTTP_AUTHORIZATION) <= 0)
        return ADMISSION_WRONG;
    if (strncasecmp(given, "Bearer ", 7) == 0)
        return admission_token(s, wsi, given + 7, wanted);
    const int size =
        strncasecmp(given, "Basic ", 6) == 0 ? lws_b64_decode_string(given + 6, pair, sizeof(pair) - 1) : 0;
    if (size <= 0)
        return ADMISSION_WRONG;
    pair[size] = '\0';
    const char *colon = strchr(pair, ':'); /* the user may have any name [RFC 7617, 2] */
    return colon ? admission_token(s, wsi, colon + 1, wanted) : ADMISSION_WRONG;
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
