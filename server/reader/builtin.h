/* The built-in scene, shown if no file is given. Thread: any. */
#ifndef READER_BUILTIN_H
#define READER_BUILTIN_H

#include "scene/scene.h"

/* The caller owns it. NULL: out of memory. */
struct scene *scene_create_builtin(void);

#endif
