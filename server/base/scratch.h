/* An arena for the temporary memory that a library needs to read or write one file. It serves allocations from one
 * block that is kept for the next file, so that after a few similar files nothing comes from the system. The block
 * grows to twice the peak use of a file, at most SCRATCH_MAX; what does not fit comes from mem_alloc. Thread: one at a
 * time. */
#pragma once

#include <stddef.h>

#define SCRATCH_MAX ((size_t)32 << 20) /* bytes kept between files */

struct scratch;

struct scratch *scratch_create(void);    /* NULL when out of memory */
void scratch_destroy(struct scratch *s); /* NULL is allowed */

/* Begins a file: frees the previous file's pieces (up to 256) and enlarges the block if it was too small. */
void scratch_begin(struct scratch *s); /* NULL is allowed */

/* As mem_alloc(bytes, 1) and mem_free; exactly these if s is NULL. */
void *scratch_alloc(struct scratch *s, size_t bytes);
void scratch_free(struct scratch *s, void *p); /* p may be NULL */
