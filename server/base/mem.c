#include "base/mem.h"

#include <assert.h>
#include <malloc.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

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

void mem_free(void *p)
{
    free(p);
}

void mem_trim(void)
{
    malloc_trim(0);
}
