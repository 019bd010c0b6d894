#include "scene.h"

struct scene *scene_create_builtin(void)
{
    return 0;
}
