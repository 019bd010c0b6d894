/* `auto` and the cache of light transport: learns from frames that are made by other means what they cost, and has the
 * relighter load or compute the cache where plan/buy.h says that it pays. One thread of control. */
#ifndef FILM_BUYER_H
#define FILM_BUYER_H

#include "buy.h"
#include "pilot.h"
#include "relight.h"

struct buyer {   /* zeroed at first */
    bool looked; /* for a file */
    bool begun;  /* it is being computed, or was */
    bool ready;  /* frames are to be made by buyer_light */
    bool refused;
    uint64_t made;
    double sample_s, frame_s, spent_s;
    double error;    /* of the last frame by the pilot, or as it was wished for */
    struct buy last; /* the answer, and why */
};

/* Whether the cache may stand for what was asked for: direct light by METHOD_AUTO, without wishes as to how, nor a
 * picture without shadows. */
bool buyer_may(const struct relight_desc *light);

/* light, by the cache. What auto has computed without being asked is kept in no file but one that was named. */
struct relight_desc buyer_light(const struct relight_desc *light);

/* By counts, before the first of so many frames (0: unknown), so that the same command gives the same bits wherever it
 * is run: no clock decides, nor whether a file of some earlier run lies there. Where it pays *light becomes
 * buyer_light's, with its own count of samples. As relighter_prepare else, and where there is no memory for it. */
MUST_CHECK enum err buyer_prepare(struct buyer *b, struct relighter *r, const struct set *set, uint64_t frames,
                                  bool progress, struct relight_desc *light, double *ms);

struct buyer_wish {
    uint64_t left;   /* frames still to come; 0: unknown. Whoever knows that none will asks no more */
    double error;    /* relMSE that was asked for; 0: none was */
    bool background; /* it is computed while frames are made; else this call waits for it */
};

/* After a frame by the pilot, none before. r: what the cache is for. Sets b->ready when the next frame can be made by
 * it, of what is computed in the background as soon as its coarse blocks are better than the frames are; until then,
 * and for ever where it does not pay, frames are made as before. That there is no memory for it is a line in the log.
 */
void buyer_step(struct buyer *b, struct relighter *r, const struct set *set, const struct relight_desc *light,
                const struct relight_stats *stats, const struct pilot_stats *pilot, const struct buyer_wish *wish);

/* After a frame by the cache. refused: for want of memory it is no more, which may turn out after its coarse blocks. */
void buyer_watch(struct buyer *b, bool refused);

#endif
