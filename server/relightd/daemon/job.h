/* relightd as a job of mpirun: rank 0 is the server, and the other ranks light parts of its images (job/team/team.h).
 * Without a launcher there is no job, and these functions do nothing. Main thread. */
#pragma once

#include "base/err.h"

#include <stdbool.h>

struct shade_thread;
struct shared;
struct team;

struct job { /* zero it first */
    struct team *team;
    bool joined;    /* several ranks were started */
    char name[200]; /* of this rank, in the log */
};

/* Collective, after the configuration was read: sets s->ranks and the light settings for a job. Errors are those of
 * ranks_create. */
MUST_CHECK enum err job_join(struct job *j, struct shared *s, int argc, char **argv, struct reason *why);

/* Runs ranks other than 0 instead of the server: lights parts until rank 0 leaves. */
MUST_CHECK enum err job_serve(struct job *j, struct shared *s, struct reason *why);

/* On rank 0, before relighter_prepare: joins the other ranks, which compute the caches with it. */
MUST_CHECK enum err job_lead(struct job *j, struct shared *s, struct shade_thread *shade, struct reason *why);

/* On rank 0: ends the job on the other ranks. */
void job_leave(struct job *j);
