/* Messages between a program and its relight-reader (import/sandbox/wire.h). The scene itself goes through a piece of
 * shared memory (parcel.h). Private to this room. */
#pragma once

#include "base/err.h"
#include "import/reader/host.h"
#include "import/sandbox/wire.h"

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
