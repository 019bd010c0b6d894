/* What the texture*.c files share. Private to them. */
#ifndef SCENE_TEXTURE_PARTS_H
#define SCENE_TEXTURE_PARTS_H

#include "scene/texture.h"

#include <stdbool.h>

extern const float texture_srgb[256]; /* linear values of sRGB bytes, rising from 0 to 1 */

#endif
