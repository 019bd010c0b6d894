#include "scene_build.h"

enum err gltf_add_materials(struct scene *s, const struct aiScene *ai, const char *path, uint32_t *first,
                            struct reason *why)
{
    (void)ai;
    *first = (uint32_t)s->material_count;
    return err_say(why, ERR_UNSUPPORTED, "%s: glTF", path);
}
