/* Where the file of a scene's cache is: one that was named, or one in the cache folder, whose name contains a digest of
 * everything that the cache depends on. Any thread. */
#ifndef LIGHT_CACHE_PLACE_H
#define LIGHT_CACHE_PLACE_H

#include "base/digest.h"
#include "base/err.h"
#include "light/relight.h"

#define CACHE_PATH 4096

struct cache_place {
    char path[CACHE_PATH];   /* empty: nothing is kept */
    char folder[CACHE_PATH]; /* the cache folder; empty: a file was named */
};

/* file: of --cache-file, a path, "" for the cache folder, NULL: nothing is kept. folder: of --cache-dir, NULL for the
 * default (cache/cache_folder.h). A file in the folder is SCENE.CAMERA-WxH-KEY.transport. ERR_USAGE, ERR_IO: there is
 * no such place, and out->path is empty. */
MUST_CHECK enum err cache_place_find(const struct set *set, const char *file, const char *folder,
                                     const struct digest *key, struct cache_place *out, struct reason *why);

/* To be called before a file of so many bytes is stored there: makes the folder, and room in it. ERR_IO: the folder
 * does not exist or cannot be written; ERR_RANGE: the file is too large for the cache folder. */
MUST_CHECK enum err cache_place_prepare(const struct cache_place *p, uint64_t bytes, struct reason *why);

#endif
