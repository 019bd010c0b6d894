#include "sky/source/files.h"

#include "base/mem.h"

#include <errno.h>
#include <limits.h>
#include <poll.h>
#include <stdbool.h>
#include <string.h>
#include <sys/inotify.h>
#include <unistd.h>

/* A queued file is read later, complete by then, so it is not queued twice. */
static bool is_queued(const struct watch *w, const char *name)
{
    for (size_t i = w->queue.next; i < w->queue.count; i++) {
        const char *slash = strrchr(w->queue.items[i].path, '/');
        if (strcmp(slash ? slash + 1 : w->queue.items[i].path, name) == 0)
            return true;
    }
    return false;
}

static enum err take_event(struct watch *w, const struct inotify_event *event, struct reason *why)
{
    if (event->mask & IN_Q_OVERFLOW)
        return err_say(why, ERR_RANGE, "watch:%s: files arrived faster than they were read; some were missed", w->dir);
    if (event->mask & IN_IGNORED)
        w->gone = true;
    if (event->len == 0 || (event->mask & IN_ISDIR) || !files_is_frame_name(event->name) || is_queued(w, event->name))
        return ERR_OK;
    const enum err e = files_add(&w->queue, w->dir, event->name, w->number);
    if (e)
        return err_say(why, e, "watch:%s: out of memory for the name '%s'", w->dir, event->name);
    w->number++;
    return ERR_OK;
}

/* Reads all pending events without waiting. Returns the first error but still processes the remaining events. */
static enum err drain(struct watch *w, struct reason *why)
{
    _Alignas(struct inotify_event) char buffer[16 * (sizeof(struct inotify_event) + NAME_MAX + 1)];
    enum err first = ERR_OK;

    while (!w->gone) {
        const ssize_t n = read(w->fd, buffer, sizeof(buffer));
        if (n < 0 && errno == EINTR)
            continue;
        if (n <= 0)
            break; /* EAGAIN: no more events */
        for (size_t at = 0; at < (size_t)n;) {
            const struct inotify_event *event = (const void *)(buffer + at);
            const enum err e = take_event(w, event, first ? NULL : why);
            first = first ? first : e;
            at += sizeof(*event) + event->len;
        }
    }
    return first;
}

enum err watch_init(struct watch *w, const char *dir, struct reason *why)
{
    enum err e = ERR_OK;

    *w = (struct watch){ .fd = -1 };
    w->dir = mem_text(dir);
    if (!w->dir)
        return err_say(why, ERR_NOMEM, "watch:%s: out of memory for the name", dir);
    w->fd = inotify_init1(IN_CLOEXEC | IN_NONBLOCK);
    /* Watch before listing: a file that appears in between is seen twice and queued once, but never missed. */
    if (w->fd < 0 || inotify_add_watch(w->fd, dir, IN_CLOSE_WRITE | IN_MOVED_TO | IN_ONLYDIR) < 0)
        e = files_say_errno(why, dir, "cannot watch", errno);
    if (!e)
        e = files_from_folder(dir, &w->queue, why);
    w->number = w->queue.count;
    if (e)
        watch_finish(w);
    return e;
}

void watch_finish(struct watch *w)
{
    files_finish(&w->queue);
    if (w->dir && w->fd >= 0)
        close(w->fd);
    mem_free(w->dir);
    *w = (struct watch){ .fd = -1 };
}

enum err watch_next(struct watch *w, int timeout_ms, const struct file_item **out, struct reason *why)
{
    *out = NULL;
    enum err e = drain(w, why);
    if (e)
        return e;
    if (w->queue.next == w->queue.count) {
        files_finish(&w->queue); /* everything was read; start a new queue, so that a long watch does not grow */
        if (w->gone)
            return err_say(why, ERR_END, "watch:%s: the folder was removed", w->dir);
        poll(&(struct pollfd){ .fd = w->fd, .events = POLLIN }, 1, timeout_ms);
        e = drain(w, why);
    }
    if (!e && w->queue.next < w->queue.count)
        *out = &w->queue.items[w->queue.next++];
    return e;
}
