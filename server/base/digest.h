/* Names for what something was made of: 128 bits that change with anything that would change it. Not for adversaries.
 * Any thread. */
#ifndef BASE_DIGEST_H
#define BASE_DIGEST_H

#include <stddef.h>
#include <stdint.h>

struct digest {
    uint64_t half[2];
};

void digest_begin(struct digest *d);
void digest_bytes(struct digest *d, const void *bytes, size_t size);
void digest_u64(struct digest *d, uint64_t value);

#endif
