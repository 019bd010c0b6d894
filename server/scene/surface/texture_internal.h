/* What the texture*.c files share. Private to them. */
#pragma once

#include "scene/surface/texture.h"

extern const float texture_srgb[256]; /* linear values of sRGB bytes, rising from 0 to 1 */
