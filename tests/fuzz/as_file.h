/* For parsers that need a path: the input as a file in memory, removed at normal exit. */
#pragma once

#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

static char as_file_path[64];

static inline void as_file_gone(void)
{
    unlink(as_file_path);
}

/* The path, the same for every input; it ends in `suffix`. */
static inline const char *as_file(const char *suffix, const uint8_t *bytes, size_t size)
{
    if (!as_file_path[0]) {
        snprintf(as_file_path, sizeof(as_file_path), "%s/relight-fuzz-%ld%s",
                 access("/dev/shm", W_OK) == 0 ? "/dev/shm" : "/tmp", (long)getpid(), suffix);
        atexit(as_file_gone);
    }
    const int fd = open(as_file_path, O_CREAT | O_TRUNC | O_WRONLY | O_CLOEXEC, 0600);
    if (fd < 0 || write(fd, bytes, size) != (ssize_t)size)
        abort();
    close(fd);
    return as_file_path;
}
