/* server/base/scratch.h */
/* Memory that a library needs while it reads or writes one file, served from one block that is kept for the next: after
 * a few files of a kind none of it comes from the system. The block is twice as large as the most that a file had in
 * its hands at once, at most SCRATCH_MOST; what does not fit comes from mem_alloc, as if there were no block. One
 * thread at a time. */
#ifndef BASE_SCRATCH_H
#define BASE_SCRATCH_H

#include <stddef.h>

#define SCRATCH_MOST ((size_t)32 << 20) /* bytes that are kept */

struct scratch;

struct scratch *scratch_create(void);    /* NULL when out of memory */
void scratch_destroy(struct scratch *s); /* NULL is allowed */

/* A new file: gives back what is still in hand of the last one, up to 256 pieces, and enlarges the block where it has
 * been too small. */
void scratch_begin(struct scratch *s); /* NULL is allowed */

/* As mem_alloc(bytes, 1) and mem_free, which they are where s is NULL. */
void *scratch_take(struct scratch *s, size_t bytes);
void scratch_give(struct scratch *s, void *p); /* p may be NULL */

#endif
