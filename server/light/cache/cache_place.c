#include "light/cache/cache_file.h"

#include <ctype.h>
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define PART 64 /* bytes of a name's part */

/* Makes a name safe for file names: replaces characters other than letters and digits by underscores. */
static void plain_name(const char *name, char out[PART])
{
    snprintf(out, PART, "%.*s", PART - 1, name);
    for (char *p = out; *p; p++)
        if (!isalnum((unsigned char)*p) && *p != '-' && *p != '.')
            *p = '_';
}

/* The start of the names in the cache folder. */
static void scene_name(const struct cache_view *view, char out[PART])
{
    const char *slash = strrchr(view->scene, '/');

    plain_name(slash ? slash + 1 : view->scene[0] ? view->scene : "builtin", out);
}

enum err cache_place_find(const struct cache_view *view, const char *file, const char *folder, const struct digest *key,
                          struct cache_place *out, struct reason *why)
{
    char scene[PART], camera[PART];
    int n = 0;

    *out = (struct cache_place){ .path = "" };
    if (!file)
        return ERR_OK;
    if (file[0]) {
        n = snprintf(out->path, CACHE_PATH, "%s", file);
    } else {
        const enum err e = cache_folder_find(folder, out->folder, sizeof(out->folder), why);
        if (e)
            return e;
        scene_name(view, scene);
        plain_name(view->camera[0] ? view->camera : "camera", camera);
        n = snprintf(out->path, CACHE_PATH, "%s/%s.%s-%ux%u-%016" PRIx64 "%016" PRIx64 CACHE_FOLDER_SUFFIX, out->folder,
                     scene, camera, view->width, view->height, key->half[0], key->half[1]);
    }
    if (n > 0 && n < CACHE_PATH)
        return ERR_OK;
    out->path[0] = '\0';
    return err_say(why, ERR_IO, "%.200s...: the path of the cache's file is too long", file[0] ? file : out->folder);
}

enum err cache_place_prepare(const struct cache_place *p, uint64_t bytes, struct reason *why)
{
    const char *slash = strrchr(p->path, '/');
    char folder[CACHE_PATH];

    if (p->folder[0]) {
        const enum err e = cache_folder_prepare(p->folder, why);
        return e ? e : cache_folder_trim(p->folder, p->path, bytes, CACHE_FOLDER_BYTES, why);
    }
    snprintf(folder, sizeof(folder), "%.*s", slash ? (int)(slash - p->path) + 1 : 1, slash ? p->path : ".");
    if (access(folder, W_OK) != 0)
        return err_say(why, ERR_IO, "%.200s: cannot be written: %s", folder, strerror(errno));
    return ERR_OK;
}
