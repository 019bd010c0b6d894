/* relightd as a job of mpirun: rank 0 is the server, and the other ranks light parts of its pictures (team/team.h).
 * Main thread. Without a launcher there is no job, and these do nothing. */
#ifndef DAEMON_JOB_H
#define DAEMON_JOB_H

#include "base/err.h"

#include <stdbool.h>

struct relighter;
struct shared;
struct team;

struct job { /* zeroed at first */
    struct team *team;
    bool joined;    /* several ranks were started */
    char name[200]; /* of this rank, in the log */
};

/* Collective, after the configuration was read: sets s->ranks, and what a job lights by. Errors are those of
 * ranks_create. */
MUST_CHECK enum err job_join(struct job *j, struct shared *s, int argc, char **argv, struct reason *why);

/* Ranks other than 0, in place of the server: lights parts until rank 0 leaves. */
MUST_CHECK enum err job_serve(struct job *j, struct shared *s, struct reason *why);

/* Rank 0, once its relighter is prepared, or was not for the error `own`: the other ranks prepare theirs and join. */
MUST_CHECK enum err job_lead(struct job *j, struct shared *s, struct relighter *r, enum err own, struct reason *why);

/* Rank 0: the other ranks leave. */
void job_leave(struct job *j);

#endif
