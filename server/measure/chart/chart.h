/* The whole chart: every scene under every sky in every class of light. Files are written after each panel, so that an
 * interrupted run leaves a shorter chart. Main thread; uses all OpenMP threads. */
#pragma once

#include "base/err.h"
#include "import/reader/reader.h"
#include "job/ranks/ranks.h"
#include "light/frame/decide.h"
#include "light/frame/relight.h"
#include "measure/chart/judge.h"

#include <jansson.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct kernels;

struct chart_desc {
    struct scene_reading reading; /* of reading one */
    const char *scenes;     /* scene files or "builtin", separated by semicolons; each may begin with a title and an
                             * equals sign */
    const char *sources;    /* sources, likewise; the first frame of each is used */
    const char *out;        /* folder, made if missing */
    const char *cache;      /* folder of references; NULL: the user's cache folder */
    const char *techniques; /* names separated by commas; NULL: all */
    const char *budgets;    /* ascending numbers separated by commas */
    char *const *arguments; /* of the command line, for the page; NULL at their end */
    const struct kernels *kernels;
    uint32_t width, height, seeds;
    uint32_t edge_rays; /* as in set_desc, likewise every_pixel */
    bool every_pixel;
    uint32_t truth_samples; /* of each reference, per pixel */
    bool progress;          /* a line on standard error, if that is a terminal */
    /* NULL: one process. Otherwise the ranks of a job first share out the references of all panels, for which they need
     * the same cache folder; then rank 0 measures times alone, on `threads` threads, and writes the files. chart_run is
     * then collective; other ranks return when the references are there. */
    struct ranks *ranks;
    int threads;
};

/* Writes chart.csv, runs.csv, index.html and the charts' SVG files, by a script (script.h). ERR_USAGE: a list is
 * invalid, which is found before the work, as is ERR_IO: no python3. Errors of scenes and sources, ERR_IO, ERR_NOMEM.
 */
MUST_CHECK enum err chart_run(const struct chart_desc *desc, struct reason *why);

/* "4,8,16" into at most `room` numbers, ascending and at least two. ERR_USAGE. */
MUST_CHECK enum err chart_read_budgets(const char *list, uint32_t *out, uint32_t room, uint32_t *count,
                                       struct reason *why);

/* The next element of a list into title and spec: "noon=sky:hour=12" has the title "noon"; by default a file's title is
 * its name without folder and ending, and that of other sources the whole spec. Advances *list; false at its end. */
bool chart_next_item(const char **list, char title[128], char spec[4096]);

/* ---- Panels ---- */

/* One panel of the chart: a scene under a sky in one class of light, with the results of every technique at every
 * budget. One thread of control. */

/* ---- Techniques ---- */

/* The techniques that are compared: named ways of lighting an image, and what a budget means for each. Constant
 * tables; any thread may read them, and run techniques on a relighter of its own. */

/* Which light an image holds; a chart compares techniques for the same light only. */
enum light_class {
    LIGHT_DIRECT, /* the sky, and what it lights directly */
    LIGHT_ALL,    /* and caustics and indirect light */
    LIGHT_CLASSES,
};

enum technique_kind {
    TECHNIQUE_FIXED,    /* the lower envelope is that of these */
    TECHNIQUE_BASELINE, /* for comparison: paths, Metropolis, photons, point lights */
    TECHNIQUE_PREPARED, /* has a precomputation, which is not in the time of a frame: plotted, but not ranked */
    TECHNIQUE_FILTERED, /* denoised: the eye prefers it, but it is biased. Plotted, not ranked; compared with the same
                         * technique unfiltered */
    TECHNIQUE_AUTO,     /* chooses by measurement (light/frame/pilot.h); compared with the envelope of the fixed ones */
};

struct technique {
    const char *name;  /* on command lines and in the CSV: no blanks, no commas */
    const char *about; /* for people, a phrase that follows "it takes ..." */
    enum light_class light_class;
    uint32_t colour; /* of its line, 0xrrggbb; 0: the ink's */
    enum technique_kind kind;
    struct relight_desc light; /* all but the budget and the seed */
    /* What a budget N means, as a ratio: N times / per samples per shade point, or per pixel where the method makes the
     * whole image. Particles and eye paths follow from the plan (light/plan/plan.h), one for every eight samples.
     * Auto gets the time that technique_pace takes for that budget; its own time is measured like that of the others.
     */
    uint32_t times, per;
};

/* All of them, in the order of the legend. */
const struct technique *technique_all(size_t *count);
#define TECHNIQUES_MAX 32 /* bounds a table */

extern const char *const technique_kinds[]; /* their names */

/* Whether a list of names with commas between has the technique's; NULL: it has all. technique_check_list returns
 * ERR_USAGE for an unknown name. */
bool technique_listed(const char *list, const struct technique *t);
MUST_CHECK enum err technique_check_list(const char *list, struct reason *why);

/* The samples that a budget comes to, at least 1. */
uint32_t technique_samples(const struct technique *t, uint32_t budget);

/* The technique whose time auto is given. */
const struct technique *technique_pace(enum light_class c);

struct technique_stage { /* what a run needs; borrowed */
    struct relighter *relighter;
    double seconds;                                /* a frame, for TECHNIQUE_AUTO */
    const struct environment *environment, *other; /* other: has nothing in common with it */
};

struct technique_cost {
    double seconds;  /* of the image: samples, shading, light tracing, resolving, and all measurements of the pilot,
                        which begins anew */
    double expected; /* relMSE without bias, as estimated by auto; 0: by others */
    uint32_t samples, eye_paths; /* per shade point */
    uint64_t particles, rays;
    const char *bias; /* what the method computes wrongly, in words; NULL: nothing */
    double prepared;  /* seconds of precomputation in this run, not in `seconds` */
    uint64_t prepared_bytes;
};

/* One image, as the first of a file: rgb float[height][width][3]. TECHNIQUE_PREPARED lights the other sky before, so
 * that nothing is taken over from a frame under the same one. Errors as relighter_run's: ERR_UNSUPPORTED where the
 * method needs another layout of sky. */
MUST_CHECK enum err technique_run(const struct technique *t, const struct technique_stage *stage, uint32_t budget,
                                  uint64_t seed, float *rgb, struct technique_cost *cost, struct reason *why);

struct progress;

#define BUDGETS_MAX 16 /* bound tables */
#define SEEDS_MAX 256

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
 * budgets and seeds, 660 MB for 12, 5 and 16 at 320x180; ERR_RANGE above 8 GiB. Other errors: those of judge.h,
 * ERR_NOMEM. *out, owned by the caller, which may be NULL on an error; times in seconds but for those named ms, none of
 * them of a whole frame:
 *   scene, source, light, pace (the technique whose time auto has), width, height, seeds, points (shade points),
 *   gbuffer_bytes, load_ms, bvh_ms, gbuffer_ms, table_ms: once, before the first frame; table: of resampling
 *   common_ms   of stages that all techniques share: decode, rebuild (resampling onto the cube map, and its sampling
 *               tables), tone, encode (JPEG), [budgets * seeds] each
 *   reference_samples, reference_noise, reference_doubt (judge.h), truth: its image
 *   curves      in the order of the legend: technique, about, colour, kind, method, prepared_ms, prepared_bytes, bias
 * (as above; null: none), and left_out (the reason why it was not measured; null: it was) points    one for each
 * budget: budget, samples, eye_paths, particles, rays, and over the seeds seconds and expected; errors: by error_names,
 * null for infinity; floor: judge_floor's; image, map: of the first seed Images are data: addresses of JPEG. */
MUST_CHECK enum err panel_measure(const struct panel_desc *desc, json_t **out, struct reason *why);

/* The references that a panel needs. */
struct truth_desc panel_truth(const struct panel_desc *desc);
