/* Watches a folder with inotify: files closed after writing or moved in, in order of arrival. Private to this room.
 * Thread: one per watch. */
#pragma once

#include "base/err.h"
#include "sky/source/files.h"

struct watch {
    char *dir; /* owned */
    int fd;
    bool gone;              /* the folder was removed; no more files will come */
    uint64_t number;        /* of the next file to appear */
    struct file_list queue; /* files not yet read, numbered in order of arrival */
};

/* Starts watching. Files that already exist are queued first, in byte order, and assumed complete. ERR_IO: no such
 * folder, or no inotify watches left. ERR_NOMEM. On error *w is finished. */
MUST_CHECK enum err watch_init(struct watch *w, const char *dir, struct reason *why);
void watch_finish(struct watch *w); /* frees; zeroed memory is allowed */

/* The next file, borrowed until the next call; *out is NULL after timeout_ms or a signal. ERR_RANGE: the kernel's event
 * queue overflowed and files were missed; the next call continues. ERR_END: the folder was removed and every file was
 * delivered. ERR_NOMEM. */
MUST_CHECK enum err watch_next(struct watch *w, int timeout_ms, const struct file_item **out, struct reason *why);
