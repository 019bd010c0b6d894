#define _GNU_SOURCE /* memfd_create */
#include "import/reader/reader.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/progress.h"
#include "import/reader/files.h"
#include "import/reader/wire.h"
#include "import/sandbox/helper_process.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#define PROGRAM "relight-reader"

enum { SECONDS = 60, PATIENCE = 10 /* times the processor time */, LINES_MAX = 200 };

struct reading {
    const char *path;
    struct scene_reading reading;
    struct scene_files files;
    struct progress *progress;
    struct child child;
    int parcel; /* shared memory into which the process writes the scene */
    int64_t until_ms;
    unsigned lines; /* logged for the process */
    bool starved;   /* this process, not the one that reads, had no memory for a file */
    struct reason *why;
};

/* ---- What the process asks for ---- */

static void log_for(struct reading *r, const struct wire_message *m)
{
    struct log_site site = { 0 }; /* its own: lines of different kinds come through here */

    if (m->code < LOG_ERROR || m->code >= LOG_LEVELS || ++r->lines > LINES_MAX)
        return;
    log_line(&site, (enum log_level)m->code, "%s", m->text);
    if (r->lines == LINES_MAX)
        log_warning("%s: further messages are left out", r->path);
}

/* fd: to be sent along and closed; -1: none. False: the process is gone. */
static bool answer(struct reading *r, const struct wire_answer *a, int fd)
{
    union {
        struct cmsghdr head;
        char room[CMSG_SPACE(sizeof(int))];
    } control = { .room = { 0 } };
    struct iovec part = { (void *)a, sizeof(*a) };
    struct msghdr message = { .msg_iov = &part, .msg_iovlen = 1 };

    if (fd >= 0) {
        message.msg_control = control.room;
        message.msg_controllen = sizeof(control.room);
        struct cmsghdr *c = CMSG_FIRSTHDR(&message);
        c->cmsg_level = SOL_SOCKET;
        c->cmsg_type = SCM_RIGHTS;
        c->cmsg_len = CMSG_LEN(sizeof(int));
        memcpy(CMSG_DATA(c), &fd, sizeof(fd));
    }
    const bool sent = sendmsg(r->child.socket, &message, MSG_NOSIGNAL) == (ssize_t)sizeof(*a);
    if (fd >= 0)
        close(fd);
    return sent;
}

static bool serve(struct reading *r, const struct wire_message *m)
{
    struct wire_answer a = { .magic = WIRE_MAGIC };
    size_t size = 0;
    int fd = -1;

    if (m->kind == WIRE_ALLOW) {
        a.code = (int32_t)scene_files_allow(&r->files, m->text, &a.why);
    } else {
        a.code = (int32_t)scene_files_open(&r->files, m->text, &fd, &size, &a.why);
        fd = a.code ? -1 : fd;
        a.size = size;
    }
    r->starved |= a.code == ERR_NOMEM;
    return answer(r, &a, fd);
}

/* ---- How it ends ---- */

static enum err report_death(struct reading *r, enum child_receipt receipt)
{
    const int status = child_end(&r->child);
    char death[64];

    if (receipt == CHILD_SILENT || (WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU))
        return err_say(r->why, ERR_RANGE, "%s: took longer than %u s to be read", r->path, r->reading.seconds);
    if (WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL)
        return err_say(r->why, ERR_RANGE, "%s: " PROGRAM " was killed; the machine may be short of memory", r->path);
    return err_say(r->why, ERR_FORMAT, "%s: " PROGRAM " %s", r->path, child_death(status, death, sizeof(death)));
}

static enum err invalid(struct reading *r)
{
    child_end(&r->child);
    return err_say(r->why, ERR_FORMAT, "%s: " PROGRAM " sent an invalid answer", r->path);
}

static enum err finish(struct reading *r, const struct wire_message *m, struct scene **out)
{
    child_end(&r->child); /* nothing changes the parcel any more */
    switch (m->code) {
    case ERR_OK: return parcel_read(r->parcel, r->path, out, r->why);
    case ERR_NOMEM:
        return r->starved
                   ? err_say(r->why, ERR_NOMEM, "%s: out of memory", r->path)
                   : err_say(r->why, ERR_RANGE, "%s: needs more than %.4g GB of memory to be read (--max-scene-memory)",
                             r->path, (double)r->reading.memory_bytes / 1e9);
    case ERR_IO:
    case ERR_FORMAT:
    case ERR_RANGE:
    case ERR_UNSUPPORTED: return err_say(r->why, (enum err)m->code, "%s", m->text);
    default: return invalid(r);
    }
}

/* ---- The process ---- */

static enum err converse(struct reading *r, struct scene **out)
{
    struct wire_message m;

    for (;;) {
        const enum child_receipt receipt = child_receive(&r->child, &m, sizeof(m), r->until_ms, NULL);
        if (receipt != CHILD_RECEIVED)
            return receipt == CHILD_GARBLED ? invalid(r) : report_death(r, receipt);
        m.text[sizeof(m.text) - 1] = '\0';
        switch (m.kind) {
        case WIRE_OPEN:
        case WIRE_ALLOW:
            if (!serve(r, &m))
                return report_death(r, CHILD_GONE);
            break;
        case WIRE_STEP: progress_step(r->progress, 1); break;
        case WIRE_LOG: log_for(r, &m); break;
        case WIRE_DONE: return finish(r, &m, out);
        default: return invalid(r);
        }
    }
}

static enum err start(struct reading *r)
{
    char program[HOST_PATH_MAX], memory[24], seconds[24], time[32], textures[24];
    char *const arguments[] = { (char[]){ PROGRAM }, memory, seconds, time, textures, (char *)r->path, NULL };

    r->parcel = memfd_create("relight-scene", MFD_CLOEXEC);
    if (r->parcel < 0)
        return err_say(r->why, ERR_IO, "%s: cannot share memory with " PROGRAM ": %s", r->path, strerror(errno));
    const enum err e = child_find(PROGRAM, r->reading.program, program, sizeof(program), r->why);
    if (e)
        return e;
    snprintf(memory, sizeof(memory), "%" PRIu64, r->reading.memory_bytes);
    snprintf(seconds, sizeof(seconds), "%u", r->reading.seconds);
    snprintf(textures, sizeof(textures), "%" PRIu64, r->reading.texture_bytes);
    snprintf(time, sizeof(time), "%.17g", r->reading.animate ? r->reading.time : (double)NAN);
    r->until_ms = clock_ms() + INT64_C(1000) * PATIENCE * r->reading.seconds;
    return child_start(&r->child, program, arguments, &r->parcel, 1, r->until_ms, NULL, r->why);
}

static enum err refuse_change(const struct reading *r, enum err e, struct scene **out)
{
    struct reason changed;

    if (!scene_files_check(&r->files, &changed))
        return e;
    scene_destroy(*out);
    *out = NULL;
    return err_say(r->why, ERR_IO, "%s", changed.text);
}

enum err scene_load(const char *path, const struct scene_reading *reading, struct scene **out,
                    struct progress *progress, struct reason *why)
{
    struct reading r = { .path = path, .progress = progress, .parcel = -1, .why = why };

    *out = NULL;
    if (strlen(path) >= HOST_PATH_MAX)
        return err_say(why, ERR_RANGE, "%.100s...: the path is too long", path);
    if (reading)
        r.reading = *reading;
    r.reading.memory_bytes = r.reading.memory_bytes ? r.reading.memory_bytes : SCENE_MEMORY_DEFAULT;
    r.reading.texture_bytes = r.reading.texture_bytes ? r.reading.texture_bytes : SCENE_TEXTURES_DEFAULT;
    r.reading.seconds = r.reading.seconds ? r.reading.seconds : SECONDS;
    enum err e = scene_files_init(&r.files, path, r.reading.memory_bytes);
    if (!e)
        e = start(&r);
    if (!e && r.child.unconfined)
        log_warning("%s: read with limits on memory and time only: this kernel has no seccomp (%s)", path,
                    strerror(r.child.unconfined));
    if (!e)
        e = converse(&r, out);
    child_end(&r.child);
    if (!e || e == ERR_FORMAT || e == ERR_IO) /* what is wrong with a file may come from a change, too */
        e = refuse_change(&r, e, out);
    if (r.parcel >= 0)
        close(r.parcel);
    scene_files_finish(&r.files);
    if (e == ERR_NOMEM)
        err_say(why, e, "%s: out of memory", path);
    return e;
}
