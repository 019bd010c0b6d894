/* Lets the ranks of a job light each image together. Each rank has a relighter of the same set; rank 0's makes the
 * images and distributes their shade points. The ranks compute the caches together when rank 0's relighter needs
 * them. During the first images with a cache each keeps more than its share, whose size the measured times then
 * decide; from then on only what its packets need of caches and G-buffer. Rank 0 alone lights images that
 * cannot be distributed (light/frame/part.h). The bits are those of one process; with `half`, those of one process with
 * relighter_round. Thread: the relighter's, which is the one that called ranks_create. */
#pragma once

#include "job/ranks/ranks.h"
#include "light/cache/cache_share.h"
#include "light/frame/relight.h"

struct team;

struct team_desc {
    struct ranks *ranks; /* not NULL */
    struct relighter *relighter;
    const struct environment_desc *environment; /* of rank 0's skies */
    const char *cache_file, *cache_dir;         /* as in struct relight_desc, for the caches of other ranks than 0 */
    const atomic_bool *cancel;                  /* ends their computation; may be NULL */
    bool whole;                                 /* rank 0 also lights images alone, and so keeps its whole G-buffer */
    bool half;                                  /* transfer light as half floats; all ranks round to half floats */
};

/* Finds the next image, its sky and its request, which the caller will run after this one, and for which *e must then
 * be unchanged; false: there is none, or it is not known yet. */
typedef bool team_next(void *context, const struct environment **e, const struct relight_desc **request);

/* Collective. Joins rank 0's relighter to the team. All borrowed objects must outlive the team. ERR_USAGE: the ranks
 * have different scenes. ERR_NOMEM. */
MUST_CHECK enum err team_create(const struct team_desc *desc, struct team **out, struct reason *why);

/* Rank 0: from now on orders the next image before the others have finished this one: next is called once this rank's
 * part is lit, and may take its time, since others get more of the points then. Between such an image and the next the
 * relighter lights no other. */
void team_look_ahead(struct team *t, team_next *next, void *context);

/* Ranks other than 0: lights parts until rank 0 destroys its team. ERR_IO: stopped (ranks_set_stop) before that. */
MUST_CHECK enum err team_serve(struct team *t, struct reason *why);

/* On rank 0, collective with the end of team_serve on the others; it logs what the images took. NULL is allowed. */
void team_destroy(struct team *t);

/* ---- Shared caches ---- */

/* Lets the ranks of a job compute a cache of light transport together: implements the functions of
 * light/cache/cache_share.h with ranks/. Thread: the relighter's. */

/* This rank's share, of all packets; ranks must outlive it. Every rank calls relighter_prepare at the same time, as
 * there is no `begin`. Errors of agree and pass are ERR_IO if a rank does not answer. */
struct cache_share team_share(struct ranks *ranks);
