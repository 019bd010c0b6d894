/* The path of a scene's cache file: either a given path, or a file in the cache folder whose name contains a digest of
 * everything that the cache depends on. Thread: any. */
#pragma once

#include "base/digest.h"
#include "base/err.h"

#include <stdbool.h>
#include <stdint.h>

#define CACHE_PATH 4096 /* PATH_MAX of Linux */

struct cache_place {
    char path[CACHE_PATH];   /* empty: the cache is not stored */
    char folder[CACHE_PATH]; /* the cache folder; empty: the path was given */
};

/* The view that a cache belongs to. */
struct cache_view {
    const char *scene, *camera; /* the scene's file and the camera's name; "": the built-in scene, no name */
    uint32_t width, height;
};

/* file: the argument of --cache-file; "": use the cache folder; NULL: do not store the cache. folder: the argument of
 * --cache-dir; NULL: the default (light/cache/cache_folder.h). A file in the folder is SCENE.CAMERA-WxH-KEY.transport.
 * ERR_USAGE, ERR_IO: the place does not exist, and out->path is empty. */
MUST_CHECK enum err cache_place_find(const struct cache_view *view, const char *file, const char *folder,
                                     const struct digest *key, struct cache_place *out, struct reason *why);

/* Call it before storing a file of `bytes`: creates the folder and frees room in it. ERR_IO: the folder does not exist
 * or cannot be written; ERR_RANGE: the file is too large for the cache folder. */
MUST_CHECK enum err cache_place_prepare(const struct cache_place *p, uint64_t bytes, struct reason *why);

/* ---- The digest of the code ---- */

/* A digest of the code that computes the caches of light transport, made at build time (cache_code.cmake): sources of
 * the rooms that a cache's bits depend on, and compiler and flags. It is part of a stored cache's key, so that no
 * build loads a cache that it would compute differently. */

extern const char cache_code[]; /* 64 hexadecimal digits */
