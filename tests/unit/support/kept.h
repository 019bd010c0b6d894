/* Files that a run has kept in a cache folder. */
#pragma once

#include "support/unit.h"

#include <glob.h>
#include <stdio.h>
#include <unistd.h>

/* The number of files in the folder; path: the first one's by name. */
static inline size_t kept_files(const char *folder, char path[256])
{
    char pattern[256];
    glob_t found;

    path[0] = '\0';
    snprintf(pattern, sizeof(pattern), "%s/*", folder);
    const size_t count = glob(pattern, 0, NULL, &found) == 0 ? found.gl_pathc : 0;
    if (count > 0)
        snprintf(path, 256, "%s", found.gl_pathv[0]);
    globfree(&found);
    return count;
}

/* Deletes the folder and the files in it. */
static inline void kept_remove(const char *folder)
{
    char path[256];

    while (kept_files(folder, path) > 0)
        assert_int_equal(unlink(path), 0);
    assert_int_equal(rmdir(folder), 0);
}
