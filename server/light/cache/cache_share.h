/* Several processes that compute one cache together. A cache consists of units, such as its blocks. Each process
 * computes every `count`-th unit, then each passes its units to the others, and each keeps the units that it needs. The
 * bits are those of one process. Process 0 has all units until the cache is stored. */
#pragma once

#include "base/err.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* The functions are collective: all processes call them in the same order. Thread: the relighter's. */
struct cache_share {
    uint32_t index, count;         /* this process, 0 .. count - 1 */
    uint32_t first, end;           /* packets whose light it computes; end 0: all */
    void *context, *begin_context; /* of agree and pass; of begin */
    /* Called by process 0 before the cache is loaded or computed, for others to do the same; NULL: they do so
     * already. request: a struct relight_desc. */
    enum err (*begin)(void *context, const void *request);
    /* Returns this process's error, or ERR_IO if only another one has an error. */
    enum err (*agree)(void *context, enum err own, struct reason *why);
    /* Copies the bytes of process `from` to the others, which free *bytes with mem_free. */
    enum err (*pass)(void *context, uint32_t from, uint8_t **bytes, size_t *size);
};

/* Whether this process computes a unit. s NULL: a single process. */
static inline bool cache_share_computes(const struct cache_share *s, uint32_t unit)
{
    return !s || unit % s->count == s->index;
}

/* Whether this process needs a packet's part of the cache. */
static inline bool cache_share_needs(const struct cache_share *s, uint32_t packet)
{
    return !s || s->end == 0 || (packet >= s->first && packet < s->end);
}

/* Whether it receives and loads units that only other packets need. */
static inline bool cache_share_takes_all(const struct cache_share *s)
{
    return !s || s->index == 0;
}
