/* server/base/file_store.h */
/* Puts bytes on disk so that nobody ever sees half of them: a temporary name in the same folder (NAME.part), synced,
 * renamed over NAME, the folder synced. After ERR_OK the file survives a power cut; after an error or a kill the old
 * one is untouched, and at most a .part is left, which the next writer of that NAME takes over. */
#ifndef BASE_FILE_STORE_H
#define BASE_FILE_STORE_H

#include "err.h"

#include <stddef.h>
#include <stdint.h>

/* A pipe, device or symbolic link is not replaced but written in place. Several processes may store under one name, the
 * last one wins; within a process one thread at a time. ERR_IO names path and cause: a full disk, a missing folder. */
MUST_CHECK enum err file_store(const char *path, const void *bytes, size_t size, struct reason *why);

/* The same for what lies in several pieces, one after the other. */
struct file_part {
    const void *bytes;
    size_t size;
};
MUST_CHECK enum err file_store_parts(const char *path, const struct file_part *parts, size_t count, struct reason *why);

#endif
