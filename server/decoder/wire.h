/* server/decoder/wire.h */
/* Messages between relightd and relight-decoder over a seqpacket socket. File bytes and texels are exchanged through
 * two blocks of shared memory. Private to this room. */
#ifndef DECODER_WIRE_H
#define DECODER_WIRE_H

#include "base/err.h"

#include <stdint.h>

#define WIRE_MAGIC 0x524c4432u /* differs between incompatible builds */

enum { WIRE_SOCKET = 3, WIRE_FILE = 4, WIRE_PICTURE = 5 }; /* descriptors that the process starts with */

struct wire_hello {
    uint32_t magic;
    uint32_t confined; /* 1: seccomp is active */
    int32_t error;     /* errno if it is not */
    uint32_t zero;
};

struct wire_request {
    uint32_t magic;
    uint32_t max_side; /* of the image; 0: IMAGE_MAX_SIDE */
    uint64_t size;     /* bytes of the file */
    char name[256];
};

struct wire_answer {
    uint32_t magic;
    int32_t result; /* enum err */
    uint32_t width, height, layout, zero;
    uint64_t nan, infinite, negative, clipped;
    struct reason why;
};

#endif
