/* The files that loading a scene may open: the scene file, files below its folder, and files below the folders of
 * the models that the scene file names, which must be declared before the first model is opened. A symbolic link that
 * leads out of these folders is refused, unless it is one of those models. Thread: one at a time. */
#pragma once

#include "import/reader/host.h"

#include <stdbool.h>
#include <time.h>

struct scene_file { /* one that was opened, as it was then */
    char *path;
    uint64_t device, inode, size;
    struct timespec written;
};

struct scene_files {
    const char *scene; /* borrowed */
    size_t most;       /* bytes of one file */
    char **folders;    /* [count], resolved */
    size_t count;
    bool sealed;               /* no folder may be added any more */
    struct scene_file *opened; /* [opened_count] */
    size_t opened_count, opened_room;
};

/* ERR_NOMEM. `scene` must outlive it. */
MUST_CHECK enum err scene_files_init(struct scene_files *f, const char *scene, size_t most);
void scene_files_finish(struct scene_files *f); /* zeroed memory is allowed */

/* See host.h. */
MUST_CHECK enum err scene_files_allow(struct scene_files *f, const char *path, struct reason *why);
/* See host.h. */
MUST_CHECK enum err scene_files_open(struct scene_files *f, const char *path, int *fd, size_t *size,
                                     struct reason *why);

/* Whether the files that were opened are still the same: else parts of what was read may belong to different versions,
 * or a file that was being written was read to where it had got. ERR_IO: one is not. */
MUST_CHECK enum err scene_files_check(const struct scene_files *f, struct reason *why);
