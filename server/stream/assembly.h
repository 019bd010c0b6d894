/* server/stream/assembly.h */
/* Puts an environment message (PROTOCOL.md section 7) together from the pieces in which a network brings it, straight
 * into the memory that the frame will keep. Its size is held against the limit as soon as its header is there, before
 * memory is taken. A function of its pieces: no socket and no clock. One thread each. */
#ifndef STREAM_ASSEMBLY_H
#define STREAM_ASSEMBLY_H

#include "message.h"
#include "relight_protocol.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define ASSEMBLY_FRAGMENTS 65536 /* WebSocket fragments that one message may come in */

/* A block of mem_alloc or mem_alloc_raw, or none: {NULL, 0}. */
struct block {
    uint8_t *bytes;
    size_t capacity;
};

struct assembly {
    size_t limit; /* largest message; set by the caller */

    struct protocol_environment header; /* once all of it is there */
    struct block payload;               /* the caller may give one to be used, and takes the full one out */

    uint8_t head[PROTOCOL_ENVIRONMENT_BYTES];
    size_t received; /* bytes of this message so far */
    size_t offset;   /* where its payload begins, once the header is there; else 0 */
    uint32_t fragments;
    bool under_way, whole;
};

/* One more piece. `coming`: bytes of the same WebSocket fragment that are still to come. `last`: that fragment is the
 * message's last. Sets a->whole with the last piece: header and payload are then the caller's to take, and the next
 * piece begins a message. On a fault, said in *fault, the message is over. */
enum fault_code assembly_add(struct assembly *a, const uint8_t *in, size_t length, size_t coming, bool last,
                             struct fault *fault);

/* Forgets what has begun, and frees the block. Zeroed memory is allowed; the limit stays. */
void assembly_finish(struct assembly *a);

/* Makes room for size bytes, whose contents are undefined. ERR_NOMEM leaves {NULL, 0}. */
MUST_CHECK enum err block_reserve(struct block *b, size_t size);
void block_finish(struct block *b);

#endif
