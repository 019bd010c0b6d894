#include "sky/source/files.h"

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"

#include <dirent.h>
#include <errno.h>
#include <limits.h>
#include <poll.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/inotify.h>
#include <sys/stat.h>
#include <unistd.h>

#define LIST_MS 1000  /* between two listings of the folder, */
#define LIST_SHARE 50 /* or this many times as long as one takes */

/* A file as a listing saw it. */
struct watch_known {
    char *name; /* owned */
    int64_t size, changed_ns;
    ino_t inode;
    bool pending; /* new or different, and not yet seen to stay so */
};

struct watch_event {
    char *name;   /* owned */
    bool writing; /* it is not complete yet */
    int absent;   /* listings in a row without it */
};

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

static enum err queue(struct watch *w, const char *name, struct reason *why)
{
    if (is_queued(w, name))
        return ERR_OK;
    const enum err e = files_add(&w->queue, w->dir, name, w->number);
    if (e)
        return err_say(why, e, "watch:%s: out of memory for the name '%s'", w->dir, name);
    w->number++;
    return ERR_OK;
}

static void pass_over(struct watch *w, const char *name)
{
    if (w->told_other || !files_is_other_image(name))
        return;
    log_warning("watch:%s: %.100s is passed over: only .exr and .hdr files are watched", w->dir, name);
    w->told_other = true;
}

/* ---- Events ---- */

static struct watch_event *find_event(const struct watch *w, const char *name)
{
    for (size_t i = 0; i < w->event_count; i++)
        if (strcmp(w->events[i].name, name) == 0)
            return &w->events[i];
    return NULL;
}

/* From now on, listings leave the file to its events. Without memory they do not. */
static void note_event(struct watch *w, const char *name, bool writing)
{
    struct watch_event *e = find_event(w, name);

    if (!e && mem_reserve(&w->events, w->event_count, &w->event_room, sizeof(*w->events))) {
        e = &w->events[w->event_count];
        e->name = mem_text(name);
        w->event_count += e->name != NULL;
    }
    if (e) {
        e->writing = writing;
        e->absent = 0;
    }
}

/* A link is complete when it appears; what is created is not. */
static bool is_link(const struct watch *w, const char *name)
{
    char path[PATH_MAX];
    struct stat st;

    return snprintf(path, sizeof(path), "%s/%s", w->dir, name) < (int)sizeof(path) && lstat(path, &st) == 0 &&
           (S_ISLNK(st.st_mode) || st.st_nlink > 1);
}

static enum err take_event(struct watch *w, const struct inotify_event *event, struct reason *why)
{
    if (event->mask & IN_Q_OVERFLOW)
        return err_say(why, ERR_RANGE, "watch:%s: files arrived faster than they were read; some were missed", w->dir);
    if (event->mask & IN_IGNORED)
        w->gone = true;
    if (event->len == 0 || (event->mask & IN_ISDIR))
        return ERR_OK;
    if (!files_is_frame_name(event->name)) {
        pass_over(w, event->name);
        return ERR_OK;
    }
    const bool complete =
        (event->mask & (IN_CLOSE_WRITE | IN_MOVED_TO)) || ((event->mask & IN_CREATE) && is_link(w, event->name));
    note_event(w, event->name, !complete);
    return complete ? queue(w, event->name, why) : ERR_OK;
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

/* ---- Listings ---- */

static void forget_known(struct watch_known *known, size_t count)
{
    for (size_t i = 0; i < count; i++)
        mem_free(known[i].name);
    mem_free(known);
}

static int by_name(const void *a, const void *b)
{
    return files_compare(((const struct watch_known *)a)->name, ((const struct watch_known *)b)->name);
}

/* All frames in the folder, by name. False: it cannot be listed now. */
static bool list(struct watch *w, struct watch_known **out, size_t *count)
{
    size_t room = 0;
    bool whole = true;
    DIR *d = opendir(w->dir);

    *out = NULL;
    *count = 0;
    if (!d)
        return false;
    for (const struct dirent *entry = readdir(d); entry && whole; entry = readdir(d)) {
        struct stat st;
        if (!files_is_frame_name(entry->d_name)) {
            pass_over(w, entry->d_name);
            continue;
        }
        if (fstatat(dirfd(d), entry->d_name, &st, 0) != 0 || !S_ISREG(st.st_mode))
            continue;
        whole = mem_reserve(out, *count, &room, sizeof(**out));
        if (!whole)
            break;
        struct watch_known *k = &(*out)[*count];
        *k = (struct watch_known){ mem_text(entry->d_name), st.st_size,
                                   st.st_mtim.tv_sec * INT64_C(1000000000) + st.st_mtim.tv_nsec, st.st_ino, false };
        whole = k->name != NULL;
        *count += whole;
    }
    closedir(d);
    if (whole && *count > 1)
        qsort(*out, *count, sizeof(**out), by_name);
    return whole;
}

/* What the last listing knows of the file; *at is where the search begins and where it ended, since both are sorted. */
static const struct watch_known *find_known(const struct watch *w, const char *name, size_t *at)
{
    while (*at < w->known_count && files_compare(w->known[*at].name, name) < 0)
        ++*at;
    return *at < w->known_count && strcmp(w->known[*at].name, name) == 0 ? &w->known[*at] : NULL;
}

static bool is_same(const struct watch_known *a, const struct watch_known *b)
{
    return a->size == b->size && a->changed_ns == b->changed_ns && a->inode == b->inode;
}

/* Forgets events that this listing has seen the end of, and files that were removed while they were written: one may
 * have been created since the listing. */
static void keep_writing(struct watch *w, const struct watch_known *now, size_t count)
{
    size_t kept = 0;

    for (size_t i = 0; i < w->event_count; i++) {
        struct watch_event *e = &w->events[i];
        const struct watch_known key = { .name = e->name };
        e->absent = count > 0 && bsearch(&key, now, count, sizeof(*now), by_name) ? 0 : e->absent + 1;
        if (e->writing && e->absent < 2)
            w->events[kept++] = *e;
        else
            mem_free(e->name);
    }
    w->event_count = kept;
}

/* Queues what came without an event. */
static enum err compare(struct watch *w, struct watch_known *now, size_t count, struct reason *why)
{
    enum err first = ERR_OK;
    size_t at = 0;

    for (size_t i = 0; i < count; i++) {
        const struct watch_known *before = find_known(w, now[i].name, &at);
        const bool same = before && is_same(before, &now[i]);
        if (find_event(w, now[i].name) || (same && !before->pending))
            continue;
        if (!same || now[i].size == 0) {
            now[i].pending = true;
            continue;
        }
        const enum err e = queue(w, now[i].name, first ? NULL : why);
        first = first ? first : e;
    }
    return first;
}

static enum err look(struct watch *w, struct reason *why)
{
    const int64_t start = clock_ms();
    struct watch_known *now = NULL;
    size_t count = 0;

    if (w->gone || start < w->list_ms)
        return ERR_OK;
    const bool whole = list(w, &now, &count);
    enum err e = drain(w, why); /* of what was listed, all local events are here now */
    if (whole && !e) {
        e = compare(w, now, count, why);
        keep_writing(w, now, count);
        forget_known(w->known, w->known_count);
        w->known = now;
        w->known_count = count;
    } else {
        forget_known(now, count);
    }
    const int64_t end = clock_ms(), took = LIST_SHARE * (end - start);
    w->list_ms = end + (took > LIST_MS ? took : LIST_MS);
    return e;
}

/* ---- The watch ---- */

enum err watch_init(struct watch *w, const char *dir, struct reason *why)
{
    enum err e = ERR_OK;

    *w = (struct watch){ .fd = -1 };
    w->dir = mem_text(dir);
    if (!w->dir)
        return err_say(why, ERR_NOMEM, "watch:%s: out of memory for the name", dir);
    w->fd = inotify_init1(IN_CLOEXEC | IN_NONBLOCK);
    /* Watch before listing: a file that appears in between is seen twice and queued once, but never missed. */
    if (w->fd < 0 ||
        inotify_add_watch(w->fd, dir, IN_CLOSE_WRITE | IN_MOVED_TO | IN_CREATE | IN_MODIFY | IN_ONLYDIR) < 0)
        e = files_say_errno(why, dir, "cannot watch", errno);
    if (!e && !list(w, &w->known, &w->known_count))
        e = err_say(why, ERR_IO, "watch:%s: cannot list the folder", dir);
    if (!e)
        e = files_from_folder(dir, &w->queue, why);
    w->number = w->queue.count;
    w->list_ms = clock_ms() + LIST_MS;
    if (e)
        watch_finish(w);
    return e;
}

void watch_finish(struct watch *w)
{
    files_finish(&w->queue);
    forget_known(w->known, w->known_count);
    for (size_t i = 0; i < w->event_count; i++)
        mem_free(w->events[i].name);
    mem_free(w->events);
    if (w->dir && w->fd >= 0)
        close(w->fd);
    mem_free(w->dir);
    *w = (struct watch){ .fd = -1 };
}

enum err watch_next(struct watch *w, int timeout_ms, const struct file_item **out, struct reason *why)
{
    *out = NULL;
    enum err e = drain(w, why);
    if (!e)
        e = look(w, why);
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
