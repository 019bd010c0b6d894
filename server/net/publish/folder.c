#include "base/file_store.h"
#include "base/log.h"
#include "net/publish/sink.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

enum err sink_folder_lock(const char *folder, bool public, int *fd, struct reason *why)
{
    const bool makes = access(folder, F_OK) != 0;
    const enum err e = folder_make(folder, why);

    *fd = -1;
    if (e)
        return e;
    *fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (*fd < 0)
        return err_say(why, ERR_IO, "the folder cannot be opened: %s", strerror(errno));
    if (makes)
        log_info("%s: made this folder", folder);
    if (makes && public && fchmod(*fd, 0755) != 0)
        log_warning("%s: others cannot be given access: %s", folder, strerror(errno));
    if (flock(*fd, LOCK_EX | LOCK_NB) == 0 || errno != EWOULDBLOCK) /* some file systems have no locks */
        return ERR_OK;
    close(*fd);
    *fd = -1;
    return err_say(why, ERR_IO, "another process writes to this folder");
}

int sink_write_all(int fd, const uint8_t *bytes, size_t size)
{
    while (size > 0) {
        const ssize_t got = write(fd, bytes, size);
        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0)
            return errno;
        bytes += got;
        size -= (size_t)got;
    }
    return 0;
}

void sink_time(int64_t wall_us, char out[SINK_TIME])
{
    const time_t at = (time_t)(wall_us / 1000000);
    struct tm t;

    if (!gmtime_r(&at, &t) || strftime(out, SINK_TIME, "%Y%m%dT%H%M%SZ", &t) == 0)
        snprintf(out, SINK_TIME, "%lld", (long long)at);
}
