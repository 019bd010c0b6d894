/* The host of a scene that is read in this process, without another one. */
#pragma once

#include "import/reader/files.h"

#include <math.h>

static inline enum err host_here_open(void *context, const char *path, int *fd, size_t *size, struct reason *why)
{
    return scene_files_open(context, path, fd, size, why);
}

static inline enum err host_here_allow(void *context, const char *path, struct reason *why)
{
    return scene_files_allow(context, path, why);
}

static inline void host_here_step(void *context)
{
    (void)context;
}

/* At rest; `f` must outlive it. */
static inline struct host host_here(struct scene_files *f)
{
    return (struct host){ host_here_open, host_here_allow, host_here_step, f, NAN, 0 };
}
