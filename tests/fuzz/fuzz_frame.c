/* A producer's message in pieces: the first byte sets their size, the second whether each is a separate fragment, the
 * rest is the message. It must be accepted exactly if it is valid as a whole. */
#include "harness.h"

#include "net/stream/ingest.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LIMIT 4096

/* FAULT_NONE: the message is whole. */
static enum fault_code feed(struct assembly *a, const uint8_t *bytes, size_t size, size_t piece, int fragments,
                            struct fault *fault)
{
    size_t at = 0;

    do {
        const size_t n = piece < size - at ? piece : size - at;
        const size_t coming = fragments ? 0 : size - at - n;
        if (assembly_add(a, bytes + at, n, coming, !fragments || at + n == size, fault))
            return fault->code;
        at += n;
    } while (at < size);
    return FAULT_NONE;
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
    struct assembly a = { .limit = LIMIT };
    struct protocol_environment e;
    struct fault fault;
    size_t offset;

    if (size < 2)
        return 0;
    const uint8_t *message = bytes + 2;
    const size_t length = size - 2;
    const int sound =
        length <= LIMIT && protocol_environment_decode(message, length, length, &e, &offset) == PROTOCOL_OK;
    for (int turn = 0; turn < 2; turn++) { /* the second reuses the first one's state */
        const enum fault_code code = feed(&a, message, length, (size_t)bytes[0] + 1, bytes[1] & 1, &fault);
        require((code == FAULT_NONE) == sound, "taken when it is sound, and only then");
        require(!a.under_way, "over after its last byte");
        if (code) {
            require(fault.clause[0] == '7' && fault.text[0], "a fault names its clause");
            require(code == FAULT_BAD_FIELD || code == FAULT_TOO_BIG, "a fault of a frame");
            require(a.payload.capacity <= LIMIT, "no memory above the limit");
        } else {
            uint8_t got[PROTOCOL_ENVIRONMENT_BYTES], want[PROTOCOL_ENVIRONMENT_BYTES];
            protocol_environment_encode(&a.header, got);
            protocol_environment_encode(&e, want);
            require(a.whole && memcmp(got, want, sizeof(got)) == 0, "the same header");
            require(memcmp(a.payload.bytes, message + offset, e.payload) == 0, "the same payload");
        }
    }
    assembly_finish(&a);
    return 0;
}
