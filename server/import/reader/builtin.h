/* The built-in scene, shown if no file is given. Thread: any. */
#pragma once

#include "scene/geometry/scene.h"

/* The caller owns it. NULL: out of memory. */
struct scene *scene_create_builtin(void);
