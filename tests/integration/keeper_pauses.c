/* Says at the end whether a thread paused for longer than a message allows after this process had posted one: for
 * LD_PRELOAD in ranks.sh. */
#include <mpi.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdio.h>
#include <time.h>

#define TAG_POST 5        /* of ranks_mpi.c, */
#define POSTING_NS 2000000 /* and its longest pause while messages are under way */

static atomic_bool posted, calm;

int MPI_Isend(const void *bytes, int count, MPI_Datatype type, int to, int tag, MPI_Comm comm, MPI_Request *q)
{
    const int result = PMPI_Isend(bytes, count, type, to, tag, comm, q);

    if (tag == TAG_POST)
        atomic_store(&posted, true);
    return result;
}

int nanosleep(const struct timespec *pause, struct timespec *left)
{
    if (atomic_load(&posted) && pause->tv_nsec > POSTING_NS)
        atomic_store(&calm, true);
    return clock_nanosleep(CLOCK_MONOTONIC, 0, pause, left) ? -1 : 0;
}

__attribute__((destructor)) static void say(void)
{
    if (atomic_load(&posted))
        fprintf(stderr, "keeper: %s after a post\n", atomic_load(&calm) ? "calm" : "never calm");
}
