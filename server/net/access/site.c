#include "net/access/site.h"

#include "base/mem.h"
#include "base/rng.h"

#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static const char *type_of(const char *name)
{
    static const struct {
        const char *extension, *type;
    } types[] = {
        { ".html", "text/html; charset=utf-8" },
        { ".js", "text/javascript; charset=utf-8" },
        { ".css", "text/css; charset=utf-8" },
        { ".svg", "image/svg+xml" },
        { ".png", "image/png" },
        { ".ico", "image/x-icon" },
        { ".json", "application/json" },
        { ".woff2", "font/woff2" },
        { ".webmanifest", "application/manifest+json" },
    };
    const char *dot = strrchr(name, '.');

    for (size_t i = 0; dot && i < sizeof(types) / sizeof(types[0]); i++)
        if (strcmp(dot, types[i].extension) == 0)
            return types[i].type;
    return NULL;
}

static enum err file_load(struct site_file *f, const char *path, struct reason *why)
{
    enum err e = ERR_OK;
    FILE *in = fopen(path, "rb");

    if (!in)
        return err_say(why, ERR_IO, "%s: %s", path, strerror(errno));
    struct stat info;
    if (fstat(fileno(in), &info) != 0 || info.st_size < 0 || (uint64_t)info.st_size > SITE_FILE_BYTES_MAX) {
        e = err_say(why, ERR_RANGE, "%s: larger than %zu bytes, too large for the page", path, SITE_FILE_BYTES_MAX);
        goto done;
    }
    f->size = (size_t)info.st_size;
    f->bytes = mem_alloc(f->size, 1);
    if (!f->bytes) {
        e = err_say(why, ERR_NOMEM, "%s: out of memory", path);
        goto done;
    }
    if (fread(f->bytes, 1, f->size, in) != f->size) {
        e = err_say(why, ERR_IO, "%s: cannot be read whole", path);
        goto done;
    }
    uint64_t hash = f->size;
    for (size_t i = 0; i < f->size; i++)
        hash = rng_mix(hash, f->bytes[i]);
    snprintf(f->etag, sizeof(f->etag), "\"%016llx\"", (unsigned long long)hash);
done:
    fclose(in);
    return e;
}

static enum err folder_load(struct site *site, const char *dir, const char *prefix, struct reason *why);

/* prefix: "/", or "/NAME/" within a folder of the page's. */
static enum err entry_load(struct site *site, const char *dir, const char *prefix, const char *name, struct reason *why)
{
    char path[4096], inner[sizeof(site->files[0].path)];
    struct stat info;
    const char *type = type_of(name);

    if (name[0] == '.')
        return ERR_OK;
    if ((size_t)snprintf(path, sizeof(path), "%s/%s", dir, name) >= sizeof(path) ||
        (size_t)snprintf(inner, sizeof(inner), "%s%s/", prefix, name) >= sizeof(inner))
        return err_say(why, ERR_RANGE, "%s/%s: the name is too long", dir, name);
    if (stat(path, &info) != 0)
        return err_say(why, ERR_IO, "%s: %s", path, strerror(errno));
    if (S_ISDIR(info.st_mode) && strcmp(prefix, "/") == 0)
        return folder_load(site, path, inner, why);
    if (!S_ISREG(info.st_mode) || !type)
        return ERR_OK;
    if (site->count == SITE_FILES_MAX)
        return err_say(why, ERR_RANGE, "%s: more than %d files for the page", dir, SITE_FILES_MAX);
    struct site_file *f = &site->files[site->count++]; /* counted first, so that site_finish frees it */
    f->type = type;
    /* Pages have no extension in their address, and index.html has no name either. */
    const int length = (int)(strstr(type, "html") ? strlen(name) - strlen(".html") : strlen(name));
    snprintf(f->path, sizeof(f->path), "%s%.*s", prefix, strcmp(name, "index.html") == 0 ? 0 : length, name);
    return file_load(f, path, why);
}

static enum err folder_load(struct site *site, const char *dir, const char *prefix, struct reason *why)
{
    enum err e = ERR_OK;
    DIR *d = opendir(dir);

    if (!d)
        return err_say(why, ERR_IO, "%s: the folder of the page cannot be read: %s", dir, strerror(errno));
    for (struct dirent *entry; !e && (entry = readdir(d)) != NULL;)
        e = entry_load(site, dir, prefix, entry->d_name, why);
    closedir(d);
    return e;
}

enum err site_folder(const char *requested, char *path, size_t size, struct reason *why)
{
    char program[4096];
    int length;

    if (requested) {
        length = snprintf(path, size, "%s", requested);
    } else {
        const ssize_t n = readlink("/proc/self/exe", program, sizeof(program) - 1);
        if (n <= 0)
            return err_say(why, ERR_IO, "the folder of the page cannot be found: /proc/self/exe: %s", strerror(errno));
        program[n] = '\0';
        *strrchr(program, '/') = '\0';
        length = snprintf(path, size, "%s/../share/relightd/web", program);
    }
    return length < 0 || (size_t)length >= size ? err_say(why, ERR_RANGE, "%.200s...: the path is too long", path)
                                                : ERR_OK;
}

enum err site_load(struct site *site, const char *dir, struct reason *why)
{
    enum err e;

    *site = (struct site){ 0 };
    site->files = mem_alloc(SITE_FILES_MAX, sizeof(site->files[0]));
    e = site->files ? folder_load(site, dir, "/", why) : err_say(why, ERR_NOMEM, "%s: out of memory", dir);
    if (!e && !site_find(site, "/"))
        e = err_say(why, ERR_IO, "%s: has no index.html, so it is not the folder of the page", dir);
    if (e)
        site_finish(site);
    return e;
}

void site_finish(struct site *site)
{
    for (size_t i = 0; i < site->count; i++)
        mem_free(site->files[i].bytes);
    mem_free(site->files);
    *site = (struct site){ 0 };
}

const struct site_file *site_find(const struct site *site, const char *path)
{
    if (strcmp(path, "/index.html") == 0)
        path = "/";
    for (size_t i = 0; i < site->count; i++)
        if (strcmp(site->files[i].path, path) == 0)
            return &site->files[i];
    return NULL;
}
