/* A scene description is parsed, or refused with a reason; its values are within limits. The models that it names do
 * not exist. */
#include "as_file.h"
#include "harness.h"

#include "scene/scene.h"

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
    struct scene *scene = NULL;
    struct reason why = { "" };
    const enum err e = scene_load(as_file(".json", bytes, size), &scene, NULL, &why);

    require((e == ERR_OK) == (scene != NULL), "a scene or an error");
    require(!e || why.text[0], "a refusal has a reason");
    scene_destroy(scene);
    return 0;
}
