/* Output folders. Thread: any. */
#pragma once

#include "base/err.h"

#include <stddef.h>

/* Creates a folder and its missing parents. ERR_IO names the folder and the cause. */
MUST_CHECK enum err folder_make(const char *path, struct reason *why);

/* Writes the cache folder of `program` into path[size]: $XDG_CACHE_HOME/program, else $HOME/.cache/program. Does not
 * create it. ERR_USAGE: neither variable is set. ERR_IO: the path is too long. */
MUST_CHECK enum err folder_cache(const char *program, char *path, size_t size, struct reason *why);
