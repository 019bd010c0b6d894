#include "digest.h"

#include "rng.h"

#include <string.h>

void digest_begin(struct digest *d)
{
    *d = (struct digest){ { 0x6368617274u, 0x7472757468u } };
}

void digest_u64(struct digest *d, uint64_t value)
{
    d->half[0] = rng_mix(d->half[0], value);
    d->half[1] = rng_mix(value, d->half[1]);
}

void digest_bytes(struct digest *d, const void *bytes, size_t size)
{
    const unsigned char *p = bytes;

    digest_u64(d, size);
    for (size_t i = 0; i < size; i += 8) {
        uint64_t word = 0;
        memcpy(&word, p + i, size - i < 8 ? size - i : 8);
        digest_u64(d, word);
    }
}
