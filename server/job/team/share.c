#include "job/team/team.h"

#include "base/mem.h"

static enum err agree(void *context, enum err own, struct reason *why)
{
    return ranks_agree(context, own, why);
}

/* Without memory for another rank's bytes the job ends: the others would wait. */
static enum err pass(void *context, uint32_t from, uint8_t **bytes, size_t *size)
{
    struct ranks *r = context;
    uint64_t length = *size;
    enum err e = ranks_broadcast_from(r, from, &length, sizeof(length));

    if (e)
        return e;
    if (from != ranks_index(r)) {
        *bytes = mem_alloc_raw((size_t)length + 1, 1);
        *size = (size_t)length;
        if (!*bytes)
            ranks_abort(r, "out of memory for another rank's part of the cache");
    }
    return ranks_broadcast_from(r, from, *bytes, (size_t)length);
}

struct cache_share team_share(struct ranks *ranks)
{
    return (struct cache_share){
        .index = ranks_index(ranks), .count = ranks_count(ranks), .context = ranks, .agree = agree, .pass = pass
    };
}
