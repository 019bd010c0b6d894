#include "base/digest.h"

#include <xxhash.h>

/* Chained: hashes each item's hash and size together with the digest so far. */
void digest_bytes(struct digest *d, const void *bytes, size_t size)
{
    const XXH128_hash_t item = XXH3_128bits(bytes, size);
    const uint64_t link[] = { d->half[0], d->half[1], size, item.low64, item.high64 };
    const XXH128_hash_t next = XXH3_128bits(link, sizeof(link));

    *d = (struct digest){ { next.low64, next.high64 } };
}

void digest_u64(struct digest *d, uint64_t value)
{
    digest_bytes(d, &value, sizeof(value));
}
