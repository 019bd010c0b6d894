#include "light/cache_place.h"

#include "base/digest.h"
#include "base/folder.h"

#include <ctype.h>
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

/* The camera's name as a part of a file's: what is neither a letter nor a digit becomes a low line. */
static void plain_name(const char *camera, char out[64])
{
    snprintf(out, 64, "%s", camera[0] ? camera : "camera");
    for (char *p = out; *p; p++)
        if (!isalnum((unsigned char)*p) && *p != '-')
            *p = '_';
}

/* Adds a place, unless its name is too long for one. */
static void add(struct cache_places *p, int length)
{
    p->count += length > 0 && length < CACHE_PATH;
}

static void add_own(const struct set *set, const char *camera, struct cache_places *out)
{
    const unsigned width = set->view.width, height = set->view.height;
    const char *slash = strrchr(set->file, '/');
    char *path = out->path[out->count], here[CACHE_PATH] = "";
    const char *folder = out->own;
    struct digest d = { { 0 } };

    if (folder_cache("relightd", out->own, sizeof(out->own), NULL)) {
        out->own[0] = '\0';
        return;
    }
    if (!set->file[0]) {
        add(out, snprintf(path, CACHE_PATH, "%s/builtin.%s-%ux%u.transport", folder, camera, width, height));
        return;
    }
    if (set->file[0] != '/' && !getcwd(here, sizeof(here)))
        here[0] = '\0';
    digest_bytes(&d, here, strlen(here));
    digest_bytes(&d, set->file, strlen(set->file));
    add(out, snprintf(path, CACHE_PATH, "%s/%s.%s-%ux%u-%016" PRIx64 ".transport", folder,
                      slash ? slash + 1 : set->file, camera, width, height, d.half[0]));
}

void cache_places_find(const struct set *set, const char *asked, struct cache_places *out)
{
    char camera[64];

    *out = (struct cache_places){ .count = 0 };
    if (!asked)
        return;
    if (asked[0]) {
        add(out, snprintf(out->path[0], CACHE_PATH, "%s", asked));
        return;
    }
    plain_name(set->camera, camera);
    if (set->file[0])
        add(out, snprintf(out->path[0], CACHE_PATH, "%s.%s-%ux%u.transport", set->file, camera, set->view.width,
                          set->view.height));
    add_own(set, camera, out);
}

enum err cache_place_prepare(const struct cache_places *p, int index, struct reason *why)
{
    const char *path = p->path[index], *slash = strrchr(path, '/');
    char folder[CACHE_PATH];

    if (p->own[0] && index == p->count - 1)
        return folder_make(p->own, why);
    snprintf(folder, sizeof(folder), "%.*s", slash ? (int)(slash - path) + 1 : 1, slash ? path : ".");
    if (access(folder, W_OK) != 0)
        return err_say(why, ERR_IO, "%.200s: cannot be written: %s", folder, strerror(errno));
    return ERR_OK;
}
