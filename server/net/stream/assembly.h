/* Assembles an environment message (PROTOCOL.md section 7) from network pieces, directly in the frame's final memory.
 * Checks the size against the limit as soon as the header is complete, before it allocates. No sockets, no clock. One
 * thread per assembly. */
#pragma once

#include "image/codec/frame.h"
#include "net/message/message.h"
#include "protocol/relight_protocol.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define ASSEMBLY_FRAGMENTS 65536 /* maximum WebSocket fragments of a message */

/* A block of mem_alloc or mem_alloc_raw, or none: {NULL, 0}. */
struct block {
    uint8_t *bytes;
    size_t capacity;
};

struct assembly {
    size_t limit; /* largest message; set by the caller */

    struct protocol_environment header; /* valid once complete */
    struct block payload;               /* the caller may provide one, and takes the full one */

    uint8_t head[PROTOCOL_ENVIRONMENT_BYTES];
    size_t received; /* bytes of this message so far */
    size_t offset;   /* where the payload begins; 0: header incomplete */
    uint32_t fragments;
    bool under_way, whole;
};

/* Adds a piece, in[length]. `coming`: remaining bytes of the same WebSocket fragment. `last`: it is the message's last
 * fragment. With the last piece a->whole is set: the caller takes header and payload, and the next piece begins a new
 * message. Returns FAULT_NONE, or drops the message and describes the error in *fault. */
enum fault_code assembly_add(struct assembly *a, const uint8_t *in, size_t length, size_t coming, bool last,
                             struct fault *fault);

/* Drops the message and frees the block. Zeroed memory is allowed; the limit stays. */
void assembly_finish(struct assembly *a);

/* Allocates size bytes with undefined contents. ERR_NOMEM leaves {NULL, 0}. */
MUST_CHECK enum err block_reserve(struct block *b, size_t size);
void block_finish(struct block *b);

/* Converts a producer's raw texels to float RGB: fills *f as FRAME_TEXELS, top row first, and leaves its other fields
 * unchanged. Float texels are not copied: frame and payload swap blocks. ERR_NOMEM leaves FRAME_NONE. Any thread. */
MUST_CHECK enum err texels_take(struct frame *f, const struct protocol_environment *header, struct block *payload);
