#include "clients/common/connection.h"

#include "protocol/relight_protocol.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Both go into a request's header. */
static bool is_printable(const char *text, size_t size)
{
    while (size > 0 && *text > ' ' && *text <= '~')
        text++, size--;
    return size == 0;
}

/* Parses HOST[:PORT] after the scheme; returns its end, NULL if it is malformed. */
static const char *read_host(const char *text, struct address *a)
{
    const bool six = *text == '[';
    const char *host = text + six, *end = host + strcspn(host, six ? "]/@" : ":/@");
    const size_t size = (size_t)(end - host);

    if (size == 0 || size >= sizeof(a->host) || !is_printable(host, size) || (six && *end++ != ']'))
        return NULL;
    memcpy(a->host, host, size);
    if (*end == ':') {
        const size_t digits = strspn(++end, "0123456789");
        a->port = digits <= 5 ? atoi(end) : 0;
        end += digits;
    }
    const int shown = (int)strcspn(a->host, "%"); /* a zone means nothing to the server */
    snprintf(a->named, sizeof(a->named), six ? "[%.*s]:%d" : "%.*s:%d", shown, a->host, a->port);
    return (*end == '\0' || *end == '/') && a->port >= 1 && a->port <= 65535 ? end : NULL;
}

enum err address_parse(const char *text, struct address *out, struct reason *why)
{
    static const char *const schemes[] = { "ws://", "http://", "wss://", "https://" };
    const char *rest = NULL;

    *out = (struct address){ .tls = false };
    for (size_t i = 0; i < 4 && !rest; i++) {
        const size_t n = strlen(schemes[i]);
        out->tls = i >= 2;
        out->port = out->tls ? ADDRESS_TLS_PORT : ADDRESS_PORT;
        rest = strncmp(text, schemes[i], n) == 0 ? read_host(text + n, out) : NULL;
    }
    if (!rest)
        return err_say(why, ERR_USAGE, "%s: not of the form ws://HOST:PORT or, with TLS, wss://HOST:PORT", text);
    const size_t length = strlen(rest);
    const bool page = length == 0 || rest[length - 1] == '/'; /* below which the connection is */
    if (length + strlen(PROTOCOL_PATH) >= sizeof(out->path) || !is_printable(rest, length))
        return err_say(why, ERR_USAGE, "%.200s: the path is too long, or has blanks or control characters", text);
    snprintf(out->path, sizeof(out->path), "%.*s%s", (int)(length - (page && length > 0)), rest,
             page ? PROTOCOL_PATH : "");
    return ERR_OK;
}
