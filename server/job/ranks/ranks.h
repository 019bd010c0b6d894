/* The processes of one MPI job, called ranks: mpirun -n 4 relight-render ... starts four. They agree on errors, take
 * numbers from one shared counter, and send their texts to rank 0. Unless a launcher has started several processes,
 * there is no job: `struct ranks *` is then NULL, which all functions treat as a single process.
 *
 * Collective functions are called by every rank, in the same order; waiting costs no processor time. Thread: the one
 * that called ranks_create. In a build without MPI, ranks_create fails in a process that is one of several. */
#pragma once

#include "base/digest.h"
#include "base/err.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <stdnoreturn.h>

struct ranks;

/* Properties that all ranks must share, besides the program's file, because they determine the bits of images. */
struct ranks_desc {
    const char *program; /* its name, for messages */
    const char *level;   /* CPU level, as kernels_select has it */
    int argc;            /* of main; the command line */
    char *const *argv;
};

bool ranks_available(void); /* whether this build has MPI */

/* Collective. Joins the job, if there is one; *out is NULL if not. ERR_USAGE: the ranks differ. ERR_UNSUPPORTED: the
 * MPI does not allow threads; in both cases rank 0 has logged the reason and *why is "". ERR_UNSUPPORTED with a reason:
 * this build has no MPI. ERR_NOMEM. */
MUST_CHECK enum err ranks_create(const struct ranks_desc *desc, struct ranks **out, struct reason *why);
/* Collective. Leaves the job once all ranks do. NULL is allowed. */
void ranks_destroy(struct ranks *r);

uint32_t ranks_index(const struct ranks *r); /* 0 .. ranks_count - 1 */
uint32_t ranks_count(const struct ranks *r); /* at least 1 */
/* "rank 2 of 4 on HOST"; lasts as long as r. */
const char *ranks_name(const struct ranks *r);
/* The number of threads for this rank, so that the ranks of a host share its processors without overlap; 0 without a
 * job. */
uint32_t ranks_threads(const struct ranks *r);

/* Collective. Returns this rank's error, or ERR_IO if only another rank has one: *why names that rank on rank 0 and is
 * "" on others. */
MUST_CHECK enum err ranks_agree(struct ranks *r, enum err own, struct reason *why);
/* Collective. The sum over all ranks. */
uint64_t ranks_sum(struct ranks *r, uint64_t own);

/* The next number from the shared counter, which begins at 0; no two ranks get the same one. UINT64_MAX after
 * ranks_stop. r must not be NULL. */
uint64_t ranks_take(struct ranks *r);
/* Asks for the number that the next ranks_take returns, so that it need not wait: call it shortly before. */
void ranks_ask(struct ranks *r);
/* From now on ranks_take returns no numbers on any rank. */
void ranks_stop(struct ranks *r);

/* From now on ranks_broadcast, ranks_receive, ranks_send and ranks_sent wait for at most a second once *stop is true: a
 * rank that has died would never answer. The job then ends without the synchronisation in ranks_destroy. Borrowed. */
void ranks_set_stop(struct ranks *r, const atomic_bool *stop);

/* Ends the processes of all ranks at once, after an error that others would wait for. Logs `text`. mpirun returns 1. */
noreturn void ranks_abort(const struct ranks *r, const char *text);

/* Collective. Copies the bytes of rank 0, or of rank `from`, to all ranks. ERR_IO: stopped while waiting. */
MUST_CHECK enum err ranks_broadcast(struct ranks *r, void *bytes, size_t size);
MUST_CHECK enum err ranks_broadcast_from(struct ranks *r, uint32_t from, void *bytes, size_t size);
/* Collective. Each rank's number, in all[ranks_count]. */
void ranks_share_number(struct ranks *r, double own, double *all);

/* Two images can be on their way at once: turn 0 and turn 1. Rank 0 begins the broadcast of a turn's bytes, expects
 * answers from other ranks, and ranks_receive waits for all of them, in the order of ranks, for waited[k] seconds each
 * (double[ranks_count]; NULL: it does not matter); the memory must stay valid until then. The others
 * call ranks_broadcast for the same bytes. ERR_IO: stopped while waiting. ERR_RANGE: an answer above 2 GB, or
 * broadcasts above 512 MB. */
MUST_CHECK enum err ranks_begin_broadcast(struct ranks *r, int turn, void *bytes, size_t size);
MUST_CHECK enum err ranks_expect(struct ranks *r, int turn, uint32_t from, void *bytes, size_t size);
MUST_CHECK enum err ranks_receive(struct ranks *r, int turn, double *waited);

/* Other ranks begin to send an answer, once the one before is sent. Its bytes must stay valid until the end of the next
 * ranks_send or ranks_sent, which waits for the last. Errors as above. */
MUST_CHECK enum err ranks_send(struct ranks *r, const void *bytes, size_t size);
MUST_CHECK enum err ranks_sent(struct ranks *r);

/* Ranks other than 0 post bytes to rank 0, at most 2 GB each. The bytes are copied; the call waits for the previous
 * post, not for this one. An empty post is a rank's last one. ERR_NOMEM; ERR_RANGE: too many. */
MUST_CHECK enum err ranks_post(struct ranks *r, const void *bytes, size_t size);
/* Rank 0: calls take for each post that has arrived; with `all`, until every rank's last post. Returns the first error
 * of take, after which posts are received but ignored. ERR_NOMEM. */
MUST_CHECK enum err ranks_collect(struct ranks *r, bool all,
                                  enum err (*take)(void *context, const void *bytes, size_t size), void *context);

/* Collective. Calls take(context, rank, bytes, size) on rank 0 for every rank's bytes, in the order of ranks, including
 * its own; other ranks do not call take. ERR_NOMEM on rank 0. */
MUST_CHECK enum err ranks_gather(struct ranks *r, const void *bytes, size_t size,
                                 enum err (*take)(void *context, const void *bytes, size_t size), void *context);

/* ---- Launchers ---- */

/* Whether a launcher has started this process as one of several, and whether the processes of a job are alike. Private
 * to this room. */

/* True if started by Open MPI, or by a launcher with PMI or PMIx, such as MPICH's and Slurm's. A single process is not
 * one of several. */
static inline bool ranks_launched(void)
{
    static const char *const sizes[] = { "OMPI_COMM_WORLD_SIZE", "PMI_SIZE" };
    const char *tasks = getenv("SLURM_STEP_NUM_TASKS");

    for (size_t k = 0; k < sizeof(sizes) / sizeof(sizes[0]); k++) {
        const char *size = getenv(sizes[k]);
        if (size && atoi(size) > 1)
            return true;
    }
    return getenv("PMIX_RANK") && tasks && atoi(tasks) > 1;
}

/* ---- ranks_identity.c ---- */

/* What must be equal on all ranks of a job, and the host, which names one that differs. Plain data, sent as bytes. */
struct rank_identity {
    char host[64], level[16]; /* host name; CPU level of the kernels */
    struct digest program, arguments;
};

/* Fills *own for this process: digests of its executable and of desc's arguments. Thread: the main one. */
void rank_identify(const struct ranks_desc *desc, struct rank_identity *own);
/* Compares the identities of all `count` ranks. ERR_USAGE if they differ; *why then names the rank and the difference.
 * All ranks see the same list, so they come to the same result. Thread: the main one. */
MUST_CHECK enum err rank_compare(const struct rank_identity *all, int count, const char *program, struct reason *why);
