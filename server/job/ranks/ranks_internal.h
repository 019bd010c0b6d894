/* Whether a launcher has started this process as one of several, and whether the processes of a job are alike. Private
 * to this room. */
#pragma once

#include "base/digest.h"
#include "job/ranks/ranks.h"

#include <stdbool.h>
#include <stdlib.h>

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
