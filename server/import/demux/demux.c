#include "import/demux/demux.h"

#include "base/clock.h"
#include "base/mem.h"
#include "image/codec/decode.h"
#include "import/demux/internal.h"
#include "import/sandbox/helper_process.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#define PROGRAM "relight-demux"
#define MEMORY_BYTES ((size_t)256 << 20) /* address space for a packet; a raw image of 8K with 16 bits has 200 MB */
#define PATIENCE_MS 15000

struct demux {
    char name[256];
    struct child child;
    struct child_memory packet;
    uint32_t timeout_ms;
    const atomic_bool *stop;
    bool requested;            /* a packet was requested and has not come yet */
    int64_t until_ms;          /* deadline of that request */
    struct demux_answer first; /* the format, which demux_open has received */
    bool has_first;
};

/* ---- Specs ---- */

static bool starts_with(const char *text, const char *start)
{
    return strncasecmp(text, start, strlen(start)) == 0;
}

static bool ends_as_video(const char *spec)
{
    static const char *const ends[] = { "mp4", "mkv", "mov", "webm", "m4v", "ts", "m2ts", "avi", "flv", "ivf", "mxf" };
    const char *dot = strrchr(spec, '.');

    for (size_t i = 0; dot && i < sizeof(ends) / sizeof(ends[0]); i++)
        if (strcasecmp(dot + 1, ends[i]) == 0)
            return true;
    return false;
}

/* Length of the scheme of a URL, before "://", or 0. */
static size_t scheme_length(const char *spec)
{
    const size_t n = strspn(spec, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789+.-");

    return n > 0 && strncmp(spec + n, "://", 3) == 0 ? n : 0;
}

/* Checks a camera's name without opening it; one that is not there may be plugged in later. */
static enum err check_device(const char *spec, struct reason *why)
{
    struct stat st;

    if (spec[5] != '/')
        return err_say(why, ERR_USAGE, "%s: expected v4l2:/dev/videoN", spec);
    if (stat(spec + 5, &st) == 0 && !S_ISCHR(st.st_mode))
        return err_say(why, ERR_USAGE, "%s: is not a camera; expected v4l2:/dev/videoN", spec);
    return ERR_OK;
}

/* Finds faults of a URL that do not depend on the network. */
static enum err check_url(const char *spec, struct reason *why)
{
    char name[256];
    const char *host = strstr(demux_name(spec, name, sizeof(name)), "://") + 3;
    const size_t length = strcspn(host, "/?#");

    if (length == 0 || (host[0] == ':' && !starts_with(name, "srt://"))) /* srt://:9000?mode=listener has none */
        return err_say(why, ERR_USAGE, "%s: the host is missing; expected %.*s://HOST...", name,
                       (int)scheme_length(name), name);
    if (starts_with(name, "srt://") && host[length - 1] != ']' && !memchr(host, ':', length))
        return err_say(why, ERR_USAGE, "%s: the port is missing; expected srt://HOST:PORT", name);
    return ERR_OK;
}

enum err demux_kind_of(const char *spec, enum demux_kind *out, struct reason *why)
{
    static const char *const live[] = { "rtsp://", "rtsps://", "rtmp://", "rtmps://", "srt://" };
    const size_t scheme = scheme_length(spec);
    struct stat st;

    *out = DEMUX_NOTHING;
    if (starts_with(spec, "v4l2:")) {
        *out = DEMUX_DEVICE;
        return check_device(spec, why);
    }
    if (starts_with(spec, "/dev/video"))
        return err_say(why, ERR_USAGE, "%s: a camera is named v4l2:%s", spec, spec);
    if (starts_with(spec, "file://"))
        return err_say(why, ERR_USAGE, "%s: name files without file://, as %s", spec, spec + strlen("file://"));
    if (starts_with(spec, "http://") || starts_with(spec, "https://"))
        *out = DEMUX_WEB;
    for (size_t i = 0; i < sizeof(live) / sizeof(live[0]); i++)
        if (starts_with(spec, live[i]))
            *out = DEMUX_LIVE;
    if (scheme && *out == DEMUX_NOTHING)
        return err_say(why, ERR_USAGE,
                       "%.120s: %.*s:// is not a source; sources are " DEMUX_SCHEMES
                       ", files, folders, patterns, watch:DIR and sky:",
                       spec, (int)(scheme < 20 ? scheme : 20), spec);
    if (scheme)
        return check_url(spec, why);
    if (ends_as_video(spec) && stat(spec, &st) == 0 && S_ISREG(st.st_mode))
        *out = DEMUX_FILE;
    return ERR_OK;
}

const char *demux_name(const char *spec, char *out, size_t size)
{
    const size_t scheme = scheme_length(spec);
    const char *host = scheme ? spec + scheme + 3 : spec, *at = NULL;

    for (const char *p = host; scheme && *p && *p != '/' && *p != '?'; p++)
        if (*p == '@')
            at = p;
    if (at)
        snprintf(out, size, "%.*s%s", (int)(host - spec), spec, at + 1);
    else
        snprintf(out, size, "%s", spec);
    return out;
}

/* ---- The process ---- */

static enum err open_input(const char *path, int *fd, struct reason *why)
{
    struct stat st;

    *fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (*fd < 0 || fstat(*fd, &st) != 0)
        return err_say(why, ERR_IO, "%s: cannot open: %s", path, strerror(errno));
    if (!S_ISREG(st.st_mode) || st.st_size <= 0)
        return err_say(why, ERR_IO, "%s: %s", path, S_ISREG(st.st_mode) ? "is empty" : "is not a regular file");
    return ERR_OK;
}

static enum err start(struct demux *d, const struct demux_desc *desc, bool is_file, struct reason *why)
{
    char program[4096], memory[24], kind[8], ca[4096];
    char *const arguments[] = { (char[]){ PROGRAM }, memory, kind, ca, NULL };
    int input = -1;

    snprintf(memory, sizeof(memory), "%zu", MEMORY_BYTES);
    snprintf(kind, sizeof(kind), "%s", is_file ? "file" : starts_with(desc->spec, "v4l2:") ? "device" : "url");
    snprintf(ca, sizeof(ca), "%s", desc->ca ? desc->ca : "");
    enum err e = child_find(PROGRAM, desc->program, program, sizeof(program), why);
    if (!e && is_file)
        e = open_input(desc->spec, &input, why);
    const int descriptors[] = { d->packet.fd, input }; /* in the order of internal.h */
    if (!e)
        e = child_start(&d->child, program, arguments, descriptors, is_file ? 2 : 1, clock_ms() + d->timeout_ms,
                        d->stop, why);
    if (input >= 0)
        close(input);
    return e;
}

static bool send_request(struct demux *d, const struct demux_request *q)
{
    d->until_ms = clock_ms() + d->timeout_ms;
    return child_send(&d->child, q, sizeof(*q));
}

/* Receives an answer to the last request until the time given. On ERR_OK it is valid. */
static enum err receive(struct demux *d, int64_t until_ms, struct demux_answer *a, bool *quiet, struct reason *why)
{
    char text[sizeof(a->why.text)], death[64];

    *quiet = false;
    const int64_t end_ms = until_ms < d->until_ms ? until_ms : d->until_ms;
    switch (child_receive(&d->child, a, sizeof(*a), end_ms, d->stop)) {
    case CHILD_RECEIVED: break;
    case CHILD_STOPPED: return ERR_END;
    case CHILD_SILENT:
        *quiet = clock_ms() < d->until_ms;
        return *quiet ? ERR_OK : err_say(why, ERR_IO, "%s: nothing came for %g s", d->name, d->timeout_ms / 1e3);
    case CHILD_GONE:
        return err_say(why, ERR_FORMAT, "%s: " PROGRAM " %s", d->name,
                       child_death(child_end(&d->child), death, sizeof(death)));
    case CHILD_GARBLED: a->result = -1; break;
    }
    if (a->result < ERR_OK || a->result > ERR_END || a->size > MEMORY_BYTES)
        return err_say(why, ERR_FORMAT, "%s: " PROGRAM " is from another version", d->name);
    if (a->result == ERR_OK || a->result == ERR_END)
        return (enum err)a->result;
    return err_say(why, (enum err)a->result, "%s: %s", d->name,
                   decode_printable(a->why.text, sizeof(a->why.text), text, sizeof(text)));
}

/* ---- Opening ---- */

/* Sanitises an untrusted process's description of the stream. */
static void check_format(struct stream_format *f)
{
    char text[sizeof(f->note)];

    snprintf(f->codec_name, sizeof(f->codec_name), "%s",
             decode_printable(f->codec_name, sizeof(f->codec_name), text, sizeof(f->codec_name)));
    snprintf(f->note, sizeof(f->note), "%s", decode_printable(f->note, sizeof(f->note), text, sizeof(text)));
    if (!(f->rate > 0.0 && f->rate < 1e12))
        f->rate = 0.0;
    if (f->layout > LAYOUT_LAST)
        f->layout = LAYOUT_AUTO;
    if (!(f->aspect > 0.0f && f->aspect < 100.0f))
        f->aspect = 0.0f;
}

static enum err ask_open(struct demux *d, const char *url, struct reason *why)
{
    struct demux_request q = { .magic = WIRE_MAGIC, .ask = DEMUX_ASK_OPEN };
    bool quiet = true;
    enum err e = ERR_OK;

    if (strlen(url) >= sizeof(q.url))
        return err_say(why, ERR_USAGE, "%s: the URL is longer than %zu characters", d->name, sizeof(q.url) - 1);
    memcpy(q.url, url, strlen(url) + 1);
    if (!send_request(d, &q))
        return err_say(why, ERR_IO, "%s: " PROGRAM " ended before its first request", d->name);
    while (!e && quiet)
        e = receive(d, d->until_ms, &d->first, &quiet, why);
    if (!e && d->first.kind != DEMUX_FORMAT)
        e = err_say(why, ERR_FORMAT, "%s: " PROGRAM " sent an invalid answer", d->name);
    d->has_first = !e;
    return e;
}

/* libavformat's RTSP does not hand options on to its TLS. */
static enum err check_trust(const char *spec, const char *ca, struct reason *why)
{
    const bool any = ca && strcmp(ca, DEMUX_ANY_CA) == 0;
    char name[200];

    if (!any && starts_with(spec, "rtsps://"))
        return err_say(why, ERR_UNSUPPORTED,
                       "%s: libavformat cannot verify the certificate of an rtsps:// source; in a network that you "
                       "trust, accept any with --source-ca " DEMUX_ANY_CA,
                       demux_name(spec, name, sizeof(name)));
    if (ca && !any && access(ca, R_OK) != 0)
        return err_say(why, ERR_USAGE, "--source-ca %s: cannot be read: %s", ca, strerror(errno));
    return ERR_OK;
}

bool demux_available(void)
{
#ifdef RELIGHT_VIDEO
    return true;
#else
    return false;
#endif
}

enum err demux_check(const char *spec, const char *ca, struct reason *why)
{
#ifdef RELIGHT_VIDEO
    return check_trust(spec, ca, why);
#else
    char name[200];

    (void)check_trust;
    (void)ca;
    return err_say(why, ERR_UNSUPPORTED, "%s: this build reads no video; that needs libavformat-dev when it is built",
                   demux_name(spec, name, sizeof(name)));
#endif
}

enum err demux_open(const struct demux_desc *desc, struct demux **out, struct reason *why)
{
    enum demux_kind kind;

    *out = NULL;
    enum err e = demux_check(desc->spec, desc->ca, why);
    if (!e)
        e = demux_kind_of(desc->spec, &kind, why);
    struct demux *d = e ? NULL : mem_alloc(1, sizeof(*d));
    if (!d)
        return e ? e : err_say(why, ERR_NOMEM, "out of memory");
    d->packet.fd = -1;
    d->timeout_ms = desc->timeout_ms ? desc->timeout_ms : PATIENCE_MS;
    d->stop = desc->stop;
    demux_name(desc->spec, d->name, sizeof(d->name));
    e = child_share(&d->packet, "relight-packet", PROGRAM, MEMORY_BYTES, PROT_READ, why);
    if (!e)
        e = start(d, desc, kind == DEMUX_FILE, why);
    if (!e)
        e = ask_open(d, kind == DEMUX_FILE ? "" : kind == DEMUX_DEVICE ? desc->spec + 5 : desc->spec, why);
    if (e) {
        demux_close(d);
        return e;
    }
    *out = d;
    return ERR_OK;
}

void demux_close(struct demux *d)
{
    if (!d)
        return;
    child_end(&d->child);
    child_unshare(&d->packet);
    mem_free(d);
}

/* ---- Packets ---- */

enum err demux_next(struct demux *d, int wait_ms, struct demux_item *out, struct reason *why)
{
    struct demux_answer a;
    bool quiet = false;

    *out = (struct demux_item){ .event = DEMUX_QUIET };
    if (d->has_first) {
        a = d->first;
        d->has_first = false;
    } else {
        const struct demux_request q = { .magic = WIRE_MAGIC, .ask = DEMUX_ASK_NEXT };
        if (!d->requested && !send_request(d, &q))
            return err_say(why, ERR_IO, "%s: " PROGRAM " has ended", d->name);
        d->requested = true;
        const enum err e = receive(d, clock_ms() + wait_ms, &a, &quiet, why);
        d->requested = quiet;
        if (e || quiet)
            return e;
    }
    if (a.kind != DEMUX_FORMAT && a.kind != DEMUX_PACKET)
        return err_say(why, ERR_FORMAT, "%s: " PROGRAM " sent an invalid answer", d->name);
    if (a.kind == DEMUX_FORMAT)
        check_format(&a.format);
    *out = (struct demux_item){
        (enum demux_event)a.kind, a.format, d->packet.at, a.size, a.time_us, a.key == 1, a.hidden == 1
    };
    return ERR_OK;
}

enum err demux_seek(struct demux *d, int64_t time_us, struct reason *why)
{
    const struct demux_request q = { .magic = WIRE_MAGIC, .ask = DEMUX_ASK_SEEK, .time_us = time_us };
    struct demux_answer a;
    bool quiet = true;
    enum err e = ERR_OK;

    if (!send_request(d, &q))
        return err_say(why, ERR_IO, "%s: " PROGRAM " has ended", d->name);
    while (!e && quiet)
        e = receive(d, d->until_ms, &a, &quiet, why);
    return e;
}
