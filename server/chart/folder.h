/* server/chart/folder.h */
/* Folders to write into. Any thread. */
#ifndef CHART_FOLDER_H
#define CHART_FOLDER_H

#include "err.h"

#include <stddef.h>

/* Makes the folder and those above it that are missing. ERR_IO names the one and the cause. */
MUST_CHECK enum err folder_make(const char *path, struct reason *why);

/* Where references are kept: `asked`, or if that is NULL $XDG_CACHE_HOME/relight-chart, else
 * $HOME/.cache/relight-chart; made if it is missing. ERR_IO names folder and cause; ERR_USAGE where no variable says
 * where. */
MUST_CHECK enum err folder_cache(const char *asked, char *path, size_t size, struct reason *why);

#endif
