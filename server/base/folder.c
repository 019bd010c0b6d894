#include "base/file_store.h"

#include <errno.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static bool is_folder(const char *path)
{
    struct stat st;
    return stat(path, &st) == 0 && S_ISDIR(st.st_mode);
}

enum err folder_make(const char *path, struct reason *why)
{
    char folder[4096];

    if (snprintf(folder, sizeof(folder), "%s", path) >= (int)sizeof(folder) || !path[0])
        return err_say(why, ERR_IO, "%.200s: is not a valid folder name", path);
    for (char *p = folder + 1;; p++) {
        if (*p && *p != '/')
            continue;
        const char kept = *p;
        *p = '\0';
        if (mkdir(folder, 0777) != 0 && errno != EEXIST)
            return err_say(why, ERR_IO, "%s: cannot create the folder: %s", folder, strerror(errno));
        *p = kept;
        if (!kept)
            return is_folder(folder) ? ERR_OK : err_say(why, ERR_IO, "%s: exists and is not a folder", folder);
    }
}

enum err folder_make_own(const char *flag, const char *path, struct reason *why)
{
    struct stat st;

    if (mkdir(path, 0700) != 0 && errno != EEXIST)
        return err_say(why, ERR_USAGE, "%s %s: cannot be made: %s", flag, path, strerror(errno));
    if (lstat(path, &st) != 0 || !S_ISDIR(st.st_mode))
        return err_say(why, ERR_USAGE, "%s %s: is not a folder", flag, path);
    if ((st.st_uid != geteuid() && st.st_uid != 0) || (st.st_mode & 022))
        return err_say(why, ERR_USAGE,
                       "%s %s: other users may write to it, so they would know or choose the secrets in it; name a "
                       "folder of this user's own, or one that is not there yet",
                       flag, path);
    return ERR_OK;
}

enum err folder_cache(const char *program, char *path, size_t size, struct reason *why)
{
    const char *cache = getenv("XDG_CACHE_HOME"), *home = getenv("HOME");
    int n;

    if (cache && cache[0] == '/')
        n = snprintf(path, size, "%s/%s", cache, program);
    else if (home && home[0] == '/')
        n = snprintf(path, size, "%s/.cache/%s", home, program);
    else
        return err_say(why, ERR_USAGE, "neither XDG_CACHE_HOME nor HOME is set");
    return n < 0 || (size_t)n >= size ? err_say(why, ERR_IO, "%.200s...: the path is too long", path) : ERR_OK;
}
