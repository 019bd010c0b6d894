#define _DEFAULT_SOURCE /* madvise */
#include "base/mem.h"

#include <assert.h>
#include <malloc.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#define FIRST_ROOM 64                /* elements */
#define LARGE_PAGE ((size_t)2 << 20) /* bytes */

void *mem_alloc_raw(size_t count, size_t size)
{
    if (size != 0 && count > (SIZE_MAX - MEM_ALIGN) / size)
        return NULL;
    /* aligned_alloc requires a nonzero multiple of the alignment */
    return aligned_alloc(MEM_ALIGN, (count * size + MEM_ALIGN) / MEM_ALIGN * MEM_ALIGN);
}

void *mem_alloc(size_t count, size_t size)
{
    void *p = mem_alloc_raw(count, size);

    if (p)
        memset(p, 0, count * size);
    return p;
}

void *mem_alloc_large_raw(size_t count, size_t size)
{
    if ((size != 0 && count > (SIZE_MAX - LARGE_PAGE) / size) || count * size < LARGE_PAGE)
        return mem_alloc_raw(count, size);
    const size_t bytes = (count * size + LARGE_PAGE - 1) / LARGE_PAGE * LARGE_PAGE;
    void *p = aligned_alloc(LARGE_PAGE, bytes);
    if (p)
        (void)madvise(p, bytes, MADV_HUGEPAGE); /* where it fails, the pages are small */
    return p;
}

void *mem_alloc_large(size_t count, size_t size)
{
    void *p = mem_alloc_large_raw(count, size);

    if (p)
        memset(p, 0, count * size);
    return p;
}

void *mem_grow(void *old, size_t old_count, size_t count, size_t size)
{
    assert(count >= old_count);
    void *p = mem_alloc(count, size);
    if (!p)
        return NULL;
    if (old)
        memcpy(p, old, old_count * size);
    mem_free(old);
    return p;
}

bool mem_reserve(void *array, size_t count, size_t *capacity, size_t size)
{
    const size_t more = *capacity ? 2 * *capacity : FIRST_ROOM;
    void *old;

    if (count < *capacity)
        return true;
    memcpy(&old, array, sizeof(old));
    void *grown = mem_alloc_raw(more, size);
    if (!grown)
        return false;
    if (old)
        memcpy(grown, old, count * size);
    mem_free(old);
    memcpy(array, &grown, sizeof(grown));
    *capacity = more;
    return true;
}

char *mem_text(const char *text)
{
    const size_t size = strlen(text) + 1;
    char *copy = mem_alloc_raw(size, 1);

    return copy ? memcpy(copy, text, size) : NULL;
}

void mem_free(void *p)
{
    free(p);
}

void mem_trim(void)
{
    malloc_trim(0);
}
