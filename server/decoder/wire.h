/* server/decoder/wire.h */
/* What relightd and relight-decoder say to each other, over a socket that keeps messages apart. A file's bytes and a
 * picture's texels do not go over it but lie in two pieces of memory that both have mapped. Inside this room only. */
#ifndef DECODER_WIRE_H
#define DECODER_WIRE_H

#include "err.h"

#include <stdint.h>

#define WIRE_MAGIC 0x524c4432u /* another build of the other end shows here */

enum { WIRE_SOCKET = 3, WIRE_FILE = 4, WIRE_PICTURE = 5 }; /* descriptors that the process begins with */

struct wire_hello {
    uint32_t magic;
    uint32_t confined; /* 1: seccomp is in force */
    int32_t error;     /* errno, when it is not */
    uint32_t zero;
};

struct wire_request {
    uint32_t magic;
    uint32_t most_side; /* of the picture; 0: IMAGE_MAX_SIDE */
    uint64_t size;      /* of the file */
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
