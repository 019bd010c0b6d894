/* A glTF file is read, or refused with a reason; all indices of the scene are within its arrays. Files that it names do
 * not exist. */
#include "as_file.h"
#include "harness.h"

#include "import/formats/import.h"
#include "tests/unit/scene/geometry/host_here.h"

#include <string.h>

#define LARGEST ((size_t)64 << 20) /* bytes of a file */

static void check_mesh(const struct scene *s, const struct mesh *m)
{
    require(m->material < s->material_count, "a material");
    for (size_t i = 0; i < 3 * (size_t)m->triangle_count; i++)
        require(m->indices[i] < m->vertex_count, "a vertex");
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
    struct scene *scene = NULL;
    struct reason why = { "" };
    const char *path = as_file(".gltf", bytes, size);
    struct scene_files files;

    require(scene_files_init(&files, path, LARGEST) == ERR_OK, "memory");
    struct host host = host_here(&files);
    host.time = 1.0;
    const enum err e = import_scene(path, &host, &scene, &why);

    require((e == ERR_OK) == (scene != NULL), "a scene or an error");
    require(!e || why.text[0], "a refusal has a reason");
    for (size_t i = 0; scene && i < scene->mesh_count; i++)
        check_mesh(scene, &scene->meshes[i]);
    scene_destroy(scene);
    scene_files_finish(&files);
    return 0;
}
