/* A scene's description: it is read, or refused by name; what it says lies within limits. The models that it names are
 * not there, but for none at all. */
#include "as_file.h"
#include "harness.h"

#include "scene.h"

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
