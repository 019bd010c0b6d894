/* Messages between a program and its relight-reader over a seqpacket socket. The scene itself goes through a piece of
 * shared memory (parcel.h). Private to this room. */
#pragma once

#include "base/err.h"
#include "import/reader/host.h"
#include "import/sandbox/child.h"

#include <stdint.h>

#define WIRE_MAGIC 0x524c5301u /* differs between incompatible builds */

enum { WIRE_SOCKET = CHILD_SOCKET, WIRE_PARCEL, WIRE_COUNT }; /* descriptors that the process starts with */

enum wire_kind {
    WIRE_HELLO, /* code: errno if seccomp is not active */
    WIRE_OPEN,  /* text: a path; the parent answers */
    WIRE_ALLOW, /* text: a path; the parent answers */
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
