/* Releases memory of a G-buffer page by page, so that the rest stays in place. */
#define _DEFAULT_SOURCE /* madvise: POSIX's own may keep the pages */
#include "scene/geometry/gbuffer.h"

#include <sys/mman.h>
#include <unistd.h>

/* Releases the pages that lie within the bytes; returns their size. */
static uint64_t release(void *bytes, size_t size)
{
    const uintptr_t page = (uintptr_t)sysconf(_SC_PAGESIZE);
    const uintptr_t first = ((uintptr_t)bytes + page - 1) / page * page, end = ((uintptr_t)bytes + size) / page * page;

    return end > first && madvise((void *)first, end - first, MADV_DONTNEED) == 0 ? end - first : 0;
}

void gbuffer_release_packets(struct gbuffer *g, uint32_t first, uint32_t end)
{
    g->bytes -= release(g->packets + first, (end - first) * sizeof(*g->packets));
}

void gbuffer_release_pixels(struct gbuffer *g)
{
    const size_t pixels = (size_t)g->width * g->height;

    g->bytes -= release(g->entries, g->entry_first[pixels] * sizeof(*g->entries));
    g->bytes -= release(g->misses, g->miss_first[pixels] * sizeof(*g->misses));
    g->bytes -= release(g->entry_first, (pixels + 1) * sizeof(*g->entry_first));
    g->bytes -= release(g->miss_first, (pixels + 1) * sizeof(*g->miss_first));
    if (g->glow)
        g->bytes -= release(g->glow, pixels * 3 * sizeof(*g->glow));
}
