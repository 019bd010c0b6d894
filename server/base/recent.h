/* server/base/recent.h */
/* Memory that is kept from one frame to the next, so that frames of a size take none from the system, is held against
 * what the last of them needed: a block that only a much larger frame was in need of is to go back. One thread, or the
 * lock of what it belongs to. */
#ifndef BASE_RECENT_H
#define BASE_RECENT_H

#include <stdbool.h>
#include <stddef.h>

#define RECENT_FRAMES 8
#define RECENT_KEPT ((size_t)16 << 20) /* bytes of a block that may always be kept */

struct recent { /* zeroed: nothing has been needed yet */
    size_t bytes[RECENT_FRAMES];
    unsigned next;
};

static inline void recent_add(struct recent *r, size_t bytes)
{
    r->bytes[r->next] = bytes;
    r->next = (r->next + 1) % RECENT_FRAMES;
}

/* Whether a block is more than four times as large as any that was needed of late. */
static inline bool recent_is_outgrown(const struct recent *r, size_t bytes)
{
    bool outgrown = bytes > RECENT_KEPT;

    for (int i = 0; i < RECENT_FRAMES; i++)
        outgrown = outgrown && bytes / 4 > r->bytes[i];
    return outgrown;
}

#endif
