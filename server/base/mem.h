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

/* ---- Temporary memory ---- */

/* An arena for the temporary memory that a library needs to read or write one file. It serves allocations from one
 * block that is kept for the next file, so that after a few similar files nothing comes from the system. The block
 * grows to twice the peak use of a file, at most SCRATCH_MAX; what does not fit comes from mem_alloc. Thread: one at a
 * time. */

#define SCRATCH_MAX ((size_t)32 << 20) /* bytes kept between files */

struct scratch;

struct scratch *scratch_create(void);    /* NULL when out of memory */
void scratch_destroy(struct scratch *s); /* NULL is allowed */

/* Begins a file: frees the previous file's pieces (up to 256) and enlarges the block if it was too small. */
void scratch_begin(struct scratch *s); /* NULL is allowed */

/* As mem_alloc(bytes, 1) and mem_free; exactly these if s is NULL. */
void *scratch_alloc(struct scratch *s, size_t bytes);
void scratch_free(struct scratch *s, void *p); /* p may be NULL */

/* ---- Buffers that are reused ---- */

/* Decides when to free a buffer that is reused from frame to frame: it compares the buffer's size with what the last
 * RECENT_FRAMES frames needed, so that one large frame does not pin its memory. Thread: that of the buffer's owner. */

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
