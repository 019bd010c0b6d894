/* Reads scene files and all that they name, in this process: call it in one that is confined (import/reader/reader.h),
 * since the libraries behind it are not made for hostile files. Thread: one at a time. */
#pragma once

#include "import/reader/host.h"
#include "scene/geometry/scene.h"

/* Reads a .json scene or a model (docs/scenes.md lists the formats) through `host`; frames it if it has no camera. On
 * ERR_OK the caller owns *out; on error *out is NULL and *why names file, place and fault. ERR_IO: a missing file.
 * ERR_FORMAT: malformed JSON or model, an unknown material. ERR_RANGE: a value outside its limits. ERR_UNSUPPORTED: an
 * unknown file format. ERR_NOMEM. Unsupported features are named once each in a warning. */
MUST_CHECK enum err import_scene(const char *path, const struct host *host, struct scene **out, struct reason *why);
