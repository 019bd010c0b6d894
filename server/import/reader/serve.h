/* The main function of relight-reader: confines the process, reads one scene, hands it over and ends. Thread: main. */
#pragma once

#include "import/reader/host.h"
#include "scene/geometry/scene.h"

/* argv: bytes of memory, seconds of processor time, the time of animations and bytes of textures (host.h), the scene
 * file. `import`: import_scene, or what a test puts in its place. Returns the exit code. */
int reader_serve(int argc, char **argv,
                 enum err (*import)(const char *path, const struct host *host, struct scene **out, struct reason *why));
