/* Where what was computed for a scene beforehand is kept as a file: beside the scene, or, where that folder cannot be
 * written and for the scene that has no file, among the user's caches. */
#ifndef LIGHT_CACHE_PLACE_H
#define LIGHT_CACHE_PLACE_H

#include "base/err.h"
#include "light/relight.h"

#define CACHE_PLACES 2
#define CACHE_PATH 4096

struct cache_places { /* in the order in which they are looked at */
    char path[CACHE_PLACES][CACHE_PATH];
    char own[CACHE_PATH]; /* the folder of the last of them, which is made where it is missing; empty: it is not */
    int count;
};

/* asked: a file, "" for the usual places, NULL: none. The names say camera and size:
 *     SCENE.CAMERA-WxH.transport   beside the scene
 *     $XDG_CACHE_HOME/relightd/SCENE.CAMERA-WxH-PATH.transport, PATH a digest of the scene's path
 *     $XDG_CACHE_HOME/relightd/builtin.CAMERA-WxH.transport */
void cache_places_find(const struct set *set, const char *asked, struct cache_places *out);

/* Before something is stored there. ERR_IO: there is no such folder, or it cannot be written. */
MUST_CHECK enum err cache_place_prepare(const struct cache_places *p, int index, struct reason *why);

#endif
