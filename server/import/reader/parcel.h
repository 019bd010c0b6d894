/* A scene as one file of flat arrays, which relight-reader passes to its parent. The parent trusts none of it: it
 * checks each size, index and value, on a copy that the other process cannot change. Thread: one at a time. */
#pragma once

#include "scene/geometry/scene.h"

/* Writes the scene to fd from the current position on, and frees its arrays on the way, so that there is never more
 * than one of them twice. ERR_RANGE: larger than the process may write. ERR_IO. */
MUST_CHECK enum err parcel_write(int fd, struct scene *s, struct reason *why);

/* Reads such a file from its beginning. On ERR_OK the caller owns *out; on error *out is NULL and *why begins with
 * `name`. ERR_FORMAT: not what parcel_write writes. ERR_IO, ERR_NOMEM. */
MUST_CHECK enum err parcel_read(int fd, const char *name, struct scene **out, struct reason *why);
