#include "address.h"

#include "relight_protocol.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char *after(const char *text, const char *start)
{
    const size_t n = strlen(start);
    return strncmp(text, start, n) == 0 ? text + n : NULL;
}

/* The port's digits, all of [text, end). */
static bool read_port(const char *text, const char *end, int *port)
{
    int v = 0;

    if (text == end || end - text > 5)
        return false;
    for (; text < end; text++) {
        if (*text < '0' || *text > '9')
            return false;
        v = 10 * v + (*text - '0');
    }
    *port = v;
    return v >= 1 && v <= 65535;
}

/* Splits [text, end) into host and port. */
static bool read_host(const char *text, const char *end, struct address *a)
{
    const bool six = *text == '[';
    const char *host = six ? text + 1 : text, *colon = NULL, *stop = NULL;

    if (six) {
        stop = memchr(host, ']', (size_t)(end - host));
        if (!stop)
            return false;
        colon = stop + 1 < end ? stop + 1 : NULL;
    } else {
        colon = memchr(host, ':', (size_t)(end - host));
        stop = colon ? colon : end;
    }
    if (stop == host || (size_t)(stop - host) >= sizeof(a->host))
        return false;
    for (const char *p = host; p < stop; p++) /* goes into a request's header */
        if (*p <= ' ' || *p > '~' || *p == '@')
            return false;
    memcpy(a->host, host, (size_t)(stop - host));
    if (colon && (*colon != ':' || !read_port(colon + 1, end, &a->port)))
        return false;
    snprintf(a->named, sizeof(a->named), six ? "[%s]:%d" : "%s:%d", a->host, a->port);
    return true;
}

enum err address_parse(const char *text, struct address *out, struct reason *why)
{
    const char *rest = after(text, "ws://");

    *out = (struct address){ .port = ADDRESS_PORT };
    if (!rest)
        rest = after(text, "http://");
    if (!rest && (after(text, "wss://") || after(text, "https://")))
        return err_say(why, ERR_USAGE, "%s: encrypted connections are not spoken here; a tunnel must do that", text);
    if (!rest)
        return err_say(why, ERR_USAGE, "%s: not of the form ws://HOST:PORT", text);
    const char *end = rest + strcspn(rest, "/");
    if (!read_host(rest, end, out))
        return err_say(why, ERR_USAGE, "%s: not of the form ws://HOST:PORT", text);
    const char *path = end[0] && end[1] ? end : PROTOCOL_PATH;
    for (const char *p = path; *p; p++)
        if (*p <= ' ' || *p > '~')
            return err_say(why, ERR_USAGE, "%s: a path has no blanks or control characters", text);
    if (strlen(path) >= sizeof(out->path))
        return err_say(why, ERR_USAGE, "%.200s...: the path is too long", text);
    snprintf(out->path, sizeof(out->path), "%s", path);
    return ERR_OK;
}
