/* The requests of code that reads a scene to the side that may open files (in relight-reader the parent process, in
 * tests the same process, files.h), and the options with which the scene is read. Thread: one at a time. */
#pragma once

#include "base/err.h"
#include "scene/geometry/scene.h"

#include <stddef.h>
#include <stdint.h>

#define HOST_PATH_MAX 4096 /* bytes of a path, its end included */

struct host {
    /* Opens a regular file for reading; the caller owns *fd. ERR_IO: missing, not a file, or outside of the folders
     * that may be read. ERR_RANGE: too large. *why begins with the path. */
    enum err (*open)(void *context, const char *path, int *fd, size_t *size, struct reason *why);
    /* Permits the folder of this file, which the scene file names. Before the first `open` of another file than the
     * scene's own; ERR_USAGE later. */
    enum err (*allow)(void *context, const char *path, struct reason *why);
    void (*step)(void *context); /* one model has been read */
    void *context;
    double time;            /* s, 0 or more: animations stand as they are then; NAN: models are at rest */
    uint64_t texture_bytes; /* limit on all textures (scene_add_texture); 0: none */
};

/* The contents of a file. Free with bytes_finish. */
struct bytes {
    uint8_t *at;
    size_t size;
};

/* Reads a whole file. Errors of host.open; ERR_NOMEM; ERR_IO: cannot be read. */
MUST_CHECK enum err host_read(const struct host *h, const char *path, struct bytes *out, struct reason *why);
void bytes_finish(struct bytes *b); /* zeroed memory is allowed */

/* ---- The program ---- */

/* The main function of relight-reader: confines the process, reads one scene, hands it over and ends. Thread: main. */

/* argv: bytes of memory, seconds of processor time, the time of animations and bytes of textures (host.h), the scene
 * file. `import`: import_scene, or what a test puts in its place. Returns the exit code. */
int reader_serve(int argc, char **argv,
                 enum err (*import)(const char *path, const struct host *host, struct scene **out, struct reason *why));
