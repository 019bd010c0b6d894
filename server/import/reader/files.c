#define _XOPEN_SOURCE 700 /* realpath */
#include "import/reader/files.h"

#include "base/mem.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#define FOLDERS_MAX 4096 /* bounds the list that a scene file may ask for */

_Static_assert(HOST_PATH_MAX >= PATH_MAX, "a resolved path fits");

/* Cuts the last part off a path: "a/b" becomes "a", "b" ".", "/b" "/". */
static void cut_name(char *path)
{
    char *slash = strrchr(path, '/');

    if (!slash)
        strcpy(path, ".");
    else
        slash[slash == path ? 1 : 0] = '\0';
}

static bool is_below(const char *folder, const char *path)
{
    const size_t length = strlen(folder);

    return strncmp(folder, path, length) == 0 && (path[length] == '/' || folder[length - 1] == '/');
}

static bool may_open(const struct scene_files *f, const char *resolved)
{
    for (size_t i = 0; i < f->count; i++)
        if (is_below(f->folders[i], resolved))
            return true;
    return false;
}

/* Adds the folder of `path`. A folder that does not exist holds nothing to read and is left out. */
static enum err add_folder(struct scene_files *f, const char *path)
{
    char folder[HOST_PATH_MAX], resolved[HOST_PATH_MAX];

    if (strlen(path) >= sizeof(folder))
        return ERR_OK;
    strcpy(folder, path);
    cut_name(folder);
    if (!realpath(folder, resolved))
        return ERR_OK;
    for (size_t i = 0; i < f->count; i++)
        if (strcmp(f->folders[i], resolved) == 0)
            return ERR_OK;
    if (f->count == FOLDERS_MAX)
        return ERR_RANGE;
    char **grown = mem_grow(f->folders, f->count, f->count + 1, sizeof(*grown));
    if (!grown)
        return ERR_NOMEM;
    f->folders = grown;
    grown[f->count] = mem_text(resolved);
    if (!grown[f->count])
        return ERR_NOMEM;
    f->count++;
    return ERR_OK;
}

/* A model may be a link into another folder and have its textures there or here. */
static enum err add_folders(struct scene_files *f, const char *path)
{
    char resolved[HOST_PATH_MAX];
    enum err e = add_folder(f, path);

    if (!e && realpath(path, resolved))
        e = add_folder(f, resolved);
    return e;
}

enum err scene_files_init(struct scene_files *f, const char *scene, size_t most)
{
    *f = (struct scene_files){ .scene = scene, .most = most };
    return add_folders(f, scene);
}

void scene_files_finish(struct scene_files *f)
{
    for (size_t i = 0; i < f->count; i++)
        mem_free(f->folders[i]);
    mem_free(f->folders);
    for (size_t i = 0; i < f->opened_count; i++)
        mem_free(f->opened[i].path);
    mem_free(f->opened);
    *f = (struct scene_files){ 0 };
}

enum err scene_files_allow(struct scene_files *f, const char *path, struct reason *why)
{
    if (f->sealed)
        return err_say(why, ERR_USAGE, "%s: a model is named too late", path);
    const enum err e = add_folders(f, path);
    return e == ERR_RANGE ? err_say(why, e, "%s: models are in more than %d folders", f->scene, FOLDERS_MAX) : e;
}

static const char *kind_name(mode_t mode)
{
    return S_ISDIR(mode) ? "a folder" : S_ISFIFO(mode) ? "a FIFO" : S_ISSOCK(mode) ? "a socket" : "a device";
}

static enum err check_kind(const struct stat *st, const char *path, struct reason *why)
{
    return S_ISREG(st->st_mode) ? ERR_OK : err_say(why, ERR_IO, "%s: is %s, not a file", path, kind_name(st->st_mode));
}

/* Looks before it opens, since to open a device or a FIFO has effects, and again at what it has opened. */
static enum err open_file(const struct scene_files *f, const char *path, const char *resolved, int *fd, size_t *size,
                          struct reason *why)
{
    struct stat st;

    if (stat(resolved, &st) != 0)
        return err_say(why, ERR_IO, "%s: %s", path, strerror(errno));
    enum err e = check_kind(&st, path, why);
    if (e)
        return e;
    *fd = open(resolved, O_RDONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC | O_NOFOLLOW);
    if (*fd < 0 || fstat(*fd, &st) != 0) {
        e = err_say(why, ERR_IO, "%s: %s", path, strerror(errno));
    } else {
        e = check_kind(&st, path, why);
        if (!e && (uintmax_t)st.st_size > f->most)
            e = err_say(why, ERR_RANGE, "%s: %jd bytes, more than may be read (%zu; --max-scene-memory)", path,
                        (intmax_t)st.st_size, f->most);
    }
    if (e && *fd >= 0)
        close(*fd);
    *size = (size_t)st.st_size;
    return e;
}

static void describe(const struct stat *st, struct scene_file *out)
{
    out->device = st->st_dev;
    out->inode = st->st_ino;
    out->size = (uint64_t)st->st_size;
    out->written = st->st_mtim;
}

static bool is_same(const struct scene_file *a, const struct scene_file *b)
{
    return a->device == b->device && a->inode == b->inode && a->size == b->size &&
           a->written.tv_sec == b->written.tv_sec && a->written.tv_nsec == b->written.tv_nsec;
}

static enum err note_opened(struct scene_files *f, const char *path, int fd)
{
    struct stat st;

    if (!mem_reserve(&f->opened, f->opened_count, &f->opened_room, sizeof(*f->opened)))
        return ERR_NOMEM;
    struct scene_file *file = &f->opened[f->opened_count];
    file->path = mem_text(path);
    if (!file->path || fstat(fd, &st) != 0) {
        mem_free(file->path);
        return ERR_NOMEM;
    }
    describe(&st, file);
    f->opened_count++;
    return ERR_OK;
}

/* ---- Names as other systems write them ---- */

/* The entry of the folder that differs from `name` in case alone; false: none. */
static bool find_other_case(const char *folder, const char *name, char out[NAME_MAX + 1])
{
    DIR *d = opendir(folder);
    bool found = false;

    for (const struct dirent *e = d ? readdir(d) : NULL; e && !found; e = readdir(d))
        if (strcasecmp(e->d_name, name) == 0) {
            snprintf(out, NAME_MAX + 1, "%s", e->d_name);
            found = true;
        }
    if (d)
        closedir(d);
    return found;
}

/* The file that `path` means where there is none of that name: with slashes for backslashes, without quotes and blanks
 * around its name, its name and the name of its folder in other case. False: none. */
static bool find_similar(const char *path, char out[HOST_PATH_MAX])
{
    char name[NAME_MAX + 1], *part;
    struct stat st;
    size_t n = 0;

    if (strlen(path) >= HOST_PATH_MAX - 2)
        return false;
    for (; path[n]; n++)
        out[n] = path[n] == '\\' ? '/' : path[n];
    while (n > 0 && strchr(" \t\"'", out[n - 1]))
        n--;
    out[n] = '\0';
    part = strrchr(out, '/');
    part = part ? part + 1 : out;
    const size_t skip = strspn(part, " \t\"'");
    memmove(part, part + skip, strlen(part + skip) + 1);
    for (int k = 0; k < 2 && stat(out, &st) != 0; k++) { /* the folder's case first, then the file's */
        char *file = strrchr(out, '/'), *at = file ? file + 1 : out;
        if (k == 0) {
            if (!file || file == out)
                continue;
            *file = '\0';
            char *above = strrchr(out, '/');
            at = above ? above + 1 : out;
        }
        char saved[HOST_PATH_MAX], folder[HOST_PATH_MAX];
        snprintf(saved, sizeof(saved), "%s", at);
        snprintf(folder, sizeof(folder), "%.*s", (int)(at - out), out);
        if (find_other_case(folder[0] ? folder : ".", saved, name) && strlen(name) == strlen(saved))
            memcpy(at, name, strlen(name));
        if (k == 0)
            *file = '/';
    }
    return stat(out, &st) == 0;
}

enum err scene_files_open(struct scene_files *f, const char *path, int *fd, size_t *size, struct reason *why)
{
    char resolved[HOST_PATH_MAX], similar[HOST_PATH_MAX];
    const bool is_scene = strcmp(path, f->scene) == 0;

    f->sealed = f->sealed || !is_scene;
    bool found = realpath(path, resolved);
    const int fault = errno;
    if (!found && !is_scene && fault == ENOENT && find_similar(path, similar) && realpath(similar, resolved)) {
        found = true;
        path = similar;
    }
    if (!found)
        return err_say(why, ERR_IO, "%s: %s", path, strerror(fault));
    if (!is_scene && !may_open(f, resolved))
        return err_say(why, ERR_IO, "%s: is outside of the folders of the scene and its models", path);
    enum err e = open_file(f, path, resolved, fd, size, why);
    if (e)
        return e;
    e = note_opened(f, path, *fd);
    if (e) {
        close(*fd);
        return err_say(why, e, "%s: out of memory", path);
    }
    return ERR_OK;
}

enum err scene_files_check(const struct scene_files *f, struct reason *why)
{
    for (size_t i = 0; i < f->opened_count; i++) {
        struct scene_file now;
        struct stat st;
        if (stat(f->opened[i].path, &st) == 0)
            describe(&st, &now);
        else
            now = (struct scene_file){ .path = NULL };
        if (!is_same(&f->opened[i], &now))
            return err_say(why, ERR_IO, "%s: has changed while the scene was read; load it again", f->opened[i].path);
    }
    return ERR_OK;
}
