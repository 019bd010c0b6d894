/* One panel of the chart: a scene under a sky in one class of light, with the results of every technique at every
 * budget. panel_measure fills it; then it is only read. One thread of control. */
#pragma once

#include "light/frame/relight.h"
#include "measure/chart/errors.h"
#include "measure/chart/judge.h"
#include "measure/chart/series.h"
#include "measure/chart/technique.h"
#include "measure/chart/truth.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct progress;

#define BUDGETS_MAX 16
#define SEEDS_MAX 256

/* Stages that are common to all techniques: medians over all rounds, in ms, are added to every technique's time. */
enum common_part {
    COMMON_DECODE,
    COMMON_REBUILD, /* resampling onto the cube map, and its sampling tables */
    COMMON_TONE,
    COMMON_ENCODE, /* JPEG */
    COMMON_PARTS,
};
const char *common_name(enum common_part part); /* "decode", ... */

struct panel_point { /* one technique at one budget */
    uint32_t budget, samples, eye_paths;
    uint64_t particles, rays;
    double expected; /* relMSE without bias, as estimated by auto, mean over the seeds; 0: by others */
    struct band seconds, errors[ERROR_KINDS]; /* over the seeds */
    struct judge_floor floor;
};

struct panel_curve {
    const struct technique *technique;
    struct reason left_out; /* the reason why it was not measured; "": it was */
    const char *bias;       /* what the method computes wrongly, in words; NULL: nothing */
    double prepared_ms;     /* of TECHNIQUE_PREPARED: its precomputation for the scene; part of no other time */
    uint64_t prepared_bytes;
    struct panel_point *points; /* [budget_count] */
    double *seconds;            /* [budget_count][seeds]: whole frames */
    double *errors;             /* [ERROR_KINDS][budget_count][seeds] */
    float *images;            /* [budget_count][height][width][3]: those of the first seed */
};

struct panel {
    char scene[128], source[128]; /* titles */
    enum light_class light_class;
    uint32_t width, height, seeds, budget_count;
    uint32_t budgets[BUDGETS_MAX];
    size_t curve_count;
    struct panel_curve *curves; /* in the order of the legend */

    double common_ms[COMMON_PARTS];
    double load_ms, bvh_ms, gbuffer_ms, table_ms; /* once, before the first frame; table: of resampling */
    uint64_t points, casters, behind, gbuffer_bytes;

    struct truth truth;
    struct judge judge;
    uint8_t *mask;    /* [height][width]: pixels that see a surface */
    double gain_log2; /* the reference's exposure: its log-average luminance to middle grey */
};

struct panel_desc {
    const char *scene, *source; /* titles */
    const struct prepared_scene *set;
    const struct kernels *kernels;
    struct environment *environment; /* of `frame`; decoded and rebuilt again and again, always to the same */
    const struct frame *frame;
    enum light_class light_class;
    const uint32_t *budgets; /* ascending */
    uint32_t budget_count, seeds;
    const char *techniques; /* a list of names with commas between; NULL: all */
    uint32_t truth_samples;
    const char *cache;     /* folder; NULL: none */
    double table_ms;       /* as the caller measured it */
    struct progress *line; /* stepped by panel_work in all; may be NULL */
};

/* The steps of the progress line, which take about the same time each. */
uint64_t panel_work(const struct panel_desc *desc);

/* Measures a panel: for each seed, for each budget, all techniques in turn, so that a noisy moment of the machine
 * affects all alike. All images are kept until they are compared: 12 bytes times pixels, techniques,
 * budgets and seeds, 660 MB for 12, 5 and 16 at 320x180; ERR_RANGE above 8 GiB. On an error *out is NULL: those of
 * truth.h, ERR_NOMEM. Free with panel_destroy. */
MUST_CHECK enum err panel_measure(const struct panel_desc *desc, struct panel **out, struct reason *why);
void panel_destroy(struct panel *p); /* NULL is allowed */

/* The references that a panel needs. */
struct truth_desc panel_truth(const struct panel_desc *desc);

/* Frees images and references, most of the memory; the rest serves the tables. */
void panel_drop_images(struct panel *p);

/* Whether the list names the technique. panel_check_techniques returns ERR_USAGE for an unknown name. */
bool panel_takes(const char *techniques, const struct technique *t);
MUST_CHECK enum err panel_check_techniques(const char *techniques, struct reason *why);

/* A curve's error for series.h. */
struct curve panel_curve_of(const struct panel *p, size_t curve, enum error_kind kind);

/* "noon, direct light" and the like, for people. */
void panel_title(const struct panel *p, char *title, size_t size);
