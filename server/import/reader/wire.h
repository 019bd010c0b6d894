/* Messages between a program and its relight-reader (import/sandbox/helper_process.h). The scene itself goes through a
 * piece of shared memory (wire.h). Private to this room. */
#pragma once

#include "base/err.h"
#include "import/reader/host.h"
#include "import/sandbox/helper_process.h"
#include "scene/geometry/scene.h"

#include <stdint.h>

enum { WIRE_PARCEL = WIRE_SOCKET + 1, WIRE_COUNT }; /* descriptors that the process starts with */

enum wire_kind {
    WIRE_OPEN = 1, /* text: a path; the parent answers */
    WIRE_ALLOW,    /* text: a path; the parent answers */
    WIRE_STEP,
    WIRE_LOG,  /* code: enum log_level; text: a line */
    WIRE_DONE, /* code: enum err; text: why */
};

struct wire_message { /* from the process */
    uint32_t magic;
    uint32_t kind;
    int32_t code;
    uint32_t zero;
    char text[HOST_PATH_MAX];
};

struct wire_answer { /* from the parent, with a descriptor if a file was opened */
    uint32_t magic;
    int32_t code;  /* enum err */
    uint64_t size; /* of the file */
    struct reason why;
};

/* ---- Scenes as flat arrays ---- */

/* A scene as one file of flat arrays, which relight-reader passes to its parent. The parent trusts none of it: it
 * checks each size, index and value, on a copy that the other process cannot change. Thread: one at a time. */

/* Writes the scene to fd from the current position on, and frees its arrays on the way, so that there is never more
 * than one of them twice. ERR_RANGE: larger than the process may write. ERR_IO. */
MUST_CHECK enum err parcel_write(int fd, struct scene *s, struct reason *why);

/* Reads such a file from its beginning. On ERR_OK the caller owns *out; on error *out is NULL and *why begins with
 * `name`. ERR_FORMAT: not what parcel_write writes. ERR_IO, ERR_NOMEM. */
MUST_CHECK enum err parcel_read(int fd, const char *name, struct scene **out, struct reason *why);
