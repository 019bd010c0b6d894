/* tests/unit/scene/load.h */
/* Scene files read in the test's own process. */
#ifndef TESTS_SCENE_LOAD_H
#define TESTS_SCENE_LOAD_H

#include "support/unit.h"

#include "import/import.h"
#include "reader/files.h"

/* Reads a scene in this process. */
static inline enum err load_here(const char *path, struct scene **out, struct reason *why)
{
    struct scene_files files;

    enum err e = scene_files_init(&files, path, (size_t)1 << 30);
    if (!e) {
        const struct host host = scene_files_host(&files);
        e = import_scene(path, &host, out, why);
    }
    scene_files_finish(&files);
    return e;
}

static inline struct scene *load_or_fail(const char *path)
{
    struct reason why = { "" };
    struct scene *s = NULL;

    if (load_here(path, &s, &why))
        fail_msg("%s", why.text);
    return s;
}

#endif
