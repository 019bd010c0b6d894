/* server/chart/folder.h */
/* Folders to write into. Any thread. */
#ifndef BASE_FOLDER_H
#define BASE_FOLDER_H

#include "err.h"

#include <stddef.h>

/* Makes the folder and those above it that are missing. ERR_IO names the one and the cause. */
MUST_CHECK enum err folder_make(const char *path, struct reason *why);

/* Where `program` keeps what it could make anew: $XDG_CACHE_HOME/program, else $HOME/.cache/program; it need not be
 * there. ERR_USAGE: no variable says where. ERR_IO: the path is too long. */
MUST_CHECK enum err folder_cache(const char *program, char *path, size_t size, struct reason *why);

#endif
