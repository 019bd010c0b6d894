/* server/chart/video.h */
/* The error of moving pictures, drawn: what no single frame shows. A sky that turns slowly about the scene tells
 * flicker and the error of frame differences (motion.h) at several budgets; a step, an even grey sky from which the sun
 * comes out at once, tells in how many frames a picture answers: the light itself, and what is shown of it after the
 * exposure that follows the picture (film.h). Direct light. Main thread; uses all OpenMP threads. */
#ifndef CHART_VIDEO_H
#define CHART_VIDEO_H

#include "err.h"
#include "kernels.h"
#include "series.h"
#include "text.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct progress;

#define VIDEO_WAYS 5
#define VIDEO_BUDGETS_MAX 4
#define VIDEO_SEQUENCES_MAX 2
#define VIDEO_BEFORE 5 /* frames before the step */
#define VIDEO_AFTER 30

struct video_way { /* a technique of technique.h, and what its random numbers do from frame to frame */
    const char *name, *technique;
    const char *about;
    bool reseed;     /* other ones in each frame, as --reseed */
    uint32_t colour; /* 0xrrggbb; 0: the ink's */
};
extern const struct video_way video_ways[VIDEO_WAYS];

struct video_point { /* a way at a budget; over the seeds */
    struct band flicker, change, error, milliseconds;
};

struct video_sequence {
    char source[128];   /* title */
    double degrees;     /* that the sky turns by in a frame */
    double still_share; /* of the pixels that see a surface */
    struct video_point points[VIDEO_WAYS][VIDEO_BUDGETS_MAX];
    float
        *maps[VIDEO_WAYS]; /* [height][width]: flicker of each pixel, at the budget in the middle, of the first seed */
    float *picture;        /* [height][width][3]: the truth of the first frame */
};

struct video_step { /* at the budget in the middle; medians over the seeds, frame by frame; VIDEO_BEFORE of them before
                       the step */
    double error[VIDEO_WAYS][VIDEO_BEFORE + VIDEO_AFTER];   /* relMSE */
    double display[VIDEO_WAYS][VIDEO_BEFORE + VIDEO_AFTER]; /* delta E of what is shown against the truth, as it is
                                                             * shown once the exposure has settled */
    double exposure[VIDEO_BEFORE + VIDEO_AFTER];            /* the same of the truth: the exposure's own part */
};

struct video {
    uint32_t width, height, frames, seeds, budget_count, truth_samples;
    uint32_t budgets[VIDEO_BUDGETS_MAX];
    double still; /* share that a pixel may vary by and still stand still */
    char scene[128];
    bool takes[VIDEO_WAYS]; /* those that were asked for */
    struct video_sequence sequences[VIDEO_SEQUENCES_MAX];
    uint32_t sequence_count;
    struct video_step step;
    double seconds; /* that all of it took */
};

struct video_desc {
    const char *scene, *scene_spec; /* title; a file, or NULL for the built-in scene */
    const char *sources;            /* chart.h's list: of the first VIDEO_SEQUENCES_MAX */
    const char *techniques;         /* names with commas between; NULL: all */
    const struct kernels *kernels;
    const char *cache;      /* folder of references; NULL: none */
    bool quick;             /* 48x27 pixels and 12 frames, else 96x54 and 48 */
    uint32_t width, height; /* if these are fewer pixels they are taken; 0 */
    struct progress *line;  /* stepped by video_work in all; may be NULL */
};

/* Whether any of the ways is asked for. */
bool video_takes_any(const char *techniques);

/* How much there is to do, in the units of panel_work. */
uint64_t video_work(const struct video_desc *desc);

/* On an error *out is NULL: those of set_create, of sources and of truth.h, ERR_NOMEM. Free with video_destroy. */
MUST_CHECK enum err video_measure(const struct video_desc *desc, struct video **out, struct reason *why);
void video_destroy(struct video *v); /* NULL is allowed */

/* All numbers, one a row: sequence, way, budget, frame (of the step, 0 being the first with the sun), quantity, and its
 * 10 %, median and 90 % over the seeds. */
void video_csv(struct text *t, const struct video *v);

/* The charts, as video-*.svg into the folder. ERR_IO, ERR_NOMEM, ERR_UNSUPPORTED: no gnuplot. */
MUST_CHECK enum err video_draw(const struct video *v, const char *folder, struct reason *why);

/* Its section of the page, from the files that video_draw made. ERR_NOMEM, ERR_IO, ERR_FORMAT. */
MUST_CHECK enum err video_add_section(struct text *t, const struct video *v, const char *folder, struct reason *why);

#endif
