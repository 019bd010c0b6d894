/* The folder of --cache-dir, which several programs and users' services share: files of tables (cache_file.h) whose
 * names contain a digest of everything they depend on. Its size is limited; the least recently used files are deleted
 * first. Thread: any. */
#pragma once

#include "base/err.h"

#include <stddef.h>
#include <stdint.h>

#define CACHE_FOLDER_BYTES (UINT64_C(2) * 1000000000) /* limit of all files together */
#define CACHE_FOLDER_SUFFIX ".transport"              /* of the files that count and that may be deleted */

/* Writes the folder's path into path[size]: `requested`, or, if NULL, the first folder of $CACHE_DIRECTORY (systemd),
 * else that of base/file_store.h. Creates nothing. ERR_USAGE: no variable names a folder; ERR_IO: the path is too long.
 */
MUST_CHECK enum err cache_folder_find(const char *requested, char *path, size_t size, struct reason *why);

/* Creates the folder if it is missing. ERR_IO: it cannot be created, is not a folder, belongs to another user than
 * this process's or root, or its file system is read-only; the reason names it. */
MUST_CHECK enum err cache_folder_prepare(const char *path, struct reason *why);

/* As cache_folder_prepare, but a missing folder is no error and is not created. To be called before reading. */
MUST_CHECK enum err cache_folder_check(const char *path, struct reason *why);

/* Marks a file as used now. Failure only makes it look older. */
void cache_folder_touch(const char *file);

/* Deletes files, least recently used first, until the others and `more` bytes fit into `limit`, and what killed writers
 * left. `keep`: a file that is not deleted and not counted; NULL: none. Two programs may do this at the same time.
 * ERR_RANGE: `more` exceeds the limit by itself; nothing was deleted. */
MUST_CHECK enum err cache_folder_trim(const char *path, const char *keep, uint64_t more, uint64_t limit,
                                      struct reason *why);
