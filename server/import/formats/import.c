#include "import/formats/import.h"

#include "base/log.h"

#include <string.h>
#include <strings.h>

bool path_ends_in(const char *path, const char *ending)
{
    const char *dot = strrchr(path, '.');
    return dot && strcasecmp(dot, ending) == 0;
}

bool path_is_gltf(const char *path)
{
    return path_ends_in(path, ".gltf") || path_ends_in(path, ".glb");
}

/* A triangle of a copy takes about 200 bytes with its share of the BVH, an instance less than 1 KB; rays are faster
 * through copies. So a mesh becomes instances only where that saves 20 MB. */
bool instances_pay(double uses, size_t triangles)
{
    return triangles >= 100 && (uses - 1.0) * (double)triangles >= 100000.0;
}

/* A model as the whole scene. */
static enum err load_model(struct scene *s, const char *path, const struct host *host, struct reason *why)
{
    const struct model_desc d = {
        .host = host,
        .path = path,
        .material = MATERIAL_NONE,
        .camera = path_is_gltf(path),
        .time = host->time,
        .transform = { [0] = 1.0, [5] = 1.0, [10] = 1.0, [15] = 1.0 },
        .normals = NORMALS_FILE,
    };
    enum err e = model_load(s, &d, why);
    host->step(host->context);
    return e;
}

static void tell_of_coarser_textures(const struct scene *s, const char *path)
{
    unsigned count = 0;

    for (size_t i = 0; i < s->texture_count; i++)
        count += s->textures[i].left_out > 0;
    if (count > 0)
        log_warning("%s: %u of %zu textures have a lower resolution than their files, so that all take at most %.4g MB "
                    "(--max-texture-memory)",
                    path, count, s->texture_count, (double)s->texture_bytes / 1e6);
}

enum err import_scene(const char *path, const struct host *host, struct scene **out, struct reason *why)
{
    enum err e;

    *out = NULL;
    struct scene *s = scene_create();
    if (!s)
        return err_say(why, ERR_NOMEM, "%s: out of memory", path);
    s->texture_bytes = host->texture_bytes;
    if (path_ends_in(path, ".json"))
        e = json_load_scene(s, path, host, why);
    else
        e = load_model(s, path, host, why);
    if (!e)
        e = scene_finish(s, path, why);
    if (!e && !isnan(host->time) && !s->animated)
        log_warning("%s: --time has no effect: none of its models is an animated glTF file", path);
    if (!e && s->camera_count == 0) {
        const struct camera framing = scene_framing_camera(s);
        e = scene_add_camera(s, &framing);
    }
    if (e == ERR_NOMEM)
        err_say(why, e, "%s: out of memory", path);
    if (e) {
        scene_destroy(s);
    } else {
        tell_of_coarser_textures(s, path);
        *out = s;
    }
    return e;
}
