/* Where the file of a scene's cache is: beside the scene or, if that folder cannot be written and for the built-in
 * scene, in the user's cache folder. Any thread. */
#ifndef LIGHT_CACHE_PLACE_H
#define LIGHT_CACHE_PLACE_H

#include "base/err.h"
#include "light/relight.h"

#define CACHE_PLACES 2
#define CACHE_PATH 4096

struct cache_places { /* in the order of preference */
    char path[CACHE_PLACES][CACHE_PATH];
    char own[CACHE_PATH]; /* the folder of the last one, made if missing; empty: none is made */
    int count;
};

/* asked: a file, "" for the default places, NULL: none. The names contain camera and size:
 *     SCENE.CAMERA-WxH.transport   beside the scene
 *     $XDG_CACHE_HOME/relightd/SCENE.CAMERA-WxH-PATH.transport, PATH a digest of the scene's path
 *     $XDG_CACHE_HOME/relightd/builtin.CAMERA-WxH.transport */
void cache_places_find(const struct set *set, const char *asked, struct cache_places *out);

/* To be called before a file is stored there. ERR_IO: the folder does not exist or cannot be written. */
MUST_CHECK enum err cache_place_prepare(const struct cache_places *p, int index, struct reason *why);

#endif
