/* OBJ and MTL files, brought into a form that Assimp reads without loss. Thread: any. */
#pragma once

#include "import/reader/host.h"

#include <stdbool.h>

/* Rewrites the contents of an OBJ file: statements at the beginnings of lines, without comments; numbers with a digit
 * before the point; with `smooth`, normals for faces of smoothing groups that have none; coordinates that begin far
 * from the origin are counted from origin[], else (0, 0, 0). Reports statements that are left out under `name`.
 * ERR_FORMAT: a face has a corner that is no vertex. On an error the file is at most no longer UTF-16. */
MUST_CHECK enum err obj_text(struct bytes *file, const char *name, bool smooth, double origin[3], struct reason *why);

/* The same for an MTL file: colours of three numbers, names of images last and without quotes. Adds the names of its
 * materials to *names, a line each, which the caller frees with mem_free; NULL: none so far. ERR_NOMEM: both are
 * unchanged. */
MUST_CHECK enum err mtl_text(struct bytes *file, char **names);
