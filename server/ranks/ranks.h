/* server/ranks/ranks.h */
/* The processes of one MPI job, called ranks: mpirun -n 4 relight-render ... starts four. They agree on errors, take
 * numbers from one shared counter, and give their texts to rank 0. Where no launcher has started several processes,
 * there is no job: `struct ranks *` is then NULL, which all functions take for one process.
 *
 * Collective functions are called by every rank, in the same order; waiting costs no processor time.
 * Thread: the one that called ranks_create. Without MPI in the build ranks_create refuses to be one of several. */
#ifndef RANKS_RANKS_H
#define RANKS_RANKS_H

#include "base/err.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct ranks;

/* What all ranks must have in common, beside the program's file, since it decides the bits of pictures. */
struct ranks_desc {
    const char *program; /* its name, for messages */
    const char *level;   /* CPU level, as kernels_select has it */
    int argc;            /* of main; the command line */
    char *const *argv;
};

/* Collective. Joins the job, if there is one; *out is NULL if not. ERR_USAGE: the ranks differ, in what *why says on
 * rank 0, and "" on others. ERR_UNSUPPORTED: this build has no MPI, or the MPI does not allow threads. ERR_NOMEM. */
MUST_CHECK enum err ranks_create(const struct ranks_desc *desc, struct ranks **out, struct reason *why);
/* Collective. Leaves the job, once all ranks do. NULL is allowed. */
void ranks_destroy(struct ranks *r);

uint32_t ranks_index(const struct ranks *r); /* 0 .. ranks_count - 1 */
uint32_t ranks_count(const struct ranks *r); /* at least 1 */
/* "rank 2 of 4 on HOST"; lasts as long as r. */
const char *ranks_name(const struct ranks *r);
/* Threads for this rank, so that those of a host together have its processors, once each; 0: without a job. */
uint32_t ranks_threads(const struct ranks *r);

/* Collective. This rank's error, or ERR_IO if another has one: rank 0 then has a reason that names it, others "". */
MUST_CHECK enum err ranks_agree(struct ranks *r, enum err own, struct reason *why);
/* Collective. The sum over all ranks. */
uint64_t ranks_sum(struct ranks *r, uint64_t own);

/* The next number, from 0, that no rank has taken; UINT64_MAX after ranks_stop. Not for NULL. */
uint64_t ranks_take(struct ranks *r);
/* From now on no rank takes a further one. */
void ranks_stop(struct ranks *r);

/* From now on no wait lasts longer than a second once *stop is true: a rank that is gone would never answer. The job
 * then ends without ranks_destroy's farewell. Borrowed. */
void ranks_set_stop(struct ranks *r, const atomic_bool *stop);

/* Collective. Rank 0's bytes for all. ERR_IO: stopped while it waited. */
MUST_CHECK enum err ranks_broadcast(struct ranks *r, void *bytes, size_t size);

/* Rank 0 expects bytes from another rank, into memory that stays until ranks_receive, which waits for all that is
 * expected; others send theirs. At most 2 GB each. ERR_IO: stopped while it waited. ERR_NOMEM. */
MUST_CHECK enum err ranks_expect(struct ranks *r, uint32_t from, void *bytes, size_t size);
MUST_CHECK enum err ranks_receive(struct ranks *r);
MUST_CHECK enum err ranks_send(struct ranks *r, const void *bytes, size_t size);

/* Other ranks post bytes to rank 0, at most 2 GB each, which are copied: waits for the post before, not for this one.
 * No bytes are a rank's last post. ERR_NOMEM; ERR_RANGE: too many. */
MUST_CHECK enum err ranks_post(struct ranks *r, const void *bytes, size_t size);
/* Rank 0: calls take for each post that is there; with `all`, until every rank's last one. The first error of take is
 * the result, and later posts are received in vain. ERR_NOMEM. */
MUST_CHECK enum err ranks_collect(struct ranks *r, bool all,
                                  enum err (*take)(void *context, const void *bytes, size_t size), void *context);

/* Collective. Calls take(context, rank, bytes, size) on rank 0 for every rank's bytes, in order of ranks, those of rank
 * 0 included; on other ranks it is not called. ERR_NOMEM on rank 0. */
MUST_CHECK enum err ranks_gather(struct ranks *r, const void *bytes, size_t size,
                                 enum err (*take)(void *context, const void *bytes, size_t size), void *context);

#endif
