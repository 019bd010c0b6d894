/* server/light/decide.h */
/* Decides what a frame computes, and why, for the server and all tools, and runs it.
 *
 * A named method is used as it is. METHOD_AUTO with counts follows rules (estimators/method.h for direct light,
 * choose/plan.h for the rest): the same input gives the same bits. METHOD_AUTO with a time or an error measures
 * (pilot.h). And METHOD_AUTO uses the cache of light transport where its bias is allowed and choose/buy.h says so: by
 * counts before the first frame; by a time or an error from measured frames as they come, or at once where the cache is
 * computed in the background. One thread of control, that of the relighter. */
#ifndef LIGHT_DECIDE_H
#define LIGHT_DECIDE_H

#include "choose/buy.h"
#include "light/pilot.h"
#include "light/relight.h"

enum decided_by {
    DECIDED_BY_REQUEST,  /* the method was named */
    DECIDED_BY_RULE,     /* auto, by counts of samples; denoised where the cache is on its way */
    DECIDED_BY_MEASURES, /* auto, by a time or an error */
    DECIDED_BY_CACHE,    /* auto, the cache of light transport instead of measuring */
};

struct frame_request { /* zeroed: by counts, the number of frames unknown */
    const struct relight_desc *light;
    struct pilot_target target; /* zeroed: by counts */
    uint64_t frames_left;       /* after this one; 0: unknown */
    double allow_bias;          /* relMSE: auto may use estimators of this bias; 0: unbiased ones alone */
    bool no_cache;              /* auto must not compute the cache: no further frame could use it */
    bool background;            /* auto computes its cache while frames are made; else decider_learn waits for it */
};

struct decision {
    enum decided_by by;
    const char *why;           /* a phrase; static */
    struct relight_desc light; /* of the request, or of the cache */
};

struct decider {         /* zeroed at first; decider_finish frees it */
    struct pilot *pilot; /* NULL until a frame is decided by measures */
    struct {             /* auto's cache, which belongs to the relighter */
        bool looked_for; /* in a file */
        bool begun;      /* it is being computed, or was */
        bool hurried;    /* wanted in the background, with indirect light, which pictures lack without it */
        bool ready;      /* frames are made by it */
        bool refused;    /* it takes too much memory */
        uint64_t measured_frames;
        double sample_s, frame_s; /* seconds per light sample of a point, and per measured frame; smoothed */
        double spent_s;           /* on measured frames */
        double picture_s;         /* of a picture by the cache while it is being computed; smoothed */
        double error;             /* requested relMSE, else that of the last measured frame */
        double share;             /* of the computation, when last asked */
        struct buy last;          /* the last decision; why NULL: there was none */
    } cache;
};

void decider_finish(struct decider *d); /* leaves it zeroed */

/* Before the first frame of a request with a time or an error: has the relighter load the cache if the request allows
 * its bias; else begin to compute it in the background, with indirect light only after that frame. Does nothing without
 * `background`, or again. */
void decider_begin(struct decider *d, struct relighter *r, const struct frame_request *request);

/* Decides the next frame. Pure. */
void decide(const struct decider *d, const struct frame_request *request, struct decision *out);

/* Runs a decision: rgb float[height][width][3], linear. *measured is filled if decision->by is DECIDED_BY_MEASURES,
 * else zeroed. r must be the same while d lives. Errors are those of relighter_run. */
MUST_CHECK enum err decider_run(struct decider *d, struct relighter *r, const struct environment *e,
                                const struct frame_request *request, const struct decision *decision, float *rgb,
                                struct relight_stats *stats, struct pilot_stats *measured);

/* To be called after each frame of decider_run, once it is published: its cost decides whether the relighter loads or
 * computes the cache, which decide() uses as soon as it is complete or, in the background, as soon as its coarse blocks
 * are better than the frames. Too little memory for it is logged. */
void decider_learn(struct decider *d, struct relighter *r, const struct frame_request *request,
                   const struct decision *decision, const struct relight_stats *stats,
                   const struct pilot_stats *measured);

/* By counts, before the first frame; neither their number nor the clock nor a file of an earlier run decides. If the
 * cache's bias is allowed and it serves, *light becomes that of the cache, with the request's samples. Prepares the
 * relighter for *light in either case, in *ms milliseconds. Errors are those of relighter_prepare, except that too
 * little memory for the cache is none. */
MUST_CHECK enum err decider_prepare(struct decider *d, struct relighter *r, double allow_bias, bool progress,
                                    struct relight_desc *light, double *ms);

/* True while the cache is computed in the background. */
bool decider_is_computing(const struct decider *d, struct relighter *r);

/* Seconds that a measured picture may take of interval_s, the time from one to the next without a cache. */
double decider_target_s(const struct decider *d, struct relighter *r, double interval_s);

/* Seconds from one picture to the next, at least, while a cache is computed in the background: the fewer pictures, the
 * sooner it is there. 0: there is no reason to wait. */
double decider_interval_s(const struct decider *d);

#endif
