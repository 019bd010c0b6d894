#include "net/publish/publish.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define FILE_MINUTES 10.0 /* default and range of record:DIR?minutes= */
#define MINUTES_LEAST 0.05
#define MINUTES_MOST 1440.0

static const struct {
    const char *prefix;
    enum publish_kind kind;
} schemes[] = {
    { "rtmp://", PUBLISH_RTMP }, { "rtsp://", PUBLISH_RTSP },   { "srt://", PUBLISH_SRT },
    { "hls:", PUBLISH_HLS },     { "record:", PUBLISH_RECORD },
};
#define SCHEMES (sizeof(schemes) / sizeof(schemes[0]))

/* The scheme alone of what is no target: the rest may hold a key. */
static enum err say_unknown(const char *url, struct reason *why)
{
    const size_t length = strcspn(url, ":/?@");
    static const char right[] = "rtmp://HOST/APP/STREAM, rtsp://HOST/PATH, srt://HOST:PORT, hls:DIR or record:DIR";

    if (url[length] != ':' || length == 0 || length > 16)
        return err_say(why, ERR_USAGE, "--publish needs %s", right);
    return err_say(why, ERR_USAGE, "--publish does not know '%.*s:'; it needs %s", (int)length, url, right);
}

/* What follows scheme://, up to the path or query, without user and password. */
static const char *find_host(const char *url, size_t *length)
{
    const char *begin = strstr(url, "://") + 3;
    const char *end = begin + strcspn(begin, "/?");

    for (const char *p = begin; p < end; p++)
        if (*p == '@')
            begin = p + 1;
    *length = (size_t)(end - begin);
    return begin;
}

/* Whether HOST:PORT ends with a port. */
static bool has_port(const char *host, size_t length)
{
    size_t digits = 0;

    while (digits < length && host[length - 1 - digits] >= '0' && host[length - 1 - digits] <= '9')
        digits++;
    return digits > 0 && digits < length && host[length - 1 - digits] == ':';
}

static bool has_query(const char *url, const char *pair)
{
    const size_t length = strlen(pair);

    for (const char *p = strchr(url, '?'); p; p = strchr(p, '&')) {
        p++;
        if (strncmp(p, pair, length) == 0 && (p[length] == '\0' || p[length] == '&'))
            return true;
    }
    return false;
}

static enum err parse_network(const char *prefix, struct publish_target *out, struct reason *why)
{
    size_t length;
    const char *host = find_host(out->url, &length), *path = host + length;
    const bool srt = out->kind == PUBLISH_SRT;

    out->listens = srt && has_query(out->url, "mode=listener");
    snprintf(out->name, sizeof(out->name), "%s%.*s", prefix, (int)length, host);
    if (length == 0 || (host[0] == ':' && !out->listens))
        return err_say(why, ERR_USAGE, "--publish %s: names no host", out->name);
    if (srt && !has_port(host, length))
        return err_say(why, ERR_USAGE, "--publish %s: names no port; SRT needs srt://HOST:PORT", out->name);
    if (!srt && (path[0] != '/' || !path[1] || path[1] == '?'))
        return err_say(why, ERR_USAGE, "--publish %s: names no stream; %s", out->name,
                       out->kind == PUBLISH_RTMP ? "RTMP needs rtmp://HOST/APP/STREAM" : "RTSP needs rtsp://HOST/PATH");
    return ERR_OK;
}

static enum err parse_folder(const char *prefix, struct publish_target *out, struct reason *why)
{
    static const char key[] = "?minutes=";
    const char *folder = out->url + strlen(prefix), *query = NULL;
    size_t length = strlen(folder);

    out->file_s = 60.0 * FILE_MINUTES;
    if (out->kind == PUBLISH_RECORD)
        query = strstr(folder, key);
    if (query) {
        const char *text = query + strlen(key);
        char *end;
        const double minutes = strtod(text, &end);
        if (end == text || *end || !(minutes >= MINUTES_LEAST && minutes <= MINUTES_MOST))
            return err_say(why, ERR_USAGE, "--publish record: 'minutes=%.40s' is not a number from %g to %g", text,
                           MINUTES_LEAST, MINUTES_MOST);
        out->file_s = 60.0 * minutes;
        length = (size_t)(query - folder);
    }
    while (length > 1 && folder[length - 1] == '/')
        length--;
    if (length == 0)
        return err_say(why, ERR_USAGE, "--publish %s names no folder; it needs %sDIR", prefix, prefix);
    if (length >= sizeof(out->folder))
        return err_say(why, ERR_USAGE, "--publish %s%.60s...: the path exceeds %zu bytes", prefix, folder,
                       sizeof(out->folder) - 1);
    snprintf(out->folder, sizeof(out->folder), "%.*s", (int)length, folder);
    snprintf(out->name, sizeof(out->name), "%s%.*s", prefix, (int)sizeof(out->name) - 16, out->folder);
    return ERR_OK;
}

/* The bytes of the UTF-8 character at p [RFC 3629, 4]; 0: there is none. */
static int character(const unsigned char *p)
{
    const int more = p[0] < 0x80 ? 0 : p[0] >= 0xc2 && p[0] < 0xe0 ? 1 : (p[0] & 0xf0) == 0xe0 ? 2 : 3;
    const bool overlong = (p[0] == 0xe0 && p[1] < 0xa0) || (p[0] == 0xf0 && p[1] < 0x90),
               beyond = (p[0] == 0xed && p[1] > 0x9f) || (p[0] == 0xf4 && p[1] > 0x8f);

    if ((p[0] >= 0x80 && p[0] < 0xc2) || p[0] > 0xf4 || overlong || beyond)
        return 0;
    for (int i = 1; i <= more; i++)
        if ((p[i] & 0xc0) != 0x80) /* the end, too */
            return 0;
    return 1 + more;
}

/* The name is a label of /metrics and a string in JSON. */
static void make_plain(char *name)
{
    while (*name) {
        const int length = character((const unsigned char *)name);
        if (length == 0 || *name == '"' || *name == '\\' || (length == 1 && (*name < ' ' || *name == 0x7f)))
            *name = '?';
        name += length > 0 ? length : 1;
    }
}

enum err publish_target_parse(const char *url, struct publish_target *out, struct reason *why)
{
    for (size_t i = 0; i < SCHEMES; i++) {
        const char *prefix = schemes[i].prefix;
        if (strncmp(url, prefix, strlen(prefix)) != 0)
            continue;
        *out = (struct publish_target){ .kind = schemes[i].kind, .url = url };
        const enum err e =
            schemes[i].kind >= PUBLISH_HLS ? parse_folder(prefix, out, why) : parse_network(prefix, out, why);
        make_plain(out->name);
        return e;
    }
    return say_unknown(url, why);
}

enum err publish_target_check(const struct publish_target *target, struct reason *why)
{
    char path[PUBLISH_PATH];

    if (target->kind < PUBLISH_HLS)
        return ERR_OK;
    snprintf(path, sizeof(path), "%s", target->folder);
    while (access(path, F_OK) != 0 && errno == ENOENT) { /* missing ones are created */
        char *slash = strrchr(path, '/');
        if (slash == path || !slash)
            snprintf(path, sizeof(path), slash ? "/" : ".");
        else
            *slash = '\0';
    }
    if (access(path, W_OK | X_OK) == 0)
        return ERR_OK;
    return err_say(why, ERR_IO, "--publish %s: %s cannot be written to: %s", target->name, path, strerror(errno));
}
