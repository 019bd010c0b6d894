/* Decides when to free a buffer that is reused from frame to frame: it compares the buffer's size with what the last
 * RECENT_FRAMES frames needed, so that one large frame does not pin its memory. Thread: that of the buffer's owner. */
#pragma once

#include <stdbool.h>
#include <stddef.h>

#define RECENT_FRAMES 8
#define RECENT_KEPT ((size_t)16 << 20) /* bytes; smaller buffers are always kept */

struct recent { /* zeroed: no frame yet */
    size_t bytes[RECENT_FRAMES];
    unsigned next;
};

static inline void recent_add(struct recent *r, size_t bytes)
{
    r->bytes[r->next] = bytes;
    r->next = (r->next + 1) % RECENT_FRAMES;
}

/* Whether a buffer is more than four times as large as any recent frame needed. */
static inline bool recent_is_outgrown(const struct recent *r, size_t bytes)
{
    bool outgrown = bytes > RECENT_KEPT;

    for (int i = 0; i < RECENT_FRAMES; i++)
        outgrown = outgrown && bytes / 4 > r->bytes[i];
    return outgrown;
}
