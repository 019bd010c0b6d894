/* server/light/decide.h */
/* What a frame computes, and why: one answer for the server and the tools, and one function that runs it.
 *
 * A method that was named is kept to. METHOD_AUTO with counts follows rules (method.h for direct light, plan.h for the
 * rest): the same input gives the same bits. METHOD_AUTO with a time or an error is measured (pilot.h). And METHOD_AUTO
 * takes the cache of light transport for many frames, once buy.h says that it pays: by counts before the first frame,
 * or from measured frames while they come. One thread of control, that of the relighter. */
#ifndef LIGHT_DECIDE_H
#define LIGHT_DECIDE_H

#include "choose/buy.h"
#include "light/pilot.h"
#include "light/relight.h"

enum decided_by {
    DECIDED_BY_REQUEST,  /* the method was named */
    DECIDED_BY_RULE,     /* auto, by counts of samples */
    DECIDED_BY_MEASURES, /* auto, by a time or an error */
    DECIDED_BY_CACHE,    /* auto, the cache of light transport instead of measuring */
};

struct frame_request { /* zeroed: by counts, and nothing is known of other frames */
    const struct relight_desc *light;
    struct pilot_target target; /* zeroed: by counts */
    uint64_t frames_left;       /* after this one; 0: unknown */
    bool no_cache;              /* auto must not take it: no frame comes that it could serve */
    bool background;            /* auto computes its cache while frames are made; else decider_learn waits for it */
};

struct decision {
    enum decided_by by;
    const char *why;           /* a phrase; static */
    struct relight_desc light; /* what is run: the request's, or that of the cache */
};

struct decider {         /* zeroed at first; decider_finish frees it */
    struct pilot *pilot; /* NULL until a frame is decided by measures */
    struct {             /* auto's cache, which the relighter holds */
        bool looked_for; /* in a file */
        bool begun;      /* it is being computed, or was */
        bool ready;      /* frames are made by it */
        bool refused;    /* it takes too much memory */
        uint64_t measured_frames;
        double sample_s, frame_s; /* seconds a light sample of a point, and a frame by measures; smoothed */
        double spent_s;           /* on frames by measures */
        double error;             /* relMSE of the last of them, or as it was requested */
        struct buy last;          /* the last answer; why NULL: buy.h was never asked */
    } cache;
};

void decider_finish(struct decider *d); /* leaves it zeroed */

/* Pure. */
void decide(const struct decider *d, const struct frame_request *request, struct decision *out);

/* The picture of a decision: rgb float[height][width][3], linear. *measured is filled where decision->by is
 * DECIDED_BY_MEASURES, else zeroed. r must be the same while d lives. Errors are those of relighter_run. */
MUST_CHECK enum err decider_run(struct decider *d, struct relighter *r, const struct environment *e,
                                const struct frame_request *request, const struct decision *decision, float *rgb,
                                struct relight_stats *stats, struct pilot_stats *measured);

/* After each frame of decider_run, when it has been shown: what it cost decides whether the relighter loads or computes
 * the cache. Frames are decided by it from when it is there; of what is computed in the background, from when its
 * coarse blocks are better than the frames are. That memory is too short is a line in the log. */
void decider_learn(struct decider *d, struct relighter *r, const struct frame_request *request,
                   const struct decision *decision, const struct relight_stats *stats,
                   const struct pilot_stats *measured);

/* By counts, before the first of so many frames (0: unknown): no clock decides, nor whether a file of some earlier run
 * lies there. Where the cache pays, *light becomes that of the cache, with its own count of samples. Prepares the
 * relighter for *light in either case; *ms: what that took. Errors are those of relighter_prepare, but no memory for
 * the cache is none. */
MUST_CHECK enum err decider_prepare(struct decider *d, struct relighter *r, uint64_t frames, bool progress,
                                    struct relight_desc *light, double *ms);

/* Whether the cache is being computed beside the frames. */
bool decider_is_computing(const struct decider *d, struct relighter *r);

#endif
