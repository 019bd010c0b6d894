/* server/source/watch.h */
/* A folder under observation (inotify): files that were closed after writing or moved in, in the order in which that
 * happened. Inside this room only. One thread per watch. */
#ifndef SOURCE_WATCH_H
#define SOURCE_WATCH_H

#include "err.h"
#include "files.h"

struct watch {
    char *dir; /* owned */
    int fd;
    bool gone;              /* the folder was removed: nothing more will come */
    uint64_t number;        /* of the next file that appears */
    struct file_list queue; /* files not yet read; the numbers follow their arrival */
};

/* Begins to watch; the files that are there already are first in the queue, in byte order, and are taken to be whole.
 * ERR_IO: no such folder, or no more watches are to be had. ERR_NOMEM. On error *w is finished. */
MUST_CHECK enum err watch_init(struct watch *w, const char *dir, struct reason *why);
void watch_finish(struct watch *w);

/* The next file, borrowed until the next call; *out is NULL when none appeared within timeout_ms or a signal came.
 * ERR_RANGE: files came faster than the kernel remembers and some were missed; goes on at the next call.
 * ERR_END: the folder is gone and everything was delivered. ERR_NOMEM. */
MUST_CHECK enum err watch_next(struct watch *w, int timeout_ms, const struct file_item **out, struct reason *why);

#endif
