#include "light/cache/cache_file.h"

#include "base/file_store.h"
#include "base/mem.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#define PATH_ROOM 4096    /* PATH_MAX of Linux */
#define LEFT_BEHIND_S 600 /* an older .part file was left by a killed writer */

enum err cache_folder_find(const char *requested, char *path, size_t size, struct reason *why)
{
    const char *of_service = getenv("CACHE_DIRECTORY");
    int n;

    if (requested)
        n = snprintf(path, size, "%s", requested);
    else if (of_service && of_service[0] == '/')
        n = snprintf(path, size, "%.*s", (int)strcspn(of_service, ":"), of_service);
    else
        return folder_cache("relightd", path, size, why);
    return n < 0 || (size_t)n >= size ? err_say(why, ERR_IO, "%.200s...: the path is too long", path) : ERR_OK;
}

enum err cache_folder_check(const char *path, struct reason *why)
{
    const uid_t me = geteuid();
    struct stat st;

    if (stat(path, &st) != 0) {
        if (errno == ENOENT)
            return ERR_OK;
        return err_say(why, ERR_IO, "cache folder %.200s: %s", path, strerror(errno));
    }
    if (!S_ISDIR(st.st_mode))
        return err_say(why, ERR_IO, "cache folder %.200s: is not a folder", path);
    if (st.st_uid != me && st.st_uid != 0)
        return err_say(why, ERR_IO, "cache folder %.200s: belongs to user %u, not to this one (%u)", path,
                       (unsigned)st.st_uid, (unsigned)me);
    return ERR_OK;
}

enum err cache_folder_prepare(const char *path, struct reason *why)
{
    enum err e = cache_folder_check(path, why);

    if (!e)
        e = folder_make(path, why);
    if (!e && access(path, W_OK) != 0)
        e = err_say(why, ERR_IO, "cache folder %.200s: cannot be written: %s", path, strerror(errno));
    return e;
}

void cache_folder_touch(const char *file)
{
    if (utimensat(AT_FDCWD, file, NULL, AT_SYMLINK_NOFOLLOW) != 0)
        return; /* not ours, or gone */
}

/* ---- Limiting its size ---- */

struct entry {
    char name[256];
    struct timespec used;
    uint64_t bytes;
};

struct entries {
    struct entry *at;
    size_t count, capacity;
    uint64_t bytes;
};

static bool ends_with(const char *name, const char *end)
{
    const size_t n = strlen(name), m = strlen(end);

    return n > m && strcmp(name + n - m, end) == 0;
}

/* A temporary file of base/file_store.h: NAME.part or NAME.K.part. */
static bool is_left_behind(const char *name, const struct stat *st)
{
    return ends_with(name, ".part") && strstr(name, CACHE_FOLDER_SUFFIX ".") &&
           time(NULL) - st->st_mtime > LEFT_BEHIND_S;
}

/* Lists the files that count, and deletes those left behind. Out of memory ends the list early: others remain. */
static void list(DIR *folder, const char *keep, struct entries *out)
{
    for (struct dirent *d = readdir(folder); d; d = readdir(folder)) {
        struct stat st;
        if (fstatat(dirfd(folder), d->d_name, &st, AT_SYMLINK_NOFOLLOW) != 0 || !S_ISREG(st.st_mode))
            continue;
        if (is_left_behind(d->d_name, &st) && unlinkat(dirfd(folder), d->d_name, 0) == 0)
            continue;
        if (!ends_with(d->d_name, CACHE_FOLDER_SUFFIX) || (keep && strcmp(keep, d->d_name) == 0))
            continue;
        if (!mem_reserve(&out->at, out->count, &out->capacity, sizeof(*out->at)))
            return;
        struct entry *e = &out->at[out->count++];
        snprintf(e->name, sizeof(e->name), "%s", d->d_name);
        e->used = st.st_mtim;
        e->bytes = (uint64_t)st.st_size;
        out->bytes += e->bytes;
    }
}

static int by_use(const void *a, const void *b)
{
    const struct entry *x = a, *y = b;

    if (x->used.tv_sec != y->used.tv_sec)
        return x->used.tv_sec < y->used.tv_sec ? -1 : 1;
    if (x->used.tv_nsec != y->used.tv_nsec)
        return x->used.tv_nsec < y->used.tv_nsec ? -1 : 1;
    return strcmp(x->name, y->name);
}

enum err cache_folder_trim(const char *path, const char *keep, uint64_t more, uint64_t limit, struct reason *why)
{
    const char *slash = keep ? strrchr(keep, '/') : NULL;
    struct entries all = { .count = 0 };

    if (more > limit)
        return err_say(why, ERR_RANGE, "%.0f MB exceed the cache folder's limit (%.0f MB)", 1e-6 * (double)more,
                       1e-6 * (double)limit);
    DIR *folder = opendir(path);
    if (!folder)
        return ERR_OK; /* nothing to delete */
    list(folder, slash ? slash + 1 : keep, &all);
    if (all.count > 0)
        qsort(all.at, all.count, sizeof(*all.at), by_use);
    for (size_t i = 0; i < all.count && all.bytes + more > limit; i++)
        if (unlinkat(dirfd(folder), all.at[i].name, 0) == 0 || errno == ENOENT)
            all.bytes -= all.at[i].bytes;
    closedir(folder);
    mem_free(all.at);
    return ERR_OK;
}
