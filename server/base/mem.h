/* The server's allocator: zeroed memory, aligned to 64 bytes (a cache line, a vector of 16 floats), with overflow
 * checks. The caller owns the block and frees it with mem_free. Thread: any. */
#pragma once

#include <stdbool.h>
#include <stddef.h>

#define MEM_ALIGN 64 /* a cache line, and a vector of AVX-512 */

/* count * size zeroed bytes. NULL on overflow or out of memory. count or size may be 0; the result is still a valid
 * pointer. */
void *mem_alloc(size_t count, size_t size);

/* As mem_alloc, but uninitialised: pages stay uncommitted until they are written. For large blocks whose size comes
 * from untrusted input. */
void *mem_alloc_raw(size_t count, size_t size);

/* As mem_alloc, in the system's large pages where it has them: for blocks of megabytes that every frame reads. A block
 * of 2 MB or more is rounded up to a multiple of that. */
void *mem_alloc_large(size_t count, size_t size);
void *mem_alloc_large_raw(size_t count, size_t size); /* uninitialised */

/* As mem_alloc, and moves the first old_count elements of `old` into it; the rest is zero. On NULL the old block is
 * unchanged. old may be NULL. */
void *mem_grow(void *old, size_t old_count, size_t count, size_t size);

/* Makes room for one more element, not initialised, behind `count` of a growing array; doubles its capacity, at first
 * 64. array: the address of the pointer to it. False when out of memory: nothing has changed. */
bool mem_reserve(void *array, size_t count, size_t *capacity, size_t size);

/* A copy of the text; NULL: out of memory. */
char *mem_text(const char *text);

void mem_free(void *p); /* also of malloc, as the texts that libraries make are; NULL is allowed */

/* Returns free memory of all allocator arenas to the system. May take some milliseconds; call it after a change of
 * working-set size. */
void mem_trim(void);
