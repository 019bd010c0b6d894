/* Decides what a frame computes and why, for the server and all tools, and runs the decision.
 *
 * An explicit method is used unchanged. METHOD_AUTO with sample counts follows rules (light/estimators/method.h for
 * direct light, light/plan/plan.h for the rest), so the same input gives the same bits. METHOD_AUTO with a time budget
 * or a target error measures (pilot.h). METHOD_AUTO uses the light transport cache if its bias is allowed and
 * light/plan/cost_model.h finds that it pays off. With counts that is decided before the first frame; with a time or an
 * error after measured frames, or at once if the cache is computed in the background. Thread: the relighter's. */
#pragma once

#include "light/frame/pilot.h"
#include "light/frame/relight.h"
#include "light/plan/cost_model.h"

enum decided_by {
    DECIDED_BY_REQUEST,  /* the request named the method */
    DECIDED_BY_RULE,     /* auto, with sample counts; denoised while the cache is being computed */
    DECIDED_BY_MEASURES, /* auto, with a time or an error */
    DECIDED_BY_CACHE,    /* auto, with the light transport cache instead of measurements */
};

struct frame_request { /* zeroed: sample counts, the number of frames unknown */
    const struct relight_desc *asked;
    struct budget_target target; /* zeroed: use sample counts */
    uint64_t frames_left;        /* after this one; 0: unknown */
    double allow_bias;           /* relMSE: auto may use estimators with at most this bias; 0: only unbiased ones */
    bool no_cache;               /* auto must not compute the cache because no later frame could use it */
    bool background; /* auto computes its cache while frames are rendered; else decider_learn waits for it */
    /* By decide: */
    enum decided_by by;
    const char *why;           /* a phrase; static */
    struct relight_desc light; /* the request, or that of the cache */
};

struct decider {         /* zero it first; decider_finish frees it */
    struct pilot *pilot; /* NULL until a frame is decided by measurement */
    struct {             /* auto's cache, which belongs to the relighter */
        bool looked_for; /* a file was searched for */
        bool begun;      /* its computation has started */
        bool hurried;    /* wanted in the background, including indirect light, which images lack without it */
        bool ready;      /* frames use it */
        bool refused;    /* it needs too much memory */
        uint64_t images; /* made before it could be used, if hurried */
        uint64_t measured_frames;
        double sample_s, frame_s; /* seconds per light sample of a point, and per measured frame; smoothed */
        double spent_s;           /* on measured frames */
        double image_s;           /* seconds per image beside its computation that takes samples; smoothed */
        double error;             /* requested relMSE, else that of the last measured frame */
        double share;             /* computed share, as of the last query */
        unsigned glide;           /* relight_stats.glides of the last denoised image */
        struct cost_verdict last; /* the last decision; why NULL: none yet */
    } cache;
};

void decider_finish(struct decider *d); /* leaves it zeroed */

/* Before the first frame of a request with a time or an error: makes the relighter load the cache if the request allows
 * its bias, or else start to compute it in the background, with indirect light only after that frame. Does nothing
 * without `background`, or when called again. */
void decider_begin(struct decider *d, struct relighter *r, const struct frame_request *request);

/* Decides the next frame. */
void decide(const struct decider *d, struct frame_request *request);

/* Runs a decided request: rgb float[height][width][3], linear. *measured is filled if request->by is
 * DECIDED_BY_MEASURES, else zeroed. All calls with d must pass the same r. Errors are those of relighter_run. */
MUST_CHECK enum err decider_run(struct decider *d, struct relighter *r, const struct environment *e,
                                const struct frame_request *request, float *rgb, struct relight_stats *stats,
                                struct pilot_stats *measured);

/* Call it after each frame of decider_run, once the frame is published. The frame's cost decides whether the relighter
 * loads or computes the cache. decide() uses the cache once it is complete or, in the background, once its coarse
 * blocks are more accurate than the frames. A lack of memory for the cache is logged. */
void decider_learn(struct decider *d, struct relighter *r, const struct frame_request *request,
                   const struct relight_stats *stats, const struct pilot_stats *measured);

/* For requests with sample counts, before the first frame. The decision depends on neither the number of frames nor the
 * clock nor a file of an earlier run. If the cache's bias is allowed and it pays off, *light becomes the cache's, with
 * the request's samples. Prepares the relighter for *light in either case, in *ms milliseconds. Errors are those of
 * relighter_prepare, but too little memory for the cache is not an error. */
MUST_CHECK enum err decider_prepare(struct decider *d, struct relighter *r, double allow_bias, bool progress,
                                    struct relight_desc *light, double *ms);

/* True while the cache is computed in the background. */
bool decider_is_computing(const struct decider *d, struct relighter *r);

/* Seconds that a measured image may take, out of interval_s, the interval between images without a cache. */
double decider_target_s(const struct decider *d, struct relighter *r, double interval_s);

/* Minimum seconds between images while a cache is computed in the background: fewer images leave more time for the
 * cache. 0: no limit. */
double decider_interval_s(const struct decider *d);
