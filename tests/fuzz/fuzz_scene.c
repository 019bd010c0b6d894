/* A scene description is parsed, or refused with a reason; its values are within limits. The models that it names do
 * not exist. */
#include "as_file.h"
#include "harness.h"

#include "import/formats/import.h"
#include "tests/unit/scene/geometry/host_here.h"

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
    struct scene *scene = NULL;
    struct reason why = { "" };
    const char *path = as_file(".json", bytes, size);
    struct scene_files files;

    require(scene_files_init(&files, path, (size_t)1 << 30) == ERR_OK, "memory");
    const struct host host = host_here(&files);
    const enum err e = import_scene(path, &host, &scene, &why);

    require((e == ERR_OK) == (scene != NULL), "a scene or an error");
    require(!e || why.text[0], "a refusal has a reason");
    scene_destroy(scene);
    scene_files_finish(&files);
    return 0;
}
