/* server/chart/video_runs.h */
/* What the two halves of video.h share: the stage, the truth of a frame and a single run. Main thread. */
#ifndef CHART_VIDEO_RUNS_H
#define CHART_VIDEO_RUNS_H

#include "environment.h"
#include "frame.h"
#include "judge.h"
#include "relight.h"
#include "technique.h"
#include "truth.h"
#include "video.h"

struct video_runs {
    const struct video_desc *desc;
    struct video *video;
    struct set *set;
    uint8_t *mask;                                  /* [height][width]: pixels that see a surface */
    const struct technique *techniques[VIDEO_WAYS]; /* NULL: not asked for */
};

/* A sky that can be turned. */
struct video_light {
    struct frame frame; /* as it came */
    struct environment *environment;
    struct frame turned; /* what lights the scene, unless `columns` is 0 */
    float *texels;       /* those of `frame`, lat-long */
    uint32_t columns;    /* a step; 0: the environment is turned, not the map */
    double degrees;      /* a step */
};
/* On an error it wants its finish too. */
MUST_CHECK enum err video_light_init(struct video_light *l, const char *source, struct reason *why);
MUST_CHECK enum err video_light_turn(struct video_light *l, uint32_t steps, struct reason *why);
void video_light_finish(struct video_light *l); /* zeroed memory is allowed */

/* On ERR_OK both want their finish. */
MUST_CHECK enum err video_truth(const struct video_runs *r, const struct video_light *l, struct truth *truth,
                                struct judge *judge, struct reason *why);

/* What one way remembers from frame to frame, under one seed at one budget. */
MUST_CHECK enum err video_stage_init(struct technique_stage *s, const struct video_runs *r, int way,
                                     struct reason *why);
void video_stage_finish(struct technique_stage *s); /* zeroed memory is allowed */

/* The time of a picture that a pilot is given at a budget, as the chart gives it (technique_pace). */
MUST_CHECK enum err video_pace(const struct video_runs *r, const struct video_light *l, uint32_t budget, float *rgb,
                               double *seconds, struct reason *why);

/* One picture, the frame's number deciding the random numbers of a way that takes new ones. */
MUST_CHECK enum err video_run(const struct video_runs *r, struct technique_stage *stage, int way,
                              const struct video_light *l, uint32_t budget, uint32_t seed, uint32_t frame, float *rgb,
                              double *seconds, struct reason *why);

/* Fills video->step. */
MUST_CHECK enum err video_measure_step(const struct video_runs *r, struct reason *why);
uint64_t video_step_work(const struct video_desc *desc);

#endif
