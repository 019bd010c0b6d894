/* 128-bit digests (XXH3 of xxHash) that identify what a cached file was computed from. They detect accidental changes;
 * they do not resist an attacker who constructs collisions. The result is the same on all little-endian processors.
 * Thread: any, one thread per digest. */
#pragma once

#include <stddef.h>
#include <stdint.h>

/* Zeroed memory is an empty digest. */
struct digest {
    uint64_t half[2];
};

/* Adds `size` bytes as one item. Splitting the same bytes into two items gives another digest. bytes may be NULL if
 * size is 0. */
void digest_bytes(struct digest *d, const void *bytes, size_t size);

/* Adds a number as its 8 bytes in native byte order. */
void digest_u64(struct digest *d, uint64_t value);
