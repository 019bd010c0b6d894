/* The ranks of a job light one picture after another together. Each rank has a relighter of the same set; rank 0's is
 * the one that makes pictures, and it deals their shade points out. What cannot be dealt (light/part.h) rank 0 lights
 * alone. Bits are those of one process: floats without `half`; with it, those of relighter_round.
 * Thread: the relighter's, which is the one that called ranks_create. */
#ifndef TEAM_TEAM_H
#define TEAM_TEAM_H

#include "light/relight.h"
#include "ranks/ranks.h"

struct team;

struct team_desc {
    struct ranks *ranks; /* not NULL */
    struct relighter *relighter;
    const struct environment_desc *environment; /* of rank 0's skies */
    const char *cache_file, *cache_dir;         /* as in struct relight_desc, for caches that rank 0 computes later */
    bool half;                                  /* light comes back as half floats, and is rounded to them everywhere */
};

struct team_stats {
    uint64_t pictures, dealt; /* of rank 0; those that all ranks lit */
    uint64_t sent, received;  /* bytes of the last dealt picture: to each rank, from all ranks */
    uint64_t faces;           /* dealt pictures that needed the whole sky */
    double wait_s;            /* rank 0's, for other ranks, in all dealt pictures */
    double part_s;            /* seconds of this rank's own parts */
};

/* Collective. Joins rank 0's relighter to the team. Everything borrowed must outlive the team. ERR_USAGE: the ranks
 * have different scenes. ERR_NOMEM. */
MUST_CHECK enum err team_create(const struct team_desc *desc, struct team **out, struct reason *why);

/* Ranks other than 0: lights parts until rank 0 destroys its team. ERR_IO: stopped (ranks_set_stop) without it. */
MUST_CHECK enum err team_serve(struct team *t, struct reason *why);

/* On rank 0 collective with the end of team_serve. NULL is allowed. */
void team_destroy(struct team *t);

/* Valid as long as t. */
const struct team_stats *team_stats(const struct team *t);

#endif
