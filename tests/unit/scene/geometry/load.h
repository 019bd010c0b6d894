/* Scene files read in the test's own process. */
#pragma once

#include "scene/geometry/files.h"

#include "import/formats/import.h"
#include "scene/geometry/host_here.h"

#include <math.h>
#include <stdbool.h>

/* Set while a test loads a file that has faults on purpose. */
static bool faults_intended;

/* For tests/browser/gltf.test.mjs: with RELIGHT_KEEP_GLTF, a folder, copies each glTF file that a test wrote and the
 * reader accepted there, with the files beside it. */
static inline void keep_gltf(const char *path)
{
    static int count;
    const char *keep = getenv("RELIGHT_KEEP_GLTF"), *name = strrchr(path, '/'), *end = strrchr(path, '.');
    char to[512], command[2048];

    if (!keep || faults_intended || strncmp(path, FOLDER_PREFIX, strlen(FOLDER_PREFIX)) != 0)
        return;
    if (strcmp(end, ".gltf") != 0 && strcmp(end, ".glb") != 0)
        return;
    snprintf(to, sizeof(to), "%s/%d-%d", keep, (int)getpid(), count++);
    snprintf(command, sizeof(command), "mkdir '%s' && cp -r '%.*s/.' '%s' && echo '%s' >'%s/accepted'", to,
             (int)(name - path), path, to, name + 1, to);
    assert_int_equal(system(command), 0);
}

/* Reads a scene in this process, with animations as at this time; NAN: at rest. */
static inline enum err load_at(const char *path, double time, struct scene **out, struct reason *why)
{
    struct scene_files files;

    enum err e = scene_files_init(&files, path, (size_t)1 << 30);
    if (!e) {
        struct host host = host_here(&files);
        host.time = time;
        e = import_scene(path, &host, out, why);
    }
    scene_files_finish(&files);
    if (!e)
        keep_gltf(path);
    return e;
}

static inline enum err load_here(const char *path, struct scene **out, struct reason *why)
{
    return load_at(path, NAN, out, why);
}

static inline struct scene *load_or_fail(const char *path)
{
    struct reason why = { "" };
    struct scene *s = NULL;

    if (load_here(path, &s, &why))
        fail_msg("%s", why.text);
    return s;
}
