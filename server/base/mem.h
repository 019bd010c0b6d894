/* server/base/mem.h */
/* Every allocation of the server's rooms: zeroed, aligned to 64 bytes (a cache line, a vector of 16 floats), the
 * product checked for overflow. Free with mem_free. Any thread. */
#ifndef BASE_MEM_H
#define BASE_MEM_H

#include <stddef.h>

#define MEM_ALIGN 64

/* count * size bytes, all zero; NULL when that overflows or memory is out. count or size 0 gives a valid pointer. */
void *mem_alloc(size_t count, size_t size);

/* As mem_alloc, but what it holds is undefined, and the system need not find it real memory before it is written: for
 * large blocks whose size somebody else has claimed. */
void *mem_alloc_raw(size_t count, size_t size);

/* As mem_alloc, but what is there is moved over: the first old_count elements are kept, the rest is zero.
 * On NULL the old block is untouched. old may be NULL. */
void *mem_grow(void *old, size_t old_count, size_t count, size_t size);

void mem_free(void *p); /* NULL is allowed */

/* What the allocator keeps of freed blocks, in the arenas of all threads, goes back to the system. Takes up to some
 * milliseconds: for when something of another size than the rest has ended. */
void mem_trim(void);

#endif
