#define _GNU_SOURCE /* O_PATH */
#include "base/file_store.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

#define PATH_ROOM FILE_STORE_PATH
#define NAME_TRIES 100 /* processes that may write to one name at the same time */

bool file_is_stdout(const char *path)
{
    return strcmp(path, FILE_STORE_STDOUT) == 0;
}

static enum err say_errno(struct reason *why, const char *path, const char *step, int number)
{
    char room[128];

    if (number == EPIPE && file_is_stdout(path))
        return err_say(why, ERR_IO, "standard output: the reader has closed it");
    if (file_is_stdout(path))
        path = "standard output";
    return err_say(why, ERR_IO, "%s: cannot %s: %s", path, step, strerror_r(number, room, sizeof(room)));
}

/* Whether `name` still refers to the open file: another process may have renamed it before this one got the lock. */
static bool is_still(int fd, const char *name)
{
    struct stat open_one, named;

    return fstat(fd, &open_one) == 0 && lstat(name, &named) == 0 && open_one.st_ino == named.st_ino &&
           open_one.st_dev == named.st_dev && S_ISREG(named.st_mode);
}

/* ---- What others may have put there ---- */

/* Where others may write, a name can be a link to a file of ours, or a pipe that nobody reads. */
static bool is_trusted(const struct stat *st)
{
    return st->st_uid == geteuid() || st->st_uid == 0;
}

/* Opens what the link `link` names, which is not followed again: it may be another one by now. */
static int open_target(const char *path, int link, int flags)
{
    char target[PATH_ROOM], joined[PATH_ROOM];
    const ssize_t n = readlinkat(link, "", target, sizeof(target) - 1);
    const char *slash = strrchr(path, '/');

    if (n <= 0)
        return -1;
    target[n] = 0;
    const int folder = slash && target[0] != '/' ? (int)(slash - path) + 1 : 0;
    if (snprintf(joined, sizeof(joined), "%.*s%s", folder, path, target) >= (int)sizeof(joined)) {
        errno = ENAMETOOLONG;
        return -1;
    }
    return open(joined, flags | O_CREAT, 0666);
}

static int open_existing(const char *path, int flags)
{
    const int at = open(path, O_PATH | O_NOFOLLOW | O_CLOEXEC);
    char again[40];
    struct stat st;
    int fd = -1;

    if (at < 0)
        return -1;
    snprintf(again, sizeof(again), "/proc/self/fd/%d", at);
    if (fstat(at, &st) != 0 || !(is_trusted(&st) || S_ISCHR(st.st_mode)) || (S_ISREG(st.st_mode) && st.st_nlink > 1))
        errno = EPERM;
    else
        fd = S_ISLNK(st.st_mode) ? open_target(path, at, flags) : open(again, flags);
    const int number = errno;
    close(at);
    errno = number;
    return fd;
}

int file_open(const char *path, int flags)
{
    const int fd = open(path, flags | O_CREAT | O_EXCL | O_CLOEXEC, 0666);

    return fd < 0 && errno == EEXIST ? open_existing(path, flags | O_CLOEXEC) : fd;
}

FILE *file_rewrite(const char *path)
{
    const int fd = file_open(path, O_WRONLY | O_TRUNC);
    FILE *f = fd < 0 ? NULL : fdopen(fd, "w");

    if (fd >= 0 && !f)
        close(fd);
    return f;
}

/* Opens a file of ours that a killed process left; -1: it is another's, a link or a pipe. */
static int open_left(const char *name)
{
    const int fd = open(name, O_WRONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    struct stat st;

    if (fd < 0 || (fstat(fd, &st) == 0 && S_ISREG(st.st_mode) && st.st_uid == geteuid() && st.st_nlink == 1))
        return fd;
    close(fd);
    return -1;
}

/* Creates and locks `name`, or takes over what a killed process left. *fd is -1 if the name is taken: another process
 * writes to it, or it is not ours. Returns 0 or errno. */
static int claim(const char *name, int *fd)
{
    struct flock lock = { .l_type = F_WRLCK, .l_whence = SEEK_SET };

    *fd = open(name, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (*fd < 0 && errno != EEXIST)
        return errno;
    if (*fd < 0)
        *fd = open_left(name);
    if (*fd < 0)
        return 0;
    /* On a file system without locks, only one process may write to a name. */
    const bool taken = fcntl(*fd, F_SETLK, &lock) != 0 && (errno == EAGAIN || errno == EACCES);
    if (!taken && is_still(*fd, name) && ftruncate(*fd, 0) == 0)
        return 0;
    close(*fd);
    *fd = -1;
    return 0;
}

static enum err open_beside(const char *path, char temporary[PATH_ROOM], int *fd, struct reason *why)
{
    for (int i = 0; i < NAME_TRIES; i++) {
        const int n =
            i ? snprintf(temporary, PATH_ROOM, "%s.%d.part", path, i) : snprintf(temporary, PATH_ROOM, "%s.part", path);
        if (n < 0 || n >= PATH_ROOM)
            return err_say(why, ERR_IO, "%.200s...: the path exceeds %d bytes", path, PATH_ROOM - 32);
        const int number = claim(temporary, fd);
        if (number)
            return say_errno(why, path, "create the file", number);
        if (*fd >= 0)
            return ERR_OK;
    }
    return err_say(why, ERR_IO, "%s: %d unfinished files (*.part) exist beside it", path, NAME_TRIES);
}

#define TOGETHER 256 /* buffers per writev call */

/* Returns 0 or errno. */
static int write_parts(int fd, const struct file_part *parts, size_t count)
{
    size_t written = 0; /* bytes of the first part already written */

    while (count > 0) {
        struct iovec list[TOGETHER];
        const int n = count < TOGETHER ? (int)count : TOGETHER;
        for (int k = 0; k < n; k++)
            list[k] =
                (struct iovec){ (uint8_t *)parts[k].bytes + (k ? 0 : written), parts[k].size - (k ? 0 : written) };
        const ssize_t got = writev(fd, list, n);
        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0)
            return errno;
        for (written += (size_t)got; count > 0 && written >= parts->size; count--, parts++)
            written -= parts->size;
    }
    return 0;
}

/* Makes a rename durable by syncing its folder. Returns 0 or errno; ignores EINVAL from file systems that cannot do it.
 */
static int sync_folder(const char *path)
{
    char folder[PATH_ROOM];
    const char *slash = strrchr(path, '/');

    if (slash)
        snprintf(folder, sizeof(folder), "%.*s", slash == path ? 1 : (int)(slash - path), path);
    const int fd = open(slash ? folder : ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0)
        return errno == EACCES ? 0 : errno; /* a folder that is writable but not readable cannot be synced */
    const int failed = fsync(fd) != 0 && errno != EINVAL && errno != ENOTSUP ? errno : 0;
    close(fd);
    return failed;
}

/* A pipe, a device or a link of ours is written in place; what another user put there is replaced. */
static bool is_replaceable(const char *path)
{
    struct stat st;

    if (file_is_stdout(path))
        return false;
    return lstat(path, &st) != 0 || S_ISREG(st.st_mode) ||
           ((S_ISLNK(st.st_mode) || S_ISFIFO(st.st_mode)) && !is_trusted(&st));
}

enum err file_draft_begin(struct file_draft *d, const char *path, struct reason *why)
{
    *d = (struct file_draft){ .fd = -1, .replace = is_replaceable(path) };
    if (snprintf(d->path, sizeof(d->path), "%s", path) >= (int)sizeof(d->path))
        return err_say(why, ERR_IO, "%.200s...: the path exceeds %d bytes", path, PATH_ROOM - 1);
    enum err e = ERR_OK;
    if (d->replace) {
        e = open_beside(path, d->temporary, &d->fd, why);
    } else {
        memcpy(d->temporary, d->path, sizeof(d->path));
        d->fd = file_is_stdout(path) ? fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, 0) : file_open(path, O_WRONLY | O_TRUNC);
        e = d->fd < 0 ? say_errno(why, path, "open", errno) : ERR_OK;
    }
    d->begun = !e;
    if (file_is_stdout(path))
        snprintf(d->name, sizeof(d->name), "%s", path);
    else
        snprintf(d->name, sizeof(d->name), "/proc/self/fd/%d", d->fd);
    return e;
}

void file_draft_discard(struct file_draft *d)
{
    if (!d->begun)
        return;
    if (d->replace)
        unlink(d->temporary);
    close(d->fd);
    d->begun = false;
}

enum err file_draft_commit(struct file_draft *d, struct reason *why)
{
    enum err e = ERR_OK;

    /* Pipes and devices do not support fsync. */
    int failed = fsync(d->fd) != 0 && errno != EINVAL && errno != ENOTSUP ? errno : 0;
    if (failed)
        e = say_errno(why, d->path, "write the file", failed);
    else if (d->replace &&
             rename(d->temporary, d->path) != 0) /* still locked: no other process can have started writing to it */
        e = say_errno(why, d->path, "rename the finished file", errno);
    if (e) {
        file_draft_discard(d);
        return e;
    }
    d->begun = false;
    if (close(d->fd) != 0)
        e = say_errno(why, d->path, "write the file", errno);
    if (!e && d->replace && (failed = sync_folder(d->path)) != 0)
        e = say_errno(why, d->path, "sync its folder", failed);
    return e;
}

enum err file_store_parts(const char *path, const struct file_part *parts, size_t count, struct reason *why)
{
    struct file_draft d;
    const enum err e = file_draft_begin(&d, path, why);

    if (e)
        return e;
    const int failed = write_parts(d.fd, parts, count);
    if (!failed)
        return file_draft_commit(&d, why);
    file_draft_discard(&d);
    return say_errno(why, path, "write the file", failed);
}

enum err file_store(const char *path, const void *bytes, size_t size, struct reason *why)
{
    return file_store_parts(path, &(struct file_part){ bytes, size }, 1, why);
}
