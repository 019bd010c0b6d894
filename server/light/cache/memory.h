/* The memory limit of --cache-memory. Both caches share one limit: direct light takes its share first, indirect light
 * gets the rest. All sizes are in bytes that a cache keeps once it is built. Pure functions; any thread. */
#pragma once

#include <stdbool.h>
#include <stdint.h>

#define CACHE_MEMORY_DEFAULT (UINT64_C(1024) * 1000000) /* 1024 MB, as the flag's default */

/* The limit in force, in bytes. max_bytes: the limit requested; 0: CACHE_MEMORY_DEFAULT. */
static inline uint64_t cache_memory_limit(uint64_t max_bytes)
{
    return max_bytes ? max_bytes : CACHE_MEMORY_DEFAULT;
}

/* True if a cache of `bytes` stays within the limit. */
static inline bool cache_memory_suffices(uint64_t max_bytes, uint64_t bytes)
{
    return bytes <= cache_memory_limit(max_bytes);
}

/* The limit that is left for a second cache once the first holds `taken` bytes; at least 1, since 0 means the default.
 */
static inline uint64_t cache_memory_rest(uint64_t max_bytes, uint64_t taken)
{
    const uint64_t limit = cache_memory_limit(max_bytes);

    return limit > taken ? limit - taken : 1;
}
